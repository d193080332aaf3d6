//! How the surface lies to the axis of a line that crosses it.

use super::chords::WallScale;

/// Further from the gradient than a normal is said to be by no tile: those of 8 bits are 0.9 degrees off.
const ROUNDED: f64 = 0.02;
/// Error of a direction of which nothing is rounded to less than 32 bits, and of one whose gradient was added up in these,
/// in parts of the larger gradient.
const EXACT: f64 = 1e-6;
const PRECISION: f64 = 2e-6;
/// Gradients beyond these need not have a direction in 32 bits.
const LARGEST: f64 = 1e37;
const SMALLEST: f64 = 1e-36;
/// Cosines are written in steps of this.
const COSINE_STEP: f64 = 1.0 / 65_536.0;
/// The least cosine to an axis of a direction of which no other component is greater, less what is rounded.
const LEAST: f64 = 0.577;
/// The greatest part that central differences miss.
const MOST_MISSED: f64 = 0.5;

/// Something that holds, or does not, or of which that is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::verify) enum Known {
    No,
    Maybe,
    Yes,
}

/// How the surface lies to the axis of a line.
#[derive(Debug, Clone, Copy)]
pub(in crate::verify) struct Slant {
    /// The least and the greatest that the cosine of the normal to the axis may be.
    pub cosine: [f64; 2],
    /// No other component of the gradient is greater.
    pub faces: Known,
}

/// Samples where the surface crosses a lattice edge.
#[derive(Debug, Clone, Copy)]
pub(in crate::verify) struct Crossed {
    /// Gradients at the lower and the upper end, in steps of a voxel.
    pub gradients: [[f64; 3]; 2],
    /// Samples at both.
    pub values: [f64; 2],
    /// Where between them the vertex is, 0 to 1.
    pub place: f64,
}

impl Slant {
    fn along(faces: Known) -> Self {
        Slant {
            cosine: [1.0; 2],
            faces,
        }
    }

    fn unknown() -> Self {
        Slant {
            cosine: [LEAST, 1.0],
            faces: Known::Maybe,
        }
    }
}

/// If no component but that along `axis` is greater; `error` is what each of them may be off.
fn faces(parts: [f64; 3], axis: usize, error: [f64; 3]) -> Known {
    let others = (0..3).filter(|&a| a != axis);
    others.fold(Known::Yes, |known, a| {
        let (ahead, off) = (parts[a] - parts[axis], error[a] + error[axis]);
        known.min(match () {
            () if ahead > off => Known::No,
            () if ahead > -off => Known::Maybe,
            () => Known::Yes,
        })
    })
}

/// By a normal in tiles, which is of unit length in steps of a voxel, as the gradient has them.
pub(super) fn by_normal(normal: [f32; 3], axis: usize, scale: &WallScale) -> Slant {
    let own = normal.map(|c| f64::from(c).abs());
    let over = scale.finest_over;
    let parts = std::array::from_fn(|a| own[a] * over[a]);
    let faces = faces(parts, axis, over.map(|over| ROUNDED * over));
    if faces == Known::No {
        return Slant::along(faces);
    }
    // of each other component by that along the axis, which it does not exceed in space
    let ratio = |a: usize, way: f64| {
        let off = way * ROUNDED;
        let ratio = (own[a] + off) / (own[axis] - off).max(f64::MIN_POSITIVE);
        ratio.clamp(0.0, over[axis] / over[a])
    };
    let [least, greatest] = [-1.0, 1.0].map(|way| std::array::from_fn(|a| ratio(a, way)));
    if (0..3).any(|a| a != axis && greatest[a] > 1.0) {
        // of voxels that are longer along another axis the bounds below need not hold
        return Slant {
            faces,
            ..Slant::unknown()
        };
    }
    let ends = [-MOST_MISSED, MOST_MISSED];
    let all = |ratios: [f64; 3]| ends.map(|missed| cosine(ratios, missed, axis, scale));
    let [a, b] = all(greatest);
    let [c, d] = all(least);
    Slant {
        cosine: widened(a.min(b), c.max(d)),
        faces,
    }
}

/// By the samples of the volume.
pub(in crate::verify) fn by_samples(at: &Crossed, axis: usize, scale: &WallScale) -> Slant {
    let [g, h] = at.gradients;
    let own: [f64; 3] = std::array::from_fn(|a| g[a] + (h[a] - g[a]) * at.place);
    let parts: [f64; 3] = std::array::from_fn(|a| (own[a] * scale.finest_over[a]).abs());
    let length = parts.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest = g.iter().chain(&h).fold(0f64, |l, c| l.max(c.abs()));
    if largest == 0.0 || largest.is_nan() || !length.is_finite() {
        // as the mesh has it where there is no gradient: along the edge
        return Slant::along(Known::Yes);
    }
    let error = EXACT + PRECISION * largest / length;
    if !(SMALLEST..LARGEST).contains(&largest) || error > ROUNDED {
        return Slant::unknown();
    }
    let faces = faces(parts.map(|v| v / length), axis, [error; 3]);
    if faces == Known::No {
        return Slant::along(faces);
    }
    let ratios = std::array::from_fn(|a| (own[a] / own[axis]).abs());
    let wide = (g[axis] + h[axis]) / 2.0;
    let narrow = at.values[1] - at.values[0];
    let sum = wide + 2.0 * narrow;
    let missed = 2.0 * (wide - narrow) / sum;
    if !missed.is_finite() {
        return Slant {
            faces,
            ..Slant::unknown()
        };
    }
    let off = EXACT + 2.0 * PRECISION * largest / sum.abs();
    let all = [missed - off, missed, missed + off].map(|missed| {
        let missed = missed.clamp(-MOST_MISSED, MOST_MISSED);
        cosine(ratios, missed, axis, scale)
    });
    let least = all.into_iter().fold(1.0, f64::min);
    let greatest = all.into_iter().fold(0.0, f64::max);
    Slant {
        cosine: widened(least - 4.0 * error, greatest + 4.0 * error),
        faces,
    }
}

fn widened(least: f64, greatest: f64) -> [f64; 2] {
    [
        (least - COSINE_STEP).max(LEAST),
        (greatest + COSINE_STEP).min(1.0),
    ]
}

/// The cosine to the axis of a plane whose measured slopes over that along the axis are these, in steps of a voxel, if central
/// differences miss so much of that along the axis: of a component m of the normal, they measure m (F + m^2 f'''/6), and
/// `missed` is m^2 f'''/6F of the axis.
fn cosine(ratios: [f64; 3], missed: f64, axis: usize, scale: &WallScale) -> f64 {
    let own = scale.finest_over[axis];
    let parts: [f64; 3] = std::array::from_fn(|a| {
        let mut ratio = ratios[a];
        for _ in 0..3 {
            ratio = ratios[a] * (1.0 + missed) / (1.0 + missed * ratio * ratio).max(0.5);
        }
        match a == axis {
            true => own,
            false => (ratio * scale.finest_over[a]).min(own),
        }
    });
    own / parts.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What normals tell holds whatever central differences miss.
    #[test]
    fn bounds_by_normals_hold_what_samples_tell() {
        let mut state = 12345u64;
        let mut unit = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        for spacing in [[1.0; 3], [1.0, 1.0, 3.0], [0.5, 0.75, 1.25]] {
            let scale = WallScale::new(spacing);
            let mut faced = 0;
            for _ in 0..20_000 {
                let mut draw = || [unit(), unit(), unit()].map(|v| 200.0 * (v - 0.5));
                let (g, h) = (draw(), draw());
                let at = Crossed {
                    gradients: [g, h],
                    values: [0.0, 300.0 * (unit() - 0.2)],
                    place: (1.0 + (unit() * 254.0).floor()) / 256.0,
                };
                let axis = (unit() * 3.0) as usize;
                let exact = by_samples(&at, axis, &scale);
                let own: [f64; 3] = std::array::from_fn(|a| g[a] + (h[a] - g[a]) * at.place);
                let length = own.iter().map(|v| v * v).sum::<f64>().sqrt();
                let bounds = by_normal(own.map(|v| (v / length) as f32), axis, &scale);
                assert!(
                    exact.faces == Known::Maybe
                        || bounds.faces == Known::Maybe
                        || exact.faces == bounds.faces
                );
                if exact.faces == Known::Yes {
                    faced += 1;
                    assert!(
                        bounds.cosine[0] <= exact.cosine[1] && exact.cosine[0] <= bounds.cosine[1],
                        "{at:?}"
                    );
                    assert!(
                        exact.cosine[1] - exact.cosine[0] < 1e-3 || exact.cosine[0] == LEAST,
                        "{at:?} {exact:?}"
                    );
                }
            }
            assert!(faced > 1000);
        }
    }
}
