//! How the surface lies to the axis of a line that crosses it.

use super::chords::WallScale;

/// Further from the gradient than a normal is said to be by no tile: those of 8 bits are 0.9 degrees off.
const ROUNDED: f64 = 0.02;
/// Error of a direction of which nothing is rounded to less than 32 bits, and of one whose gradient was added up in these,
/// in parts of the larger gradient.
const EXACT: f64 = 1e-6;
const PRECISION: f64 = 2e-6;
/// The corners of bounds of two numbers, and their middle.
const CORNERS: usize = 5;
/// Gradients beyond these need not have a direction in 32 bits.
const LARGEST: f64 = 1e37;
const SMALLEST: f64 = 1e-36;
/// Cosines and shares are written in steps of this.
const STEP: f64 = 1.0 / 65_536.0;
/// An axis has no share of a wall if the square of the normal's component along it is not above this, and at less than half
/// of it no slopes over the axis are looked at.
const LEAST_SQUARE: f64 = 0.1;
/// The cosine of that, less what is rounded.
pub(super) const LEAST: f64 = 0.316;
/// The greatest part of a difference along the normal that central differences miss.
const MOST_MISSED: f64 = 0.5;
/// Of voxels so much longer along one axis, a step of what is missed may go anywhere: that part times the square of slopes.
const TOO_FAR: f64 = 0.6;
/// How far cosines and shares between those of the corners of bounds may be beyond these.
const BETWEEN: [f64; 2] = [0.03, 0.06];
/// How much more than gradients cosines and shares may be off, and where what is missed goes far.
const GROWN: [f64; 2] = [20.0, 40.0];
const GROWN_FAR: [f64; 2] = [500.0, 1000.0];

/// How the surface lies to the axis of a line: the least and the greatest that each may be.
#[derive(Debug, Clone, Copy)]
pub(in crate::verify) struct Slant {
    /// The cosine of the normal to the axis.
    pub cosine: [f64; 2],
    /// The share that the axis has of a wall there; 0 for none.
    pub share: [f64; 2],
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
    fn none() -> Self {
        Slant {
            cosine: [LEAST; 2],
            share: [0.0; 2],
        }
    }

    fn along() -> Self {
        Slant {
            cosine: [1.0; 2],
            share: [1.0; 2],
        }
    }

    fn unknown() -> Self {
        Slant {
            cosine: [LEAST, 1.0],
            share: [0.0, 1.0],
        }
    }

    /// Around some, which may be off by so much.
    fn around(all: &[Lean], off: [f64; 2]) -> Self {
        let (mut cosine, mut share) = ([1.0f64, 0.0], [1.0f64, 0.0]);
        for lean in all {
            cosine = [cosine[0].min(lean.cosine), cosine[1].max(lean.cosine)];
            share = [share[0].min(lean.share), share[1].max(lean.share)];
        }
        let [of_cosine, of_share] = off.map(|off| off + STEP);
        let low = share[0] - of_share;
        // what has no share has none whatever is rounded, unless it is near to having one
        let high = match share[1] > 0.0 || cosine[1] + of_cosine >= LEAST {
            true => share[1] + of_share,
            false => 0.0,
        };
        Slant {
            cosine: [
                (cosine[0] - of_cosine).max(LEAST),
                (cosine[1] + of_cosine).clamp(LEAST, 1.0),
            ],
            share: [low.max(0.0), high.min(1.0)],
        }
    }
}

/// The squares of slopes over the sum of these, in space.
fn squares(slopes: [f64; 3], scale: &WallScale) -> [f64; 3] {
    let parts: [f64; 3] = std::array::from_fn(|a| slopes[a] * scale.finest_over[a]);
    let sum = parts.iter().map(|v| v * v).sum::<f64>();
    parts.map(|v| v * v / sum)
}

/// By a normal in tiles, which is of unit length in steps of a voxel, as the gradient has them.
pub(super) fn by_normal(normal: [f32; 3], axis: usize, scale: &WallScale) -> Slant {
    let own = normal.map(|c| f64::from(c).abs());
    let nearest = std::array::from_fn(|a| match a == axis {
        true => own[a] + ROUNDED,
        false => (own[a] - ROUNDED).max(0.0),
    });
    let square = squares(nearest, scale)[axis];
    if square < LEAST_SQUARE / 2.0 {
        return Slant::none();
    }
    // of each other component by that along the axis
    let ratio = |a: usize, way: f64| {
        let off = way * ROUNDED;
        ((own[a] + off) / (own[axis] - off).max(STEP)).max(0.0)
    };
    let bounds = others(axis).map(|a| [-1.0, 1.0].map(|way| ratio(a, way)));
    let missed = MOST_MISSED * square;
    if bounds
        .iter()
        .any(|[_, most]| missed * most * most > TOO_FAR)
    {
        return Slant::unknown();
    }
    let [u, v] = bounds;
    let corner = |[least, most]: [f64; 2], is_most: bool| if is_most { most } else { least };
    let middle = |[least, most]: [f64; 2]| (least + most) / 2.0;
    // the corners of bounds and their middle, and all of that again for the other sign of what is missed
    let ratios = [
        std::array::from_fn(|i| match i % CORNERS {
            4 => middle(u),
            n => corner(u, n & 1 == 1),
        }),
        std::array::from_fn(|i| match i % CORNERS {
            4 => middle(v),
            n => corner(v, n & 2 == 2),
        }),
    ];
    let missed = std::array::from_fn(|i| if i < CORNERS { -missed } else { missed });
    Slant::around(
        &leans::<{ 2 * CORNERS }>(ratios, missed, axis, scale),
        BETWEEN,
    )
}

/// By the samples of the volume.
pub(in crate::verify) fn by_samples(at: &Crossed, axis: usize, scale: &WallScale) -> Slant {
    let [g, h] = at.gradients;
    let own: [f64; 3] = std::array::from_fn(|a| g[a] + (h[a] - g[a]) * at.place);
    let length = own.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest = g.iter().chain(&h).fold(0f64, |l, c| l.max(c.abs()));
    if largest == 0.0 || !length.is_finite() {
        // as the mesh has it where there is no gradient: along the edge
        return Slant::along();
    }
    let error = EXACT + PRECISION * largest / length;
    if !(SMALLEST..LARGEST).contains(&largest) || error > ROUNDED / 10.0 {
        return Slant::unknown();
    }
    let square = squares(own, scale)[axis];
    let off = square - LEAST_SQUARE / 2.0;
    if off < -error {
        return Slant::none();
    }
    let ratios = others(axis).map(|a| (own[a] / own[axis]).abs());
    let wide = (g[axis] + h[axis]) / 2.0;
    let narrow = at.values[1] - at.values[0];
    let sum = wide + 2.0 * narrow;
    let missed = 2.0 * (wide - narrow) / sum;
    let most = MOST_MISSED * square;
    let too_far = ratios.iter().any(|ratio| most * ratio * ratio > TOO_FAR);
    if !missed.is_finite() {
        return Slant::unknown();
    }
    let grown = if too_far { GROWN_FAR } else { GROWN };
    let unsure = EXACT + 2.0 * PRECISION * largest / sum.abs();
    let all = [missed - unsure, missed, missed + unsure].map(|missed| missed.clamp(-most, most));
    let leans = leans(ratios.map(|ratio| [ratio; 3]), all, axis, scale);
    let slant = Slant::around(&leans, grown.map(|times| times * error));
    match off < error {
        true => Slant {
            share: [0.0, slant.share[1]],
            ..slant
        },
        false => slant,
    }
}

/// How a plane lies to an axis.
#[derive(Debug, Clone, Copy)]
struct Lean {
    cosine: f64,
    share: f64,
}

/// Of planes whose measured slopes over the other two axes are these, by that along the axis and in steps of a voxel, if
/// central differences miss so much of that along the axis: of a component m of the normal, they measure m (F + m^2 f'''/6),
/// and `missed` is m^2 f'''/6F of the axis. Many at once, since they are mostly divisions, which the processor has for pairs.
fn leans<const N: usize>(
    ratios: [[f64; N]; 2],
    missed: [f64; N],
    axis: usize,
    scale: &WallScale,
) -> [Lean; N] {
    let slopes = ratios.map(|measured| {
        let mut slopes = measured;
        for _ in 0..3 {
            for i in 0..N {
                let by = (1.0 + missed[i] * slopes[i] * slopes[i]).max(0.5);
                slopes[i] = measured[i] * (1.0 + missed[i]) / by;
            }
        }
        slopes
    });
    let own = scale.finest_over[axis] * scale.finest_over[axis];
    let over = others(axis).map(|a| scale.finest_over[a] * scale.finest_over[a]);
    std::array::from_fn(|i| {
        let [u, v] = [0, 1].map(|n| slopes[n][i] * slopes[n][i] * over[n]);
        let sum = own + u + v;
        let above = |square: f64| (square - LEAST_SQUARE * sum).max(0.0);
        Lean {
            cosine: (own / sum).sqrt(),
            share: above(own) / (above(own) + above(u) + above(v)),
        }
    })
}

/// The other two axes.
fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
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
            let (mut faced, mut tight) = (0, 0);
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
                let meet = |a: [f64; 2], b: [f64; 2]| a[0] <= b[1] && b[0] <= a[1];
                assert!(
                    meet(exact.share, bounds.share),
                    "{at:?} {exact:?} {bounds:?}"
                );
                if exact.share[0] > 0.0 && bounds.share[1] > 0.0 {
                    faced += 1;
                    assert!(
                        meet(exact.cosine, bounds.cosine),
                        "{at:?} {exact:?} {bounds:?}"
                    );
                }
                let [low, high] = exact.share;
                tight += u64::from(high - low < 1e-3);
            }
            assert!(tight > 15_000 || spacing != [1.0; 3], "{tight}");
            assert!(faced > 1000);
        }
    }
}
