//! The options that choose cells, objects or surfaces of a tile set.

use crate::table::{Chosen, Table};
use clap::Args;

/// Which cells, objects or surfaces.
#[derive(Debug, Args)]
pub struct ChosenArgs {
    /// Choose among objects (connected above voxels) instead of cells, each with all its surfaces and caps
    #[arg(long, conflicts_with = "surfaces")]
    objects: bool,
    /// Choose among surfaces (connected triangles) instead of cells
    #[arg(long)]
    surfaces: bool,
    /// Only those for which this holds; conditions are those of `alvis cells`, over the columns of the table that is
    /// chosen from
    #[arg(long = "where", value_name = "EXPR", allow_hyphen_values = true)]
    condition: Option<String>,
    /// Only the N largest: by volume, of surfaces by area
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    largest: Option<usize>,
}

/// A whole number above 0.
pub fn at_least_one(text: &str) -> Result<usize, String> {
    match text.trim().parse() {
        Ok(n) if n > 0 => Ok(n),
        _ => Err("expected a whole number, at least 1".to_owned()),
    }
}

impl ChosenArgs {
    /// The name of an option that is given, if one is.
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            ("--objects", self.objects),
            ("--surfaces", self.surfaces),
            ("--where", self.condition.is_some()),
            ("--largest", self.largest.is_some()),
        ];
        all.into_iter().find(|(_, given)| *given).map(|all| all.0)
    }

    /// As the library has it.
    pub fn chosen(self) -> Chosen {
        Chosen {
            table: Table::asked(self.objects, self.surfaces),
            condition: self.condition,
            largest: self.largest,
        }
    }
}
