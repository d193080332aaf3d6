//! Unit normals in 8 bits: the code of the octahedral filter of EXT_meshopt_compression, and what it decodes to.
//!
//! Every quantized tile, compressed or not, has the vectors that codes decode to, and of the codes
//! of a vector the first one. So quantizing what was quantized changes nothing, and quantized and
//! compressed tiles have the same normals.
//!
//! The codes of many normals are found together, in loops that compilers turn into vector instructions: one after the
//! other, they take half of the time of a conversion to quantized tiles.

use super::float::float3;
use crate::sys::simd::dispatch;
use std::sync::LazyLock;

/// x and y on the octahedron, -127 to 127 each.
type Code = [i8; 2];

/// Normals that are quantized together.
const TOGETHER: usize = 64;

/// What is stored of a quantized unit vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The vector that its code decodes to, of length 127 up to rounding, and 0.
    Vector,
    /// Its code as the filter decodes it: x, y, 127 and 0.
    Code,
}

impl Kind {
    /// What is stored for each of the [`codes`] that may be nearest to a vector.
    fn table(self) -> &'static [[u8; 4]] {
        static VECTORS: LazyLock<Vec<[u8; 4]>> = LazyLock::new(|| table(decode));
        static CODES: LazyLock<Vec<[u8; 4]>> = LazyLock::new(|| table(|[x, y]| [x, y, 127]));
        match self {
            Kind::Vector => &VECTORS,
            Kind::Code => &CODES,
        }
    }
}

/// Quantizes unit vectors, given as three little-endian floats each. The nearest of 64,516 directions is at most
/// 0.9 degrees away.
pub(crate) fn quantize(normals: &[[u8; 12]], kind: Kind) -> Vec<[u8; 4]> {
    let table = kind.table();
    let mut out = Vec::with_capacity(normals.len());
    for_each_nearest(normals, float3, |slot| out.push(table[slot as usize]));
    out
}

/// The codes of unit vectors: x and y on the octahedron, -127 to 127 each.
pub fn octahedral_codes(normals: &[[f32; 3]]) -> Vec<[i8; 2]> {
    let table = Kind::Code.table();
    let mut out = Vec::with_capacity(normals.len());
    let put = |slot: u32| {
        let [x, y, ..] = table[slot as usize];
        out.push([x as i8, y as i8]);
    };
    for_each_nearest(normals, |normal| *normal, put);
    out
}

/// Hands out the place among the [`codes`] of the one nearest to each of some unit vectors.
fn for_each_nearest<T>(all: &[T], vector: impl Fn(&T) -> [f32; 3], mut put: impl FnMut(u32)) {
    for some in all.chunks(TOGETHER) {
        let mut components = [[0.0; TOGETHER]; 3];
        for (i, one) in some.iter().enumerate() {
            let vector = vector(one);
            (0..3).for_each(|a| components[a][i] = vector[a]);
        }
        let slots = slots_of_nearest(&components);
        slots[..some.len()].iter().for_each(|&slot| put(slot));
    }
}

/// All codes, by x, then y.
fn codes() -> impl Iterator<Item = Code> {
    let all = -127..=127i8;
    all.clone()
        .flat_map(move |x| all.clone().map(move |y| [x, y]))
}

/// For each of the [`codes`] what `store` makes of the one that is nearest to its own vector.
fn table(store: fn(Code) -> [i8; 3]) -> Vec<[u8; 4]> {
    let codes: Vec<Code> = codes().collect();
    let unit = |&code: &Code| {
        let v = decode(code).map(f32::from);
        let length = v.iter().map(|c| c * c).sum::<f32>().sqrt();
        v.map(|c| c / length)
    };
    let mut stored = Vec::with_capacity(codes.len());
    for_each_nearest(&codes, unit, |slot| {
        let [x, y, z] = store(codes[slot as usize]).map(|v| v as u8);
        stored.push([x, y, z, 0]);
    });
    stored
}

/// The places among the [`codes`] of those whose vectors are nearest to unit vectors, of the nine round their place on
/// the octahedron; the first of several. The unit vectors' x come first, then y, then z.
fn slots_of_nearest(normals: &[[f32; TOGETHER]; 3]) -> [u32; TOGETHER] {
    dispatch!(find_nearest(normals))
}

/// What [`slots_of_nearest`] returns.
#[inline(always)]
fn find_nearest([nx, ny, nz]: &[[f32; TOGETHER]; 3]) -> [u32; TOGETHER] {
    let mut centres = [[0.0f32; TOGETHER]; 2];
    for i in 0..TOGETHER {
        let sum = nx[i].abs() + ny[i].abs() + nz[i].abs();
        let (x, y) = (nx[i] / sum, ny[i] / sum);
        let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
        let over = [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)];
        let [x, y] = if nz[i] < 0.0 { over } else { [x, y] };
        (centres[0][i], centres[1][i]) = (round(x * 127.0), round(y * 127.0));
    }
    let mut best = [f32::NEG_INFINITY; TOGETHER];
    let mut found = [127.0 * 255.0 + 127.0; TOGETHER];
    for (dx, dy) in NEIGHBOURS {
        for i in 0..TOGETHER {
            let x = (centres[0][i] + dx).clamp(-127.0, 127.0);
            let y = (centres[1][i] + dy).clamp(-127.0, 127.0);
            let [vx, vy, vz] = vector(x, y);
            let dot = vx * nx[i] + vy * ny[i] + vz * nz[i];
            let cosine = dot / (vx * vx + vy * vy + vz * vz).sqrt();
            let nearer = cosine > best[i];
            best[i] = if nearer { cosine } else { best[i] };
            let slot = (x + 127.0) * 255.0 + (y + 127.0);
            found[i] = if nearer { slot } else { found[i] };
        }
    }
    // whole numbers below 2^23 are the low bits of what they make with it
    found.map(|slot| (slot + TWO_TO_23).to_bits() - TWO_TO_23.to_bits())
}

/// A place of the octahedron and the eight round it.
const NEIGHBOURS: [(f32, f32); 9] = [
    (-1.0, -1.0),
    (-1.0, 0.0),
    (-1.0, 1.0),
    (0.0, -1.0),
    (0.0, 0.0),
    (0.0, 1.0),
    (1.0, -1.0),
    (1.0, 0.0),
    (1.0, 1.0),
];

/// The vector of a code.
fn decode(code: Code) -> [i8; 3] {
    let [x, y] = code.map(f32::from);
    vector(x, y).map(|c| c as i8)
}

/// The vector of a code, in whole numbers, by the formula in the specification of the filter.
#[inline(always)]
fn vector(x: f32, y: f32) -> [f32; 3] {
    let z = 127.0 - x.abs() - y.abs();
    let fold = if z < 0.0 { z } else { 0.0 };
    let folded = |v: f32| if v >= 0.0 { v + fold } else { v - fold };
    let [x, y] = [folded(x), folded(y)];
    let to_length = 127.0 / (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|c| round(c * to_length))
}

/// From here on all floats are whole numbers.
const TWO_TO_23: f32 = (1 << 23) as f32;

/// The nearest whole number to one below 2^22, of two as near the one away from zero, as the filter rounds.
/// [`f32::round`] is a call for each number where processors need not have an instruction for it.
#[inline(always)]
fn round(v: f32) -> f32 {
    let beyond = v.abs() + 0.5;
    let near = (beyond + TWO_TO_23) - TWO_TO_23;
    let whole = if near > beyond { near - 1.0 } else { near };
    whole.copysign(v)
}

/// The octahedral filter of EXT_meshopt_compression for components of 8 bits: x and y on the
/// octahedron and the value of one become a vector of length 127.
pub(super) fn decode_filter(e: &mut [u8; 4]) {
    let [mut x, mut y, one] = [0, 1, 2].map(|i| f32::from(e[i] as i8));
    let z = one - x.abs() - y.abs();
    let below = z.min(0.0);
    x += if x >= 0.0 { below } else { -below };
    y += if y >= 0.0 { below } else { -below };
    let scale = 127.0 / (x * x + y * y + z * z).sqrt();
    for (byte, v) in e.iter_mut().zip([x, y, z]) {
        let rounded = v * scale + if v >= 0.0 { 0.5 } else { -0.5 };
        // towards zero; out of range saturates, no number becomes 0
        *byte = rounded as i8 as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The decoder of the library that wrote the specification, on all codes.
    #[test]
    fn the_filter_is_that_of_meshoptimizer() {
        let mut codes: Vec<[i8; 4]> = Vec::new();
        for x in -127..=127i8 {
            for y in -127..=127i8 {
                codes.push([x, y, 127, 0]);
            }
        }
        let mut own: Vec<[u8; 4]> = codes.iter().map(|c| c.map(|v| v as u8)).collect();
        own.iter_mut().for_each(decode_filter);
        meshopt::decode_filter_oct(&mut codes);
        // its vector instructions round halves to even, the specification's formula away from zero
        let mut other = 0;
        for (own, theirs) in own.iter().zip(&codes) {
            for (a, &b) in own.iter().zip(theirs) {
                other += u32::from(*a as i8 != b);
                assert!((*a as i8).abs_diff(b) <= 1, "{own:?} {theirs:?}");
            }
        }
        assert!(other < 1000, "{other} of 65,025 codes");
    }

    #[test]
    fn no_code_breaks_the_filter() {
        for bits in (0..=u32::MAX >> 8).step_by(37) {
            decode_filter(&mut bits.to_le_bytes());
        }
    }

    fn unit(v: [f32; 3]) -> [f32; 3] {
        let length = v.iter().map(|c| c * c).sum::<f32>().sqrt();
        v.map(|c| c / length)
    }

    #[test]
    fn codes_decode_as_meshoptimizer_decodes_them() {
        let all = (-127..=127i8).flat_map(|x| (-127..=127i8).map(move |y| [x, y]));
        for [x, y] in all {
            let mut element = [[x, y, 127, 0]];
            meshopt::decode_filter_oct(&mut element);
            // on ties its vector instructions round to even
            let near = |(a, b): (&i8, &i8)| a.abs_diff(*b) <= 1;
            assert!(decode([x, y]).iter().zip(&element[0]).all(near), "{x} {y}");
        }
    }

    fn bytes(vectors: &[[f32; 3]]) -> Vec<[u8; 12]> {
        let bytes = |v: &[f32; 3]| bytemuck::cast(v.map(f32::to_le_bytes));
        vectors.iter().map(bytes).collect()
    }

    fn quantize_all(vectors: &[[f32; 3]], kind: Kind) -> Vec<[i8; 3]> {
        let all = quantize(&bytes(vectors), kind).into_iter();
        all.map(|[x, y, z, rest]| {
            assert_eq!(rest, 0);
            [x as i8, y as i8, z as i8]
        })
        .collect()
    }

    /// The code nearest to a unit vector among the nine round its place, one after the other.
    fn nearest(n: [f32; 3]) -> Code {
        let sum = n.iter().map(|c| c.abs()).sum::<f32>();
        let [mut x, mut y] = [n[0] / sum, n[1] / sum];
        if n[2] < 0.0 {
            let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
            [x, y] = [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)];
        }
        let [cx, cy] = [x, y].map(|v| (v * 127.0 + 0.5f32.copysign(v)) as i32);
        let mut best = (f32::NEG_INFINITY, [0, 0]);
        for x in cx - 1..=cx + 1 {
            for y in cy - 1..=cy + 1 {
                let code = [x, y].map(|v| v.clamp(-127, 127) as i8);
                let v = decode(code).map(f32::from);
                let dot = v[0] * n[0] + v[1] * n[1] + v[2] * n[2];
                let cosine = dot / (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
                if cosine > best.0 {
                    best = (cosine, code);
                }
            }
        }
        best.1
    }

    fn first(code: Code) -> Code {
        nearest(unit(decode(code).map(f32::from)))
    }

    #[test]
    fn every_code_is_stored_as_the_first_of_its_vector() {
        let vectors: Vec<_> = codes().map(|c| unit(decode(c).map(f32::from))).collect();
        let [stored, found] = [Kind::Vector, Kind::Code].map(|kind| quantize_all(&vectors, kind));
        for (i, code) in codes().enumerate() {
            let vector = decode(code);
            assert_eq!(stored[i], vector, "{code:?}");
            assert_eq!(found[i], [first(code)[0], first(code)[1], 127], "{code:?}");
        }
        // and it stays so
        let again: Vec<_> = found
            .iter()
            .map(|&[x, y, _]| unit(decode([x, y]).map(f32::from)))
            .collect();
        assert_eq!(quantize_all(&again, Kind::Vector), stored);
        assert_eq!(quantize_all(&again, Kind::Code), found);
    }

    #[test]
    fn what_is_no_direction_gets_some_code() {
        let odd = [
            [0.0; 3],
            [f32::NAN; 3],
            [f32::INFINITY; 3],
            [-0.0, 0.0, -0.0],
        ];
        let found = quantize_all(&odd, Kind::Vector);
        assert!(
            found
                .iter()
                .all(|&v| unit(v.map(f32::from)).iter().all(|c| c.is_finite()))
        );
    }

    proptest! {
        #[test]
        fn numbers_are_rounded_as_by_a_conversion(v in -4e6f32..4e6, halves in -8_000_000..8_000_000i32) {
            for v in [v, v / 4e4, v / 4e8, halves as f32 / 2.0, halves as f32 / 4.0] {
                let rounded = (v + 0.5f32.copysign(v)) as i32;
                prop_assert_eq!(round(v), rounded as f32, "{}", v);
            }
        }

        #[test]
        fn many_at_once_are_as_one_after_the_other(
            vectors in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 1..200)
                .prop_map(|all| all.into_iter().map(unit).collect::<Vec<_>>())
        ) {
            let codes: Vec<Code> = vectors.iter().map(|&n| first(nearest(n))).collect();
            let of_codes: Vec<_> = codes.iter().map(|&[x, y]| [x, y, 127]).collect();
            prop_assert_eq!(quantize_all(&vectors, Kind::Code), of_codes);
            let of_vectors: Vec<_> = codes.iter().map(|&code| decode(code)).collect();
            prop_assert_eq!(quantize_all(&vectors, Kind::Vector), of_vectors);
            let mut components = [[0.5; TOGETHER]; 3];
            for (i, v) in vectors.iter().take(TOGETHER).enumerate() {
                (0..3).for_each(|a| components[a][i] = v[a]);
            }
            prop_assert_eq!(slots_of_nearest(&components), find_nearest(&components));
        }

        #[test]
        fn the_vector_is_near_and_of_unit_length(
            v in prop::array::uniform3(-1.0f32..1.0).prop_filter("a direction", |v| {
                v.iter().map(|c| c * c).sum::<f32>() > 1e-3
            })
        ) {
            let n = unit(v);
            let found = quantize_all(&[n], Kind::Vector)[0];
            let length = found.map(f32::from).iter().map(|c| c * c).sum::<f32>().sqrt();
            prop_assert!((length / 127.0 - 1.0).abs() < 0.007);
            let q = unit(found.map(f32::from));
            let cosine = (0..3).map(|a| q[a] * n[a]).sum::<f32>().min(1.0);
            prop_assert!(libm::acosf(cosine).to_degrees() < 0.9, "{:?} {:?}", n, q);
        }
    }
}
