//! Units that attributes state beside a size.

use crate::volume::stated::written::{Held, Written};

/// Attributes of the unit of length beside a size, whatever the name of that, in plain spelling.
const UNITS: [&str; 10] = [
    "voxelunit",
    "voxelsizeunit",
    "pixelunit",
    "pixelsizeunit",
    "spacingunit",
    "lengthunit",
    "spatialunit",
    "spaceunit",
    "resolutionunit",
    "sizeunit",
];

/// An attribute that states a unit.
pub(crate) struct UnitBeside {
    /// Its name.
    pub(crate) by: String,
    pub(crate) texts: Vec<String>,
    /// By its name it may be the unit of anything, as of the values.
    pub(crate) of_anything: bool,
}

impl Written {
    /// The unit that an attribute states for sizes of these plain spellings, or for all sizes.
    pub(crate) fn unit_beside(&self, sizes: &[&str]) -> Option<UnitBeside> {
        let own: Vec<String> = sizes.iter().map(|size| format!("{size}unit")).collect();
        let own = own.iter().map(String::as_str).filter(|n| *n != "unit");
        let (of_size, any) = (own.chain(UNITS), || self.unit_named("unit", true));
        let mut found = of_size.filter_map(|spelling| self.unit_named(spelling, false));
        found.next().or_else(any)
    }

    /// The attribute of a unit, by its plain spelling in the singular.
    fn unit_named(&self, spelling: &str, of_anything: bool) -> Option<UnitBeside> {
        let several = format!("{spelling}s");
        match self.like(spelling).or_else(|| self.like(&several))? {
            (name, Held::Texts(texts)) => Some(UnitBeside {
                by: name.to_owned(),
                texts: texts.clone(),
                of_anything,
            }),
            _ => None,
        }
    }
}
