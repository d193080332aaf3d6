//! Where a volume lies, from what is stated of the axes x, y and z.

use crate::error::{Error, Result};
use crate::grid::{Origin, Placement, Provenance};
use crate::volume::formats::zarr::ome::{OmeAxis, Stated};
use crate::volume::formats::zarr::transform::Affine;
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::stated::warning::Warning;
use std::path::Path;

/// What is stated of an axis of the volume.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Line {
    /// From one voxel to the next; below 0 if coordinates run down.
    pub(crate) step: f64,
    /// The coordinate of voxel 0.
    pub(crate) start: f64,
    /// Its unit as the file spells it; empty if it states none.
    pub(crate) unit: String,
}

/// A place, where it is from, and a warning.
pub(crate) type Placed = (Placement, Provenance, Option<Warning>);

/// The place of a volume whose axes are those of the coordinates.
pub(crate) fn along(lines: [Option<Line>; 3]) -> Placed {
    let step = |line: &Option<Line>| {
        let line = line.as_ref()?;
        Some(Step::new(line.step.abs(), line.unit.clone()))
    };
    let size = voxel_size([0, 1, 2].map(|a| step(&lines[a])));
    let (mut place, mut from) = (Placement::default(), Provenance::default());
    size.apply(&mut place, &mut from);
    if size.spacing.is_some() {
        for (a, line) in lines.iter().enumerate() {
            let Some(line) = line else { continue };
            place.directions[a][a] = if line.step < 0.0 { -1.0 } else { 1.0 };
            place.origin[a] = match (size.of_file[a], size.unit) {
                (Some(length), Some(unit)) => length.convert(line.start, unit),
                _ => line.start,
            };
            if line.start != 0.0 {
                from.origin = Origin::File;
            }
        }
        if lines.iter().all(Option::is_some) {
            from.origin = Origin::File;
        }
    }
    (place, from, size.warning)
}

/// For each axis of an array the axis of coordinates that it runs along: where each index turns into one coordinate,
/// that one, or else the one of its number.
pub(crate) fn labels(stated: &Stated, axes: usize) -> Vec<usize> {
    let by_number = || (0..axes).collect();
    let Ok(Some(affine)) = &stated.affine else {
        return by_number();
    };
    let mut labels = vec![None; axes];
    for (i, row) in affine.matrix.iter().enumerate() {
        let mut own = row.iter().enumerate().filter(|(_, v)| **v != 0.0);
        if let (Some((j, _)), None) = (own.next(), own.next())
            && let Some(label) = labels.get_mut(j)
        {
            *label = Some(i);
        }
    }
    let found: Option<Vec<usize>> = labels.into_iter().collect();
    found.unwrap_or_else(by_number)
}

/// How indices of an array turn into coordinates.
pub(crate) struct Coordinates<'a> {
    pub(crate) affine: &'a Affine,
    pub(crate) axes: &'a [OmeAxis],
    /// For each axis of the array the one of coordinates that it runs along.
    pub(crate) labels: &'a [usize],
}

/// The place of a volume of which the array's `axes` are x, y and z.
///
/// # Errors
/// [`Error::Unsupported`] for a transformation in which other axes turn into x, y or z, or units are mixed.
pub(crate) fn turned(group: &Path, to: &Coordinates, axes: [usize; 3]) -> Result<Placed> {
    let affine = to.affine;
    let rows = axes.map(|a| to.labels[a]);
    let no = |what: &str| Error::unsupported(group, what, "");
    for (i, row) in affine.matrix.iter().enumerate() {
        let mixed = |(j, v): (usize, &f64)| *v != 0.0 && rows.contains(&i) != axes.contains(&j);
        if row.iter().enumerate().any(mixed) {
            return Err(no(
                "a coordinate transformation that mixes x, y and z with other axes",
            ));
        }
    }
    let at = |r: usize, c: usize| affine.matrix[rows[r]][axes[c]];
    let unit = |a: usize| to.axes[rows[a]].unit.clone();
    let plain = (0..9).all(|i| i / 3 == i % 3 || at(i / 3, i % 3) == 0.0);
    let line = |a: usize, step: f64| {
        Some(Line {
            step,
            start: affine.shift[rows[a]],
            unit: unit(a),
        })
    };
    if plain {
        return Ok(along([0, 1, 2].map(|a| line(a, at(a, a)))));
    }
    if unit(1) != unit(0) || unit(2) != unit(0) {
        return Err(no("a rotation of axes of several units"));
    }
    let columns = [0, 1, 2].map(|c| glam::DVec3::new(at(0, c), at(1, c), at(2, c)));
    let (mut place, from, warning) = along([0, 1, 2].map(|a| line(a, columns[a].length())));
    place.directions = columns.map(|column| column.normalize_or(glam::DVec3::X).into());
    Ok((place, from, warning))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Unit;

    fn line(step: f64, start: f64, unit: &str) -> Option<Line> {
        Some(Line {
            step,
            start,
            unit: unit.into(),
        })
    }

    #[test]
    fn lines_that_run_down_are_mirrored() {
        let (place, from, warning) = along([
            line(0.5, 1.0, "um"),
            line(-0.5, 9.0, "um"),
            line(0.002, 0.003, "mm"),
        ]);
        assert_eq!(
            (place.spacing, place.unit),
            ([0.5, 0.5, 2.0], Unit::Micrometre)
        );
        assert_eq!(place.origin, [1.0, 9.0, 3.0]);
        assert_eq!(place.directions[1], [0.0, -1.0, 0.0]);
        assert_eq!((from.origin, warning), (Origin::File, None));
    }

    #[test]
    fn nothing_is_half_taken() {
        let (place, from, warning) = along([
            line(0.0, 1.0, "um"),
            line(1.0, 9.0, "um"),
            line(1.0, 3.0, "um"),
        ]);
        assert_eq!((place, from), (Placement::default(), Provenance::default()));
        assert!(warning.unwrap().contains("--spacing"));
    }
}
