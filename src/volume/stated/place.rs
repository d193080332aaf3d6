//! Spacing, unit and origin of a volume after `--spacing` and `--unit` have had their say.

use crate::error::{Error, Result};
use crate::grid::length::Length;
use crate::grid::{Origin, Placement, Provenance, Unit};
use crate::volume::options::OpenOptions;
use std::path::Path;

/// The placement that the one of the file and the options make together, checked.
///
/// # Errors
/// [`Error::Usage`] for options that are incomplete or contradict the file, [`Error::Format`] and
/// [`Error::Unsupported`] for what is wrong with the file's own placement.
pub(crate) fn place(
    path: &Path,
    mut placement: Placement,
    mut provenance: Provenance,
    options: &OpenOptions,
) -> Result<(Placement, Provenance)> {
    match (options.spacing, options.unit) {
        (None, None) => {}
        (None, Some(unit)) => convert(path, unit, &mut placement, &mut provenance)?,
        (Some(spacing), unit) => {
            overridden(path, spacing, unit, &mut placement, &mut provenance)?;
        }
    }
    match placement.check() {
        // what is wrong now is the file's own
        Err(Error::Usage {
            option,
            found,
            expected,
            ..
        }) => {
            let found = format!("{option} {found}");
            Err(Error::format(path, found, expected).with_hint("give --spacing if it is that"))
        }
        Err(other) => Err(other),
        Ok(()) => match placement.shear() {
            None => Ok((placement, provenance)),
            Some(_) if options.resample => Ok((placement, provenance)),
            Some(cosines) => Err(Error::unsupported(
                path,
                format!(
                    "a sheared grid (cosines of {:.6}, {:.6} and {:.6} between its axes x y, x z and y z)",
                    cosines[0], cosines[1], cosines[2]
                ),
                "--resample interpolates it to axes at right angles",
            )),
        },
    }
}

/// `--spacing`, with or without `--unit`.
fn overridden(
    path: &Path,
    spacing: [f64; 3],
    unit: Option<Unit>,
    placement: &mut Placement,
    provenance: &mut Provenance,
) -> Result<()> {
    if !spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
        let expected = "three finite numbers above 0";
        return Err(Error::usage("--spacing", format!("{spacing:?}"), expected));
    }
    let unit = match unit {
        Some(unit) => {
            move_origin(unit, placement, provenance);
            provenance.unit = Origin::Option;
            unit
        }
        None if provenance.unit == Origin::File => placement.unit,
        None => {
            let expected = "the unit of --spacing: m, cm, mm, um or nm, or voxel if there is none";
            return Err(Error::usage("--unit", "nothing", expected)
                .with_hint(format!("{} states no unit", path.display())));
        }
    };
    placement.spacing = spacing;
    placement.unit = unit;
    provenance.spacing = [Origin::Option; 3];
    Ok(())
}

/// `--unit` alone: the file's own numbers in that unit.
fn convert(
    path: &Path,
    unit: Unit,
    placement: &mut Placement,
    provenance: &mut Provenance,
) -> Result<()> {
    let stated = provenance.spacing.contains(&Origin::File);
    let own = placement.unit;
    if unit == own && (stated || unit == Unit::Voxel) {
        if provenance.unit != Origin::File {
            provenance.unit = Origin::Option;
        }
        return Ok(());
    }
    if !stated {
        let expected = "--spacing with it, the size of a voxel in that unit";
        return Err(Error::usage("--unit", format!("{unit} alone"), expected)
            .with_hint(format!("{} states no size", path.display())));
    }
    match (provenance.unit, own) {
        // numbers without a unit: this is theirs
        (_, Unit::Voxel) => placement.unit = unit,
        (Origin::File, _) if unit != Unit::Voxel => {
            let length = Length::from(own);
            placement.spacing = placement.spacing.map(|s| length.convert(s, unit));
            move_origin(unit, placement, provenance);
            placement.unit = unit;
        }
        (from, own) => {
            let states = match from {
                Origin::File => "states",
                _ => "does not state a unit, and its format means",
            };
            let found = format!("{unit} alone");
            return Err(
                Error::usage("--unit", found, "--spacing with it, or no --unit")
                    .with_hint(format!("{} {states} {own}", path.display())),
            );
        }
    }
    provenance.unit = Origin::Option;
    Ok(())
}

/// The origin as numbers of another unit. Without a length there is no place in space to keep.
fn move_origin(unit: Unit, placement: &mut Placement, provenance: &mut Provenance) {
    match (placement.unit, unit) {
        // an origin without a unit is in that of the spacing
        (Unit::Voxel, _) => {}
        (_, Unit::Voxel) => {
            placement.origin = [0.0; 3];
            provenance.origin = Origin::Option;
        }
        (own, unit) => {
            let length = Length::from(own);
            placement.origin = placement.origin.map(|v| length.convert(v, unit));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file that states a size of 0.05 at 1, 2, 3, in a unit that it states or not.
    fn placed(
        own: Unit,
        stated: [Origin; 2],
        spacing: Option<f64>,
        unit: Option<Unit>,
    ) -> Result<(Placement, Provenance)> {
        let mut placement = Placement {
            unit: own,
            origin: [1.0, 2.0, 3.0],
            ..Placement::default()
        };
        let mut provenance = Provenance {
            unit: stated[1],
            ..Provenance::default()
        };
        if stated[0] == Origin::File {
            placement.spacing = [0.05; 3];
            provenance.spacing = [Origin::File; 3];
        }
        let options = OpenOptions {
            spacing: spacing.map(|s| [s; 3]),
            unit,
            ..OpenOptions::default()
        };
        place(Path::new("v.nrrd"), placement, provenance, &options)
    }

    const STATED: [Origin; 2] = [Origin::File; 2];
    const NOTHING: [Origin; 2] = [Origin::Default; 2];
    const NO_UNIT: [Origin; 2] = [Origin::File, Origin::Default];

    #[test]
    fn a_unit_converts_what_the_file_states() {
        let (place, from) = placed(Unit::Millimetre, STATED, None, Some(Unit::Micrometre)).unwrap();
        assert_eq!((place.spacing, place.unit), ([50.0; 3], Unit::Micrometre));
        assert_eq!(place.origin, [1000.0, 2000.0, 3000.0]);
        assert_eq!(
            (from.spacing, from.unit),
            ([Origin::File; 3], Origin::Option)
        );
    }

    #[test]
    fn a_unit_completes_numbers_without_one() {
        let (place, _) = placed(Unit::Voxel, NO_UNIT, None, Some(Unit::Metre)).unwrap();
        assert_eq!((place.spacing, place.unit), ([0.05; 3], Unit::Metre));
        assert_eq!(place.origin, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn the_origin_goes_with_the_unit() {
        let given = Some(Unit::Micrometre);
        let (place, from) = placed(Unit::Millimetre, STATED, Some(7.0), given).unwrap();
        assert_eq!((place.spacing, place.unit), ([7.0; 3], Unit::Micrometre));
        assert_eq!(place.origin, [1000.0, 2000.0, 3000.0]);
        assert_eq!(from.spacing, [Origin::Option; 3]);
        let (place, _) = placed(Unit::Millimetre, STATED, Some(7.0), None).unwrap();
        assert_eq!((place.spacing, place.unit), ([7.0; 3], Unit::Millimetre));
        let given = Some(Unit::Voxel);
        let (place, _) = placed(Unit::Millimetre, STATED, Some(1.0), given).unwrap();
        assert_eq!((place.origin, place.unit), ([0.0; 3], Unit::Voxel));
    }

    #[test]
    fn one_without_the_other_is_asked_for() {
        for (own, stated, spacing, unit, names) in [
            (Unit::Voxel, NOTHING, Some(0.5), None, "--unit"),
            (Unit::Voxel, NO_UNIT, Some(0.5), None, "--unit"),
            (Unit::Millimetre, NO_UNIT, Some(0.5), None, "--unit"),
            (Unit::Voxel, NOTHING, None, Some(Unit::Metre), "--spacing"),
            (
                Unit::Millimetre,
                NO_UNIT,
                None,
                Some(Unit::Micrometre),
                "--spacing",
            ),
            (
                Unit::Millimetre,
                STATED,
                None,
                Some(Unit::Voxel),
                "--spacing",
            ),
        ] {
            let error = placed(own, stated, spacing, unit).unwrap_err().to_string();
            assert!(error.contains(names), "{error}");
        }
        placed(Unit::Voxel, NOTHING, None, Some(Unit::Voxel)).unwrap();
        placed(Unit::Millimetre, NO_UNIT, None, Some(Unit::Millimetre)).unwrap();
    }
}
