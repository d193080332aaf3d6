//! The order of slices in space, and whether they make a regular grid.

use super::frame::Frame;
use crate::error::{Error, Result};
use crate::grid::Placement;
use crate::grid::Unit;
use glam::DVec3;
use std::path::Path;

/// Slices may lie this far from their place in a regular grid, in steps of slices. Files give
/// positions with few decimals: a step of 0.625 mm as 0.6 and 0.7 is off by 0.08 steps.
const MAX_OFF: f64 = 0.1;
/// And this far aside, in pixels.
const MAX_ASIDE: f64 = 0.2;

/// Frames in order and where they lie.
#[derive(Debug)]
pub(super) struct Stack {
    pub(super) frames: Vec<Frame>,
    /// Place of the first frame; the spacing's z is the mean step.
    pub(super) placement: Placement,
    /// For each frame its distance from the first along the normal, in millimetres, and how far its
    /// first pixel lies aside of the first frame's, in pixels along x and y.
    pub(super) places: Vec<Place>,
}

/// Where a frame lies relative to the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub(super) depth: f64,
    pub(super) aside: [f64; 2],
}

/// Orders frames of one size and orientation along their normal.
///
/// # Errors
/// [`Error::Unsupported`] if two lie at one place, [`Error::Format`] if pixels have no size.
pub(super) fn stack(path: &Path, frames: Vec<Frame>) -> Result<Stack> {
    let mut placed = Vec::with_capacity(frames.len());
    for frame in frames {
        let (Some(plane), Some(pixel)) = (frame.plane, frame.pixel) else {
            let found = "a DICOM series without positions or sizes of pixels";
            let expected = "ImagePositionPatient, ImageOrientationPatient and PixelSpacing";
            return Err(Error::format(path, found, expected)
                .with_hint("the order of its slices is unknown: convert it to TIFF or NRRD"));
        };
        placed.push((frame, plane, pixel));
    }
    let Some(&(_, plane, pixel)) = placed.first() else {
        return Err(Error::format(path, "a series without slices", "slices"));
    };
    let [row, column] = plane.axes.map(DVec3::from);
    let normal = row.cross(column);
    let depth = |plane: &super::frame::Plane| normal.dot(plane.position.into());
    placed.sort_by(|a, b| {
        let order = depth(&a.1).total_cmp(&depth(&b.1));
        order.then((a.0.file, a.0.index).cmp(&(b.0.file, b.0.index)))
    });
    let origin = DVec3::from(placed[0].1.position);
    let places: Vec<Place> = placed
        .iter()
        .map(|(_, plane, _)| {
            let shift = DVec3::from(plane.position) - origin;
            Place {
                depth: normal.dot(shift),
                aside: [row.dot(shift) / pixel[0], column.dot(shift) / pixel[1]],
            }
        })
        .collect();
    let span = places.last().map_or(0.0, |p| p.depth);
    let step = span / (places.len().max(2) - 1) as f64;
    let together = places
        .windows(2)
        .position(|p| p[1].depth - p[0].depth <= 1e-3 * step.max(1e-6));
    if let Some(k) = together {
        let what = format!(
            "a DICOM series with two slices at one place, {:?} mm,",
            placed[k].1.position
        );
        let hint = "it holds several times, echoes or reconstructions: put the files of one into a \
                    folder of their own";
        return Err(Error::unsupported(path, what, hint));
    }
    let placement = Placement {
        spacing: [pixel[0], pixel[1], step],
        unit: Unit::Millimetre,
        origin: origin.into(),
        // adding 0 turns -0 into 0
        directions: [row, column, normal].map(|axis| (axis + DVec3::ZERO).into()),
    };
    Ok(Stack {
        frames: placed.into_iter().map(|(frame, ..)| frame).collect(),
        placement,
        places,
    })
}

impl Stack {
    /// What keeps the slices from being a regular grid, with its numbers; `None` if nothing does.
    pub(super) fn irregular(&self) -> Option<String> {
        let [sx, sy, step] = self.placement.spacing;
        let off = |(k, p): (usize, &Place)| (p.depth - k as f64 * step).abs();
        let uneven = self.places.iter().enumerate().map(off).fold(0.0, f64::max) > MAX_OFF * step;
        let aside = |p: &Place| p.aside[0].abs().max(p.aside[1].abs());
        let sheared = self.places.iter().map(aside).fold(0.0, f64::max) > MAX_ASIDE;
        let mut parts = Vec::new();
        if uneven {
            parts.push(self.uneven());
        }
        if sheared {
            let last = self
                .places
                .iter()
                .max_by(|a, b| aside(a).total_cmp(&aside(b)));
            let [u, v] = last.map_or([0.0; 2], |p| [p.aside[0] * sx, p.aside[1] * sy]);
            let depth = last.map_or(1.0, |p| p.depth);
            let angle = libm::atan2(libm::hypot(u, v), depth).to_degrees();
            parts.push(format!(
                "slices shifted sideways by up to {:.2} mm (a gantry tilt of {angle:.1} degrees)",
                libm::hypot(u, v)
            ));
        }
        (!parts.is_empty()).then(|| parts.join(" and "))
    }

    fn steps(&self) -> Vec<f64> {
        let pairs = self.places.windows(2);
        pairs.map(|p| p[1].depth - p[0].depth).collect()
    }

    fn uneven(&self) -> String {
        let steps = self.steps();
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
        let middle = sorted[(sorted.len() - 1) / 2];
        let near = |s: f64| (s - middle).abs() <= MAX_OFF * middle;
        let times = |s: f64| {
            let n = (s / middle).round();
            n >= 1.0 && (s - n * middle).abs() <= MAX_OFF * middle
        };
        let gaps: Vec<usize> = (0..steps.len()).filter(|&i| !near(steps[i])).collect();
        if let Some(&first) = gaps.first()
            && steps.iter().all(|&s| times(s))
        {
            let lost: f64 = gaps
                .iter()
                .map(|&i| (steps[i] / middle).round() - 1.0)
                .sum();
            let plural = if lost == 1.0 { "" } else { "s" };
            return format!(
                "{lost} missing slice{plural}, the first after slice {} (steps of {middle:.3} mm, \
                 there {:.3})",
                first + 1,
                steps[first]
            );
        }
        format!("uneven steps between slices, from {least:.3} to {most:.3} mm")
    }

    /// The smallest step, or the middle one if that would multiply the slices by more than 16.
    pub(super) fn finest_step(&self) -> f64 {
        let mut steps = self.steps();
        steps.sort_by(f64::total_cmp);
        let span = self.places.last().map_or(0.0, |p| p.depth);
        let most = 16.0 * self.places.len() as f64;
        match steps.first() {
            Some(&least) if span / least <= most => least,
            _ => steps.get(steps.len() / 2).copied().unwrap_or(1.0),
        }
    }
}
