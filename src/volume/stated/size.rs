//! The size of a voxel from what a file states of each axis.

use crate::grid::length::{Length, tidy};
use crate::grid::{Origin, Placement, Provenance, Unit};
use crate::volume::stated::warning::Warning;

/// What a file states of the step along one axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Step {
    /// Size of a voxel, in `unit`.
    pub(crate) size: f64,
    /// Its unit, as the file spells it; empty if it states none.
    pub(crate) unit: String,
    /// What the file has in place of a number.
    pub(crate) no_number: Option<String>,
}

impl Step {
    /// A step in a unit of this name.
    pub(crate) fn new(size: f64, unit: impl Into<String>) -> Self {
        Step {
            size,
            unit: unit.into(),
            no_number: None,
        }
    }

    /// Its length in nanometres; `None` if its unit is none of length.
    pub(crate) fn nanometres(&self) -> Option<f64> {
        let unit = Length::parse(&self.unit)?;
        Some(unit.convert(self.size, Unit::Nanometre))
    }

    /// A step of a size that the file writes as text.
    pub(crate) fn of_text(text: &str, unit: impl Into<String>) -> Self {
        let text = text.trim();
        let number = text.parse::<f64>().ok();
        Step {
            no_number: number.is_none().then(|| text.to_owned()),
            ..Step::new(number.map_or(f64::NAN, tidy), unit)
        }
    }
}

/// Spacing and unit, where they came from, and a warning if that needs one.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct VoxelSize {
    pub(crate) spacing: Option<[f64; 3]>,
    /// `None` if the file states none, or only the size in voxels.
    pub(crate) unit: Option<Unit>,
    pub(crate) from: [Origin; 3],
    pub(crate) warning: Option<Warning>,
    /// The unit of numbers of x, as the file has them, if it is a length: an origin is in it.
    pub(crate) of_file: [Option<Length>; 3],
}

impl VoxelSize {
    /// Puts spacing and unit in their places.
    pub(crate) fn apply(&self, place: &mut Placement, from: &mut Provenance) {
        let Some(spacing) = self.spacing else {
            return;
        };
        place.spacing = spacing;
        from.spacing = self.from;
        if let Some(unit) = self.unit {
            place.unit = unit;
            from.unit = Origin::File;
        }
    }
}

/// The spacing of the axes x, y and z, in one unit, from the steps that a file states.
///
/// Steps in several units are brought to one, that of the first of them. A missing z is assumed to be as long as
/// x, with a warning. Where x or y is missing, a size is no positive number, a unit is not known, or only some axes
/// have one, nothing is taken, with a warning unless nothing at all is stated.
pub(crate) fn voxel_size(steps: [Option<Step>; 3]) -> VoxelSize {
    let nothing = |warning: String| VoxelSize {
        warning: Some(Warning::of_size(warning)),
        ..VoxelSize::default()
    };
    let advice = "give --spacing and --unit";
    let [Some(x), Some(y), z] = &steps else {
        let some = steps.iter().zip(["x", "y", "z"]);
        let some: Vec<_> = some.filter(|(s, _)| s.is_some()).map(|(_, n)| n).collect();
        return match some[..] {
            [] => VoxelSize::default(),
            _ => nothing(format!(
                "the file states the size of a voxel along {} alone, which is not taken: {advice}",
                some.join(" and ")
            )),
        };
    };
    let all = [x, y, z.as_ref().unwrap_or(x)];
    if let Some(bad) = all.iter().find(|s| !(s.size.is_finite() && s.size > 0.0)) {
        return nothing(format!(
            "the file states {} as the size of a voxel, which is not taken: {advice}",
            bad.no_number.clone().unwrap_or(bad.size.to_string())
        ));
    }
    let units = all.map(|step| Length::parse(step.unit.trim()));
    if let Some((step, _)) = all.iter().zip(units).find(|(step, unit)| {
        let name = step.unit.trim();
        unit.is_none() && !name.is_empty() && !matches!(name.parse(), Ok(Unit::Voxel))
    }) {
        return nothing(format!(
            "the file states the size of a voxel in \"{}\", a unit that is not known and not taken: {advice}",
            step.unit.trim()
        ));
    }
    let (spacing, unit) = match units {
        [Some(a), Some(b), Some(c)] => {
            let unit = a.shown_in();
            let spacing = [(a, x), (b, y), (c, all[2])].map(|(u, s)| u.convert(s.size, unit));
            (spacing, Some(unit))
        }
        [None, None, None] => (all.map(|s| s.size), None),
        _ => {
            return nothing(format!(
                "the file states a unit for some axes only, so its sizes are not taken: {advice}"
            ));
        }
    };
    let assumed = z.is_none();
    let of_z = [Origin::File, Origin::Assumed][usize::from(assumed)];
    VoxelSize {
        spacing: Some(spacing),
        unit,
        from: [Origin::File, Origin::File, of_z],
        warning: assumed.then(assumed_z),
        of_file: units,
    }
}

/// What to say where a format has no distance of slices.
pub(crate) fn assumed_z() -> Warning {
    Warning::of_size(
        "the file does not state the distance of slices, assumed to be the size of a pixel: give --spacing X,Y,Z and \
         --unit if it is another",
    )
}

#[cfg_attr(not(any(feature = "hdf5", feature = "zarr")), allow(dead_code))]
/// The decimal with fewest digits that is no farther from a number than `doubt`, and its own rounding.
pub(crate) fn shortest_near(value: f64, doubt: f64) -> f64 {
    let doubt = doubt + 2.0 * f64::EPSILON * value.abs();
    let decimals = (0..17).map(|digits| format!("{value:.digits$e}").parse().unwrap_or(value));
    let mut near = decimals.filter(|decimal: &f64| (decimal - value).abs() <= doubt);
    near.next().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(x: (f64, &str), y: (f64, &str), z: Option<(f64, &str)>) -> VoxelSize {
        let step = |(size, unit): (f64, &str)| Step::new(size, unit);
        voxel_size([Some(step(x)), Some(step(y)), z.map(step)])
    }

    #[test]
    fn steps_are_brought_to_one_unit() {
        let mixed = of((4.0, "nm"), (4.0, "nanometer"), Some((0.03, "um")));
        assert_eq!(mixed.spacing, Some([4.0, 4.0, 30.0]));
        assert_eq!((mixed.unit, mixed.warning), (Some(Unit::Nanometre), None));
        let inch = of((0.001, "in"), (0.001, "in"), Some((2.0, "mm")));
        assert_eq!(inch.spacing, Some([0.0254, 0.0254, 2.0]));
        assert_eq!(inch.unit, Some(Unit::Millimetre));
        let plain = of((2.0, ""), (3.0, "pixel"), Some((4.0, "")));
        assert_eq!((plain.spacing, plain.unit), (Some([2.0, 3.0, 4.0]), None));
    }

    #[test]
    fn a_missing_z_is_assumed_with_a_warning() {
        let flat = of((0.1, "mm"), (0.1, "mm"), None);
        assert_eq!(flat.spacing, Some([0.1; 3]));
        assert_eq!(flat.from, [Origin::File, Origin::File, Origin::Assumed]);
        assert!(flat.warning.unwrap().contains("--spacing"));
    }

    #[test]
    fn what_is_unclear_is_not_taken() {
        for unclear in [
            of((1.0, "foo"), (1.0, "mm"), None),
            of((1.0, ""), (1.0, ""), Some((1.0, "mm"))),
            of((0.0, "mm"), (1.0, "mm"), Some((1.0, "mm"))),
            of((1.0, "mm"), (f64::NAN, "mm"), Some((1.0, "mm"))),
            voxel_size([None, None, Some(Step::new(1.0, "mm"))]),
        ] {
            assert_eq!((unclear.spacing, unclear.unit), (None, None));
            assert!(unclear.warning.unwrap().contains("--spacing"));
        }
        assert_eq!(voxel_size([None, None, None]), VoxelSize::default());
    }
}
