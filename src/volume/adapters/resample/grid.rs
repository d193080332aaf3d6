//! The regular grid on which slices are interpolated that do not make one.

use crate::error::{Error, Result};
use crate::grid::{Dims, MAX_DIM, Placement};
use glam::DVec3;
use std::ops::Range;
use std::path::Path;

/// Where a slice lies relative to the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    /// Along the normal of slices, in the unit of the spacing.
    pub(crate) depth: f64,
    /// How far its first pixel lies aside of that of the first slice, in pixels of the grid along x and y.
    pub(crate) aside: [f64; 2],
}

/// The grid on which slices are interpolated, and where these lie in it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    pub(crate) size: [u32; 3],
    pub(crate) placement: Placement,
    /// The value outside of the slices.
    pub(crate) fill: f64,
    pub(super) places: Vec<Place>,
    /// Pixels along x that each row lies further aside than the one before.
    pub(super) lean: f64,
    /// Pixel of a slice without shift that the grid's first voxel is at.
    pub(super) start: [f64; 2],
    step: f64,
}

/// Slices that lie anywhere.
pub(crate) struct SlicePlaces {
    /// That of the first slice, with axes at right angles.
    pub(crate) placement: Placement,
    pub(crate) places: Vec<Place>,
    /// Pixels along x that each row lies further aside than the one before.
    pub(crate) lean: f64,
    /// Pixels of each slice.
    pub(crate) size: [u32; 2],
}

/// A slice, and the share that it has in what lies between it and the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SliceShare {
    pub(super) slice: u32,
    pub(super) share: f64,
}

/// The smallest step, or the middle one if that would multiply the slices by more than 16.
fn finest_step(places: &[Place]) -> f64 {
    let pairs = places.windows(2);
    let mut steps: Vec<f64> = pairs.map(|p| p[1].depth - p[0].depth).collect();
    steps.sort_by(f64::total_cmp);
    let span = places.last().map_or(0.0, |p| p.depth);
    let most = 16.0 * places.len() as f64;
    match steps.first() {
        Some(&least) if span / least <= most => least,
        _ => steps.get(steps.len() / 2).copied().unwrap_or(1.0),
    }
}

impl Grid {
    /// A grid that holds all slices, with the finest step between them.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if it would be far larger than the slices are.
    pub(crate) fn over(path: &Path, slices: SlicePlaces, fill: f64) -> Result<Grid> {
        let SlicePlaces {
            mut placement,
            places,
            lean,
            size,
        } = slices;
        let span = places.last().map_or(0.0, |p| p.depth);
        let count = (span / finest_step(&places)).round().max(1.0);
        let step = span / count;
        // of the last row
        let leaning = [lean * f64::from(size[1] - 1), 0.0];
        let ends = [0, 1].map(|a| {
            let shifts = places.iter().map(|p| p.aside[a]);
            let low = shifts.clone().fold(0.0, f64::min) + leaning[a].min(0.0);
            let high = shifts.fold(0.0, f64::max) + leaning[a].max(0.0);
            // a shift by rounding does not make the grid larger
            let slack = 0.01;
            (
                (low + slack).floor().min(0.0),
                (high - slack).ceil().max(0.0),
            )
        });
        let wide = [0, 1].map(|a| f64::from(size[a]) + ends[a].1 - ends[a].0);
        let all = [wide[0], wide[1], count + 1.0];
        let far = (0..2).any(|a| wide[a] > 4.0 * f64::from(size[a]));
        if far || all.iter().any(|n| n.is_nan() || *n > f64::from(MAX_DIM)) {
            let what = format!(
                "a regular grid of {:.0} x {:.0} x {:.0} voxels",
                all[0], all[1], all[2]
            );
            let hint = "the slices lie too far aside of each other, or too close together";
            return Err(Error::unsupported(path, what, hint));
        }
        let start = ends.map(|(low, _)| low);
        placement.origin = placement.world([start[0], start[1], 0.0]);
        placement.spacing[2] = step;
        Ok(Grid {
            size: all.map(|n| n as u32),
            placement,
            fill,
            places,
            lean,
            start,
            step,
        })
    }

    /// A grid at right angles for a volume with other axes: its x is that of the volume, its y lies in the plane of
    /// the volume's slices, which stay slices.
    ///
    /// # Errors
    /// As [`Grid::over`], and [`Error::Unsupported`] if the axes lie in one plane.
    pub(crate) fn upright(path: &Path, place: Placement, dims: Dims, fill: f64) -> Result<Grid> {
        let [x, y, z] = [0, 1, 2].map(|a| DVec3::from(place.directions[a]) * place.spacing[a]);
        let along = x.normalize_or_zero();
        let across = (y - along * along.dot(y)).normalize_or_zero();
        let normal = along.cross(across);
        // a mirrored volume stays so
        let normal = if normal.dot(z) < 0.0 { -normal } else { normal };
        let spacing = [x.length(), across.dot(y), normal.dot(z)].map(short);
        if !spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
            let hint = "resample it to axes at right angles";
            return Err(Error::unsupported(
                path,
                "a grid whose axes lie in one plane",
                hint,
            ));
        }
        let [nx, ny, nz] = dims.0;
        let places = (0..nz).map(|k| {
            let k = f64::from(k);
            Place {
                depth: k * spacing[2],
                aside: [
                    k * along.dot(z) / spacing[0],
                    k * across.dot(z) / spacing[1],
                ],
            }
        });
        let slices = SlicePlaces {
            placement: Placement {
                spacing,
                // adding 0 turns -0 into 0
                directions: [along, across, normal].map(|axis| (axis + DVec3::ZERO).into()),
                ..place
            },
            places: places.collect(),
            lean: along.dot(y) / spacing[0],
            size: [nx, ny],
        };
        let mut grid = Grid::over(path, slices, fill)?;
        grid.placement.spacing[2] = spacing[2];
        Ok(grid)
    }

    /// What to say of it, and why there is one.
    pub(crate) fn note(&self, why: &str) -> String {
        let [x, y, z] = self.size;
        let fill = match self.fill.is_nan() {
            true => "no value (NaN), which histogram and thresholds by rule leave out, but porosity counts as below".to_owned(),
            false => format!(
                "{}, which histogram and thresholds by rule leave out, but porosity does not",
                self.fill
            ),
        };
        format!(
            "interpolated to {x} x {y} x {z} voxels, since {why}; what lies outside of the slices is {fill}"
        )
    }

    pub(crate) fn dims(&self) -> Result<Dims> {
        Dims::new(self.size.map(u64::from))
    }

    /// The two slices that slice `k` of the grid lies between, with their shares.
    pub(super) fn between(&self, k: u32) -> [SliceShare; 2] {
        let depth = f64::from(k) * self.step;
        let after = self.places.partition_point(|p| p.depth <= depth);
        let low = after.clamp(1, self.places.len() - 1) - 1;
        let [a, b] = [self.places[low], self.places[low + 1]];
        let part = ((depth - a.depth) / (b.depth - a.depth)).clamp(0.0, 1.0);
        // a slice of the grid that is one of the volume's but for rounding
        let part = match part {
            p if p < 1e-9 => 0.0,
            p if p > 1.0 - 1e-9 => 1.0,
            p => p,
        };
        [(low, 1.0 - part), (low + 1, part)].map(|(slice, share)| SliceShare {
            slice: slice as u32,
            share,
        })
    }

    /// The slices that these slices of the grid lie between.
    pub(super) fn slices(&self, z: Range<u32>) -> Range<u32> {
        let end = |k: u32| self.between(k.min(self.size[2] - 1));
        let used = |all: [SliceShare; 2]| {
            let all = all.into_iter().filter(|of| of.share > 0.0);
            all.map(|of| of.slice)
        };
        let first = used(end(z.start)).min();
        let last = used(end(z.end.max(1) - 1)).max();
        match z.is_empty() {
            true => 0..0,
            false => first.unwrap_or(0)..last.unwrap_or(0) + 1,
        }
    }
}

/// The decimal of few digits that a length is but for the noise of single precision, in which files state axes.
fn short(length: f64) -> f64 {
    let decimals = (0..6).map(|digits| format!("{length:.digits$e}").parse().unwrap_or(length));
    let mut near = decimals.filter(|near: &f64| (near - length).abs() <= 1e-7 * length.abs());
    near.next().unwrap_or(length)
}
