//! Unit normals in 8 bits: the code of the octahedral filter of EXT_meshopt_compression.
//!
//! Every quantized tile, compressed or not, has the vectors that codes decode to, and of the codes
//! of a vector the first one. So quantizing what was quantized changes nothing, and quantized and
//! compressed tiles have the same normals.

use std::sync::OnceLock;

/// x and y on the octahedron, -127 to 127 each.
type Code = [i8; 2];

/// The code of the vector nearest to a unit vector, for those who store codes, and that vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Quantized {
    /// The code.
    pub code: Code,
    /// What it decodes to, of length 127 up to rounding.
    pub vector: [i8; 3],
}

/// Quantizes a unit vector. The nearest of 64,516 directions is at most 0.9 degrees away.
pub(super) fn quantize(normal: [f32; 3]) -> Quantized {
    static FIRST: OnceLock<Vec<Code>> = OnceLock::new();
    let table = FIRST.get_or_init(first_codes);
    let code = table[slot(nearest(normal))];
    Quantized {
        code,
        vector: decode(code),
    }
}

/// The place of a code in a table of all of them.
fn slot([x, y]: Code) -> usize {
    (i32::from(x) + 127) as usize * 255 + (i32::from(y) + 127) as usize
}

/// For each code the one that [`nearest`] finds for its own vector.
fn first_codes() -> Vec<Code> {
    let all = -127..=127i8;
    all.clone()
        .flat_map(|x| all.clone().map(move |y| [x, y]))
        .map(|code| {
            let v = decode(code).map(f32::from);
            let length = v.iter().map(|c| c * c).sum::<f32>().sqrt();
            nearest(v.map(|c| c / length))
        })
        .collect()
}

/// The code whose vector is nearest to a unit vector among the nine round its place on the
/// octahedron; the first of several.
fn nearest(n: [f32; 3]) -> Code {
    let sum = n.iter().map(|c| c.abs()).sum::<f32>();
    let [mut x, mut y] = [n[0] / sum, n[1] / sum];
    if n[2] < 0.0 {
        let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
        [x, y] = [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)];
    }
    let [cx, cy] = [x, y].map(|v| (v * 127.0).round() as i32);
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

/// The vector of a code, by the formula in the specification of the filter.
fn decode(code: Code) -> [i8; 3] {
    let [x, y] = code.map(f32::from);
    let z = 127.0 - x.abs() - y.abs();
    let fold = z.min(0.0);
    let folded = [x, y].map(|v| if v >= 0.0 { v + fold } else { v - fold });
    let v = [folded[0], folded[1], z];
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    // halves away from zero, as the filter rounds
    v.map(|c| (c * (127.0 / length) + 0.5f32.copysign(c)) as i8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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

    #[test]
    fn quantizing_twice_changes_nothing() {
        for x in -127..=127i8 {
            for y in -127..=127i8 {
                let vector = decode([x, y]);
                let again = quantize(unit(vector.map(f32::from)));
                assert_eq!(again.vector, vector, "{x} {y}");
                let third = quantize(unit(again.vector.map(f32::from)));
                assert_eq!(third, again, "{x} {y}");
            }
        }
    }

    proptest! {
        #[test]
        fn the_vector_is_near_and_of_unit_length(
            v in prop::array::uniform3(-1.0f32..1.0).prop_filter("a direction", |v| {
                v.iter().map(|c| c * c).sum::<f32>() > 1e-3
            })
        ) {
            let n = unit(v);
            let found = quantize(n);
            prop_assert_eq!(found, quantize(unit(found.vector.map(f32::from))));
            let length = found.vector.iter().map(|&c| f32::from(c).powi(2)).sum::<f32>().sqrt();
            prop_assert!((length / 127.0 - 1.0).abs() < 0.007);
            let q = unit(found.vector.map(f32::from));
            let cosine = (0..3).map(|a| q[a] * n[a]).sum::<f32>().min(1.0);
            prop_assert!(cosine.acos().to_degrees() < 0.9, "{:?} {:?}", n, q);
        }
    }
}
