//! The sizes of voxels and the place of a grid, by the conventions of those who write HDF5.

use crate::grid::length::{Length, product, sum};
use crate::grid::{Origin, Placement, Provenance};
use crate::volume::formats::hdf5::attributes::{Attributes, numbers_of};
use crate::volume::formats::hdf5::axes::Axes;
use crate::volume::formats::hdf5::place::{Place, axistags};
use crate::volume::stated::size::{Step, VoxelSize, shortest_near, voxel_size};
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::{Grid, size};

/// One axis of a grid: the size of a voxel and the place of the first one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Along {
    pub(crate) step: Step,
    pub(crate) start: f64,
    /// The coordinate falls from one voxel to the next.
    pub(crate) falls: bool,
}

/// What a file states of the place of a grid.
#[derive(Debug, Default)]
pub(crate) struct Geometry {
    /// Of x, y and z.
    pub(crate) along: [Option<Along>; 3],
    /// Unit vectors along x, y and z, if they are not the usual ones.
    pub(crate) directions: Option<[[f64; 3]; 3]>,
    /// The place of the grid, if the file states it as a whole.
    pub(crate) whole: Option<(Placement, Provenance)>,
    pub(crate) notes: Vec<String>,
    pub(crate) warnings: Vec<Warning>,
    /// Why the grid is none with one step along each axis.
    pub(crate) uneven: Option<String>,
}

impl Geometry {
    /// Spacing, unit, origin and directions.
    pub(crate) fn place(mut self) -> (Placement, Provenance, Vec<String>, Vec<Warning>) {
        if let Some((place, from)) = self.whole {
            return (place, from, self.notes, self.warnings);
        }
        let mut place = Placement::default();
        let mut from = Provenance::default();
        let steps = self.along.clone().map(|a| a.map(|a| a.step));
        let size: VoxelSize = voxel_size(steps);
        size.apply(&mut place, &mut from);
        self.warnings.extend(size.warning);
        if size.spacing.is_none() {
            return (place, from, self.notes, self.warnings);
        }
        let mut directions = self.directions.unwrap_or(place.directions);
        let mut falling = Vec::new();
        let mut starts = [0.0; 3];
        for (a, along) in self.along.iter().enumerate() {
            let Some(along) = along else { continue };
            let length = size.of_file[a].filter(|_| size.unit.is_some());
            starts[a] = length.map_or(along.start, |l: Length| l.convert(along.start, place.unit));
            if along.falls {
                directions[a] = directions[a].map(|v| 0.0 - v);
                falling.push(["x", "y", "z"][a]);
            }
        }
        let axes = self.directions.unwrap_or(Placement::default().directions);
        for (i, origin) in place.origin.iter_mut().enumerate() {
            let parts = [0, 1, 2].map(|a| starts[a] * axes[a][i]);
            let most = parts
                .iter()
                .fold(0.0, |most: f64, part| most.max(part.abs()));
            let total = parts.iter().sum::<f64>() + 0.0;
            *origin = shortest_near(total, 4.0 * f64::EPSILON * most);
        }
        if starts != [0.0; 3] {
            from.origin = Origin::File;
        }
        if !falling.is_empty() {
            let axes = falling.join(" and ");
            let note =
                format!("the coordinate falls along {axes}: the surface lies in space as it does");
            self.notes.push(note);
        }
        place.directions = directions;
        (place, from, self.notes, self.warnings)
    }
}

impl Place<'_> {
    /// Steps and places by the first convention that states any.
    pub(crate) fn geometry(&self, axes: &Axes) -> Geometry {
        let mut geometry = Geometry::default();
        let own = self.attributes.written();
        own.placed("", &mut geometry.warnings);
        for (group, attributes) in self.groups() {
            attributes.placed(&format!(" of the group {group}"), &mut geometry.warnings);
        }
        for convention in [Self::mesh, Self::simpl, Self::tagged, Self::scaled] {
            convention(self, axes, &mut geometry);
            if geometry.along.iter().any(Option::is_some) || geometry.uneven.is_some() {
                let steps = geometry.along.clone().map(|along| along.map(|a| a.step));
                let own = size(&own, self.grid(axes), "");
                geometry.warnings.extend(own.contradicts(&steps));
                return geometry;
            }
        }
        self.sizes(axes, &mut geometry);
        geometry
    }

    fn grid(&self, axes: &Axes) -> Grid {
        Grid {
            volume: axes.volume,
            axes: self.dataset.ndim(),
            named: axes.named,
        }
    }

    /// Attributes that hold the size of a voxel: its own, or those of the nearest group that states any.
    fn sizes(&self, axes: &Axes, geometry: &mut Geometry) {
        let grid = self.grid(axes);
        let mut found = size(&self.attributes.written(), grid, "");
        for (group, attributes) in self.groups() {
            if found.steps.is_some() || !found.warnings.is_empty() {
                break;
            }
            let of = format!(" of the group {group}");
            found = size(&attributes, grid, &of);
            if found.steps.is_some() && self.others(&group) {
                found = found.of_several();
            }
        }
        geometry.notes.append(&mut found.notes);
        geometry.warnings.append(&mut found.warnings);
        if let Some(steps) = found.steps {
            geometry.along = steps.map(|step| step.map(Along::from));
        }
    }

    /// A mesh of openPMD.
    fn mesh(&self, axes: &Axes, geometry: &mut Geometry) {
        let of = |name: &str| {
            self.attributes
                .numbers(name)
                .or_else(|| self.group.numbers(name))
        };
        let (Some(spacing), Some(unit)) = (of("gridSpacing"), of("gridUnitSI")) else {
            return;
        };
        let ([factor], true) = (&unit[..], spacing.len() == self.dataset.ndim()) else {
            return;
        };
        let offset = of("gridGlobalOffset").filter(|o| o.len() == spacing.len());
        geometry.along = axes.volume.map(|a| {
            let start = offset.as_ref().map_or(0.0, |o| product(o[a], *factor));
            Some(Along {
                start,
                ..Along::of(product(spacing[a], *factor), "m")
            })
        });
        geometry
            .notes
            .push("size of a voxel by the attributes gridSpacing and gridUnitSI".into());
    }

    /// The geometry beside a DREAM.3D array, x first, of which the origin is a corner.
    fn simpl(&self, _: &Axes, geometry: &mut Geometry) {
        if !self.attributes.has("TupleDimensions") {
            return;
        }
        let mut parts = self.name.rsplitn(3, '/');
        let Some(container) = parts.nth(2) else {
            return;
        };
        let read = |name: &str| {
            let dataset = self
                .file
                .dataset(&format!("{container}/_SIMPL_GEOMETRY/{name}"));
            numbers_of(&dataset.ok()?).filter(|v| v.len() == 3)
        };
        let Some(spacing) = read("SPACING") else {
            return;
        };
        let origin = read("ORIGIN").unwrap_or_else(|| vec![0.0; 3]);
        geometry.along = [0, 1, 2].map(|a| {
            let start = sum(origin[a], product(spacing[a], 0.5));
            Some(Along {
                start,
                ..Along::of(spacing[a], "")
            })
        });
        geometry
            .notes
            .push("size of a voxel by _SIMPL_GEOMETRY, which states no unit".into());
    }

    /// The resolutions of axis tags, if these state any.
    fn tagged(&self, axes: &Axes, geometry: &mut Geometry) {
        let tags = self
            .attributes
            .text("axistags")
            .and_then(|text| axistags(&text));
        let Some(tags) = tags.filter(|t| t.len() == self.dataset.ndim()) else {
            return;
        };
        let along = axes.volume.map(|a| {
            let (_, resolution, unit) = &tags[a];
            (*resolution > 0.0).then(|| Along::of(*resolution, unit))
        });
        if along.iter().all(Option::is_some) {
            geometry.along = along;
            geometry
                .notes
                .push("size of a voxel by the attribute axistags".into());
        }
    }

    /// Coordinates of the axes.
    fn scaled(&self, axes: &Axes, geometry: &mut Geometry) {
        let mut along = [None, None, None];
        for (a, along) in along.iter_mut().enumerate() {
            let axis = axes.volume[a];
            let Some((name, dataset)) = self.coordinates(axis) else {
                continue;
            };
            let attributes = Attributes(dataset.attributes());
            let n = self.dataset.shape()[axis];
            let none = attributes
                .text("NAME")
                .is_some_and(|t| t.contains("not a netCDF variable"));
            let Some(mut values) = numbers_of(&dataset).filter(|_| !none) else {
                continue;
            };
            // packed, as CF allows of coordinates too
            let [slope, shift] = [("scale_factor", 1.0), ("add_offset", 0.0)]
                .map(|(name, default)| attributes.number(name).unwrap_or(default));
            values
                .iter_mut()
                .for_each(|v| *v = sum(product(*v, slope), shift));
            let single = matches!(
                dataset.dtype(),
                hdf5_reader::Datatype::FloatingPoint { size: 4, .. }
            );
            match even(&values, n, single) {
                Some((start, step)) if step != 0.0 => {
                    let unit = attributes.written().unit().unwrap_or_default();
                    *along = Some(Along {
                        start,
                        falls: step < 0.0,
                        ..Along::of(step.abs(), &unit)
                    });
                }
                Some(_) => {}
                None if values.len() as u64 == n || values.len() as u64 == n + 1 => {
                    let what = format!(
                        "coordinates along {} that are not evenly spaced ({name})",
                        ["x", "y", "z"][a]
                    );
                    geometry.uneven.get_or_insert(what);
                }
                None => {}
            }
        }
        // counting is no size
        let counted = |a: &Option<Along>| {
            a.as_ref()
                .is_none_or(|a| a.step == Step::new(1.0, "") && a.start == 0.0 && !a.falls)
        };
        if !along.iter().all(counted) {
            geometry.along = along;
            geometry
                .notes
                .push("size of a voxel by the coordinates of the axes".into());
        }
    }
}

impl Along {
    /// A step from the origin on.
    pub(crate) fn of(size: f64, unit: &str) -> Self {
        Step::new(size, unit).into()
    }
}

impl From<Step> for Along {
    fn from(step: Step) -> Self {
        Along {
            step,
            start: 0.0,
            falls: false,
        }
    }
}

/// Start and step of coordinates of the centres of `n` voxels, or of their `n + 1` edges.
fn even(values: &[f64], n: u64, single: bool) -> Option<(f64, f64)> {
    let (first, last) = (*values.first()?, *values.last()?);
    let edges = values.len() as u64 == n + 1;
    if (values.len() as u64 != n && !edges) || values.len() < 2 {
        return None;
    }
    let step = (last - first) / (values.len() - 1) as f64;
    let most = first.abs().max(last.abs());
    let rounding = if single {
        2.0 * f64::from(f32::EPSILON) * most
    } else {
        0.0
    };
    let slack = 1e-3 * step.abs() + rounding;
    let near = |(i, v): (usize, &f64)| (v - (first + i as f64 * step)).abs() <= slack;
    let doubt = rounding.max(4.0 * f64::EPSILON * most) / (values.len() - 1) as f64;
    let step = shortest_near(step, doubt);
    let half = product(step, 0.5);
    let start = if edges { sum(first, half) } else { first };
    (step.is_finite() && values.iter().enumerate().all(near)).then_some((start, step))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_even_or_not() {
        assert_eq!(
            even(&[0.0, 0.1, 0.2, 0.30000000000000004], 4, false),
            Some((0.0, 0.1))
        );
        assert_eq!(even(&[3.0, 2.0, 1.0], 3, false), Some((3.0, -1.0)));
        assert_eq!(even(&[0.0, 2.0, 4.0], 2, false), Some((1.0, 2.0)));
        assert_eq!(even(&[0.0, 1.0, 3.0], 3, false), None);
        assert_eq!(even(&[0.0, 1.0], 5, false), None);
        assert_eq!(even(&[0.0, f64::NAN, 2.0], 3, false), None);
        let far: Vec<f64> = (0..9)
            .map(|i| crate::grid::length::shortest(1000.0 + 0.01 * i as f32))
            .collect();
        assert_eq!(even(&far, 9, false), Some((1000.0, 0.01)));
        assert_eq!(even(&far, 9, true), Some((1000.0, 0.01)));
        assert_eq!(shortest_near(0.1 + 0.2, 0.0), 0.3);
        assert_eq!(shortest_near(1.0 / 3.0, 0.0), 1.0 / 3.0);
    }
}
