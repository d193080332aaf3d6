//! Normals compared with the volume's gradient.
//!
//! A normal points from above to below, against the gradient: central differences, one-sided ones at the
//! volume's faces, interpolated between the ends of the vertex's lattice edge. Where that vanishes or is no
//! number, and on caps' vertices outside the volume, it points along the edge.

use super::against::{Count, Mesh, Rule, View};
use super::code::Code;
use super::piece::{Flaw, position};
use super::walls::{Crossed, Crossing};
use crate::volume::Voxel;

/// How far a unit normal may be from the gradient's: those of 8 bits are up to 0.9 degrees off, and stay
/// so in tiles of floats that were made of such.
const ROUNDED: f64 = 0.02;
/// The error of a direction whose gradient was added up in 32 bits, in parts of the larger gradient.
const PRECISION: f64 = 2e-6;
/// Gradients beyond these need not have a direction in 32 bits.
const LARGEST: f64 = 1e37;
const SMALLEST: f64 = 1e-36;

/// Compares the normals of a tile whose vertices are all where they belong.
pub(super) fn normals<T: Voxel>(view: &View<T>, mesh: &Mesh, rule: &Rule, flaws: &mut Vec<Flaw>) {
    let mut odd = Count::new(Code::NormalDiffers);
    for ((&p, &state), &found) in mesh.points.iter().zip(&mesh.state).zip(&mesh.normals) {
        let axis = usize::from(state & 3);
        let low_is_above = mesh.bits[mesh.block.index(p)] == 1;
        let step = f64::from(view.step(p, axis, rule)) / 256.0;
        let Some((expected, slack)) = expected(view, p, axis, step, low_is_above) else {
            continue;
        };
        let found = found.map(f64::from);
        let length = found.iter().map(|c| c * c).sum::<f64>().sqrt();
        // one that is not of unit length has been reported
        if !(0.9..1.1).contains(&length) {
            continue;
        }
        let off = (0..3)
            .map(|a| found[a] / length - expected[a])
            .map(|d| d * d)
            .sum::<f64>();
        if off.sqrt() > slack {
            odd.add(p);
        }
    }
    flaws.extend(Some(odd.0).filter(|f| f.count > 0));
}

/// The unit normal of the vertex that is `step` of a voxel along its lattice edge, and how far another one
/// may be from it; `None` if rounding may have turned it anywhere.
fn expected<T: Voxel>(
    view: &View<T>,
    p: [i32; 3],
    axis: usize,
    step: f64,
    low_is_above: bool,
) -> Option<([f64; 3], f64)> {
    let low = p.map(|c| c >> 8);
    let mut high = low;
    high[axis] += 1;
    let mut along = [0.0; 3];
    along[axis] = if low_is_above { 1.0 } else { -1.0 };
    let (Some(g0), Some(g1)) = (gradient(view, low), gradient(view, high)) else {
        return Some((along, ROUNDED));
    };
    let n: [f64; 3] = std::array::from_fn(|a| -(g0[a] + (g1[a] - g0[a]) * step));
    if !n.iter().all(|c| c.is_finite()) {
        return Some((along, ROUNDED));
    }
    let largest = g0.iter().chain(&g1).fold(0f64, |l, c| l.max(c.abs()));
    let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
    if largest == 0.0 {
        return Some((along, ROUNDED));
    }
    let slack = ROUNDED + PRECISION * largest / length;
    let decided = (SMALLEST..LARGEST).contains(&largest) && slack < 1.0;
    decided.then(|| (n.map(|c| c / length), slack))
}

/// The samples where a line crosses the surface; no numbers where they lie outside the volume.
pub(super) fn crossed<T: Voxel>(view: &View<T>, at: &Crossing) -> Crossed {
    let axis = at.axis();
    let low = position(at.point).map(|c| c >> 8);
    let mut high = low;
    high[axis] += 1;
    Crossed {
        gradients: [low, high].map(|v| gradient(view, v).unwrap_or([f64::NAN; 3])),
        values: [low, high].map(|v| view.sample(v).unwrap_or(f64::NAN)),
        place: f64::from(at.point[axis] & 255) / 256.0,
    }
}

/// The gradient at a voxel; `None` outside the volume.
fn gradient<T: Voxel>(view: &View<T>, v: [i32; 3]) -> Option<[f64; 3]> {
    let own = view.sample(v)?;
    Some(std::array::from_fn(|a| {
        let neighbour = |step: i32| {
            let mut at = v;
            at[a] += step;
            view.sample(at)
        };
        match (neighbour(-1), neighbour(1)) {
            (Some(before), Some(after)) => (after - before) / 2.0,
            (Some(before), None) => own - before,
            (None, Some(after)) => after - own,
            (None, None) => 0.0,
        }
    }))
}
