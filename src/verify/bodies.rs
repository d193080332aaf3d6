//! Cells and objects as bodies of voxels, from the sums over their surfaces alone.
//!
//! What vertices do not say is whether a body holds the far corner of the volume, see [`super::rim`]. With
//! it, a body has as many voxels more as the whole volume has, so one of the two numbers is from 1 to that.

use super::inside::{Moments, Span};
use super::piece::Sums;
use crate::grid::{Extent, Placement};

/// A body.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Body {
    /// Its voxels and their moments.
    pub moments: Moments,
    /// The box of its voxels.
    pub span: Span,
    /// How far they reach along the axes of the world, if these are not the grid's.
    pub far: Extent,
    /// True if it has a voxel on one of the volume's faces, or the edge of a region of interest cuts it.
    pub touches: bool,
    /// Its Euler characteristic.
    pub euler: f64,
    /// Its first voxel, by z, then y, then x, see [`super::first::voxel_key`].
    pub first: u64,
}

impl Body {
    /// The cell, or the object, that all its surfaces are summed up of, in a volume of this size. `None` if
    /// they bound none: some are missing. `rotated` is where the grid lies, if its axes are not those of the
    /// world.
    pub fn of(
        sums: &Sums,
        cell: bool,
        dims: [u32; 3],
        rotated: Option<&Placement>,
    ) -> Option<Self> {
        let inside = &sums.inside;
        let rim = inside.rim.seen_by(cell);
        let all: i128 = dims.map(i128::from).iter().product();
        let moments = |far| inside.moments(cell, rim.far_face(far, dims), dims[0]);
        let far = !(1..=all).contains(&moments(false).voxels);
        let moments = moments(far);
        if !(1..=all).contains(&moments.voxels) {
            return None;
        }
        let corners = rim.corners(far)?;
        // along each axis of either kind, one of the outermost voxels touches a vertex or a corner of the volume
        let mut span = if cell { inside.below } else { inside.above };
        let mut far_ends = inside.far[usize::from(!cell)];
        for corner in (0..8usize).filter(|c| corners >> c & 1 == 1) {
            let voxel: [u16; 3] =
                std::array::from_fn(|a| ((dims[a] - 1) as usize * (corner >> a & 1)) as u16);
            span.add(&Span {
                lo: voxel,
                hi: voxel,
            });
            if let Some(place) = rotated {
                far_ends.add(place.step(voxel.map(f64::from)));
            }
        }
        let reaches = |a: usize| span.lo[a] == 0 || u32::from(span.hi[a]) + 1 == dims[a];
        // the surfaces, closed by the part of the volume's faces that the body covers, bound it
        let covered = (rim.turns + i64::from(corners.count_ones())) as f64 / 4.0;
        let first = if cell {
            inside.first.below
        } else {
            inside.first.above
        };
        Some(Body {
            moments,
            span,
            far: far_ends,
            touches: (0..3).any(reaches),
            euler: (euler_of(sums) as f64 + covered) / 2.0,
            first: if corners & 1 == 1 { 0 } else { first },
        })
    }
}

/// Vertices - edges + triangles.
pub(super) fn euler_of(sums: &Sums) -> i64 {
    sums.vertices as i64 - (sums.edges + sums.border) as i64 + sums.triangles as i64
}

#[cfg(test)]
mod tests {
    use super::super::first::voxel_key;
    use super::super::inside::Inside;
    use super::super::marks::code;
    use super::super::piece::{DOWN, Region, UP};
    use super::*;
    use proptest::prelude::*;

    /// Moments, box and first voxel of a set of voxels, one by one.
    fn plain(voxels: &[[u16; 3]]) -> (Moments, Span, u64) {
        let (mut m, mut span) = (Moments::default(), Span::default());
        for v in voxels {
            let [x, y, z] = v.map(i128::from);
            m.voxels += 1;
            for (sum, value) in m.first.iter_mut().zip([x, y, z]) {
                *sum += value;
            }
            let squares = [x * x, y * y, z * z, x * y, x * z, y * z];
            for (sum, value) in m.second.iter_mut().zip(squares) {
                *sum += value;
            }
            span.add(&Span { lo: *v, hi: *v });
        }
        let key = |v: &[u16; 3]| voxel_key(v.map(i32::from));
        (m, span, voxels.iter().map(key).min().unwrap_or(0))
    }

    proptest! {
        /// Cells and objects of any two phases: all of each phase taken for one body, which the sums over
        /// vertices alone give back, wherever they meet the volume's faces.
        #[test]
        fn vertices_alone_give_bodies_back(
            dims in prop::array::uniform3(2..5u32),
            above in prop::collection::vec(any::<bool>(), 125),
            most in 0..4u8,
        ) {
            let n = dims.map(|d| d as usize);
            let at = |[x, y, z]: [usize; 3]| x + n[0] * (y + n[1] * z);
            // mostly one phase, so that bodies hold all corners or none as well
            let is_above = |v: [usize; 3]| match most {
                0 => above[at(v)] && above[124 - at(v)],
                1 => above[at(v)] || above[124 - at(v)],
                _ => above[at(v)],
            };
            let region = Region {
                lo: [0; 3],
                hi: dims.map(|d| (d as i32 - 1) * 256),
                end: dims.map(|d| (d as i32 - 1) * 256),
            };
            let (mut points, mut state, mut phases) = (Vec::new(), Vec::new(), [Vec::new(), Vec::new()]);
            for z in 0..n[2] {
                for y in 0..n[1] {
                    for x in 0..n[0] {
                        let low = [x, y, z];
                        phases[usize::from(is_above(low))].push(low.map(|c| c as u16));
                        for axis in 0..3 {
                            let along: [i32; 3] = std::array::from_fn(|a| i32::from(a == axis));
                            let high: [usize; 3] = std::array::from_fn(|a| low[a] + along[a] as usize);
                            if high[axis] < n[axis] && is_above(low) != is_above(high) {
                                let v = low.map(|c| c as i32);
                                let p: [i32; 3] = std::array::from_fn(|a| v[a] * 256 + 100 * along[a]);
                                points.push([p[0], p[1], p[2], code(v, along)]);
                                state.push(axis as u8 | if is_above(high) { DOWN } else { UP });
                            }
                        }
                    }
                }
            }
            let sums = Sums {
                inside: Inside::of_vertices(&points, &state, &region),
                ..Sums::default()
            };
            for cell in [true, false] {
                let voxels = &phases[usize::from(!cell)];
                if voxels.is_empty() {
                    continue;
                }
                let body = Body::of(&sums, cell, dims, None).expect("a body");
                let (moments, span, first) = plain(voxels);
                prop_assert_eq!(&body.moments, &moments);
                prop_assert_eq!(body.span, span);
                prop_assert_eq!(body.first, first);
            }
        }
    }
}
