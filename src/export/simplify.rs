//! Fewer triangles, without a hole.
//!
//! Every piece of a tile is simplified by itself with meshoptimizer's quadrics, which move no vertex:
//! what is left lies on the lattice as before. That pieces and tiles still meet is made sure by vertices
//! that stay, by a ring of triangles that stays, and by a check of the result.
//!
//! 1. Vertices at an open edge of a piece and vertices of several pieces (a surface and its cap) are
//!    locked. So both sides of a plane between tiles keep the border between them, edge by edge, and so
//!    does the border of the surface at the volume's faces.
//! 2. A chord between two such vertices could come about on both sides at once, and four triangles would
//!    meet there. So of two sides one also locks the neighbours of its border vertices, which keeps the
//!    triangles at them as they are: the tile before the plane, and the cap.
//! 3. The result must be the same surface: with the same open edges, no edge of more than two triangles, no
//!    triangle twice, no two fans of triangles at one vertex, and in each connected part the same Euler
//!    characteristic. Parts that are not are simplified again with the vertices around the faults locked
//!    or, where none can be named, to more triangles; after some tries they are left as they are.

use super::shape::Shape;
use super::sheet::Region;
use crate::error::{Error, Result};
use crate::grid::{LATTICE, Placement, Unit};
use crate::tile::SurfacePiece;
use glam::{DMat3, DVec3};
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify_with_locks, typed_to_bytes};
use std::collections::HashMap;
use std::str::FromStr;

/// Tries in a step before a part is left as it is.
const TRIES: u32 = 8;

/// How far a surface is simplified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Simplify {
    /// To this share of the triangles of each piece, above 0 and at most 1; more stay at the borders of
    /// tiles.
    Ratio(f64),
    /// As far as the error stays below so many voxels (the smallest spacing); above 0.
    Voxels(f64),
    /// As far as the error stays below this length; above 0.
    Length(f64, Unit),
}

impl FromStr for Simplify {
    type Err = Error;

    /// Reads a ratio, as in `0.1` or `10%`, voxels, as in `0.5vx`, or a length, as in `20um`.
    fn from_str(text: &str) -> Result<Self> {
        let bad = || {
            Error::usage(
                "--simplify",
                text,
                "a share of the triangles above 0 and at most 1, as in 0.1, or an error above 0, as in \
                 0.5vx or 20um",
            )
        };
        let text = text.trim();
        let split = text
            .find(|c: char| c.is_alphabetic() && c != 'e' && c != 'E' || c == '%')
            .unwrap_or(text.len());
        let (number, unit) = text.split_at(split);
        let value: f64 = number.trim().parse().map_err(|_| bad())?;
        if !(value.is_finite() && value > 0.0) {
            return Err(bad());
        }
        let found = match unit.trim() {
            "" => Simplify::Ratio(value),
            "%" => Simplify::Ratio(value / 100.0),
            "vx" => Simplify::Voxels(value),
            unit => match unit.parse().map_err(|_| bad())? {
                Unit::Voxel => Simplify::Voxels(value),
                unit => Simplify::Length(value, unit),
            },
        };
        match found {
            Simplify::Ratio(ratio) if ratio > 1.0 => Err(bad()),
            found => Ok(found),
        }
    }
}

/// The same for a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct InGrid {
    /// Share of the triangles to keep.
    ratio: f64,
    /// The largest error in the unit of the set.
    error: f64,
    /// From lattice steps to the unit of the set.
    step: DMat3,
}

impl Simplify {
    /// What is asked for, in the unit of a grid.
    ///
    /// # Errors
    /// [`Error::Usage`] for a value out of range, or a length in a grid without a unit.
    pub(super) fn in_grid(&self, placement: &Placement) -> Result<InGrid> {
        let spacing = placement.spacing;
        let (value, unit) = match *self {
            Simplify::Ratio(ratio) => (ratio, None),
            Simplify::Voxels(voxels) => (voxels, Some(Unit::Voxel)),
            Simplify::Length(length, unit) => (length, Some(unit)),
        };
        let most = if unit.is_none() { 1.0 } else { f64::MAX };
        if !(value > 0.0 && value <= most) {
            return Err(Error::usage(
                "--simplify",
                value.to_string(),
                "a share above 0 and at most 1, or an error above 0",
            ));
        }
        let (ratio, error) = match unit {
            None => (value, f64::INFINITY),
            Some(Unit::Voxel) => (
                0.0,
                value * spacing.into_iter().fold(f64::INFINITY, f64::min),
            ),
            Some(unit) if placement.unit == Unit::Voxel => {
                return Err(Error::usage(
                    "--simplify",
                    format!("a length in {unit}"),
                    "voxels, as in 0.5vx: the size of a voxel is not known",
                ));
            }
            Some(unit) => (0.0, value * unit.metres() / placement.unit.metres()),
        };
        Ok(InGrid {
            ratio,
            error,
            step: DMat3::from_diagonal(DVec3::from(spacing) / f64::from(LATTICE)),
        })
    }
}

/// What simplification did.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Simplified {
    /// The largest error that was estimated, in the unit of the set.
    pub error: f64,
}

/// Simplifies the pieces of a tile; `points` are their vertices in lattice steps.
pub(super) fn pieces(
    pieces: &mut [SurfacePiece],
    points: &[Vec<[i32; 3]>],
    region: &Region,
    how: &InGrid,
) -> Simplified {
    let shared = shared(pieces, points);
    let mut all = Simplified::default();
    for (piece, points) in pieces.iter_mut().zip(points) {
        let locks = locks(piece, points, region, &shared);
        let one = simplify(piece, points, &locks, how);
        all.error = all.error.max(one.error);
    }
    all
}

/// Vertices of several pieces.
fn shared(pieces: &[SurfacePiece], points: &[Vec<[i32; 3]>]) -> HashMap<[i32; 3], bool> {
    let mut seen: HashMap<[i32; 3], bool> = HashMap::new();
    // only caps share vertices with other pieces
    let caps = pieces.iter().zip(points).filter(|(p, _)| p.is_cap());
    seen.extend(caps.flat_map(|(_, points)| points.iter().map(|p| (*p, false))));
    if seen.is_empty() {
        return seen;
    }
    let others = pieces.iter().zip(points).filter(|(p, _)| !p.is_cap());
    for p in others.flat_map(|(_, points)| points) {
        if let Some(shared) = seen.get_mut(p) {
            *shared = true;
        }
    }
    seen.retain(|_, shared| *shared);
    seen
}

/// Vertices of a piece that stay.
fn locks(
    piece: &SurfacePiece,
    points: &[[i32; 3]],
    region: &Region,
    shared: &HashMap<[i32; 3], bool>,
) -> Vec<bool> {
    let with_others: Vec<bool> = points.iter().map(|p| shared.contains_key(p)).collect();
    let with_ring = |i: u32| {
        let i = i as usize;
        region.on_upper(points[i]) || piece.is_cap() && with_others[i]
    };
    let mut locked: Vec<bool> = points
        .iter()
        .zip(&with_others)
        .map(|(&p, &other)| other || region.on_lower(p) || region.on_upper(p))
        .collect();
    for t in &piece.triangles {
        if t.iter().any(|&i| with_ring(i)) {
            t.iter().for_each(|&i| locked[i as usize] = true);
        }
    }
    locked
}

/// Simplifies one piece, by steps to half the triangles: what fails in a step is then small.
fn simplify(
    piece: &mut SurfacePiece,
    points: &[[i32; 3]],
    locks: &[bool],
    how: &InGrid,
) -> Simplified {
    let mut done = Simplified::default();
    let Some(&origin) = points.first() else {
        return done;
    };
    // near 0, where floats are fine enough
    let place = |p: &[i32; 3]| -> [f32; 3] {
        let local: [f64; 3] = std::array::from_fn(|a| f64::from(p[a] - origin[a]));
        (how.step * DVec3::from(local)).as_vec3().into()
    };
    let positions: Vec<[f32; 3]> = points.iter().map(place).collect();
    // triangles at two locked vertices stay
    let fixed = |t: &&[u32; 3]| t.iter().filter(|&&v| locks[v as usize]).count() >= 2;
    let fixed = piece.triangles.iter().filter(fixed).count();
    let free = piece.triangles.len() - fixed;
    let goal = fixed + (free as f64 * how.ratio).ceil() as usize;
    loop {
        let now = piece.triangles.len();
        let step = Step {
            target: goal.max(fixed + (now - fixed.min(now)) / 2),
            error: how.error - done.error,
        };
        if now <= goal || step.error <= 0.0 {
            return done;
        }
        let Some((fewer, error)) = step.run(&piece.triangles, &positions, locks) else {
            return done;
        };
        let won = now - fewer.len();
        piece.triangles = fewer;
        // errors of one step after another add up at worst
        done.error += error;
        if won < now / 64 + 1 {
            return done;
        }
    }
}

/// A step of simplification.
struct Step {
    /// Triangles to reach.
    target: usize,
    /// The largest error in the unit of the set.
    error: f64,
}

impl Step {
    /// Simplifies all connected parts together, and those that fail the check again, with the vertices
    /// around the faults locked. `None` if the triangles are no surface to begin with.
    fn run(
        &self,
        triangles: &[[u32; 3]],
        positions: &[[f32; 3]],
        locks: &[bool],
    ) -> Option<(Vec<[u32; 3]>, f64)> {
        let shape = Shape::new(positions.len(), triangles)?;
        let mut share = self.target as f64 / triangles.len() as f64;
        let mut locks = locks.to_vec();
        let mut alive = vec![true; shape.count()];
        let mut left = triangles.to_vec();
        let mut kept = Vec::new();
        let mut largest = 0.0f64;
        for _ in 0..TRIES {
            let target = (left.len() as f64 * share).ceil() as usize;
            let (fewer, error) = self.collapse(&left, positions, &locks, target)?;
            let faults = shape.faults(&fewer, &alive);
            let again = |t: &[u32; 3]| faults.parts[shape.part(*t)];
            let before = kept.len();
            kept.extend(fewer.iter().filter(|t| !again(t)));
            if kept.len() > before {
                largest = largest.max(error);
            }
            left.retain(again);
            if left.is_empty() {
                break;
            }
            shape.lock_around(&faults, &fewer, &mut locks);
            if faults.unplaced {
                share = (share + 1.0) / 2.0;
            }
            alive = faults.parts;
        }
        kept.extend(left);
        Some((kept, largest))
    }

    /// Triangles of the same vertices, `target` of them if locks and the error permit, and the error.
    fn collapse(
        &self,
        triangles: &[[u32; 3]],
        positions: &[[f32; 3]],
        locks: &[bool],
        target: usize,
    ) -> Option<(Vec<[u32; 3]>, f64)> {
        let bytes = typed_to_bytes(positions);
        let vertices = VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0).ok()?;
        let mut error = 0.0;
        let fewer = simplify_with_locks(
            triangles.as_flattened(),
            &vertices,
            locks,
            3 * target,
            self.error.min(f64::from(f32::MAX)) as f32,
            SimplifyOptions::ErrorAbsolute | SimplifyOptions::LockBorder | SimplifyOptions::Sparse,
            Some(&mut error),
        );
        Some((fewer.as_chunks::<3>().0.to_vec(), f64::from(error)))
    }
}
