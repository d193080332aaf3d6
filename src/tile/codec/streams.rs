//! Streams of EXT_meshopt_compression (version 0 of the codec for vertices, 1 for index sequences), byte for byte as
//! meshoptimizer makes them, many bytes at a time.
//!
//! Vertices: a block of 256 at a time, and of these each byte by itself. Its differences from vertex to vertex, the
//! sign last, stand in groups of 16, each with as few bits (0, 2, 4 or 8) as make it shortest; what does not fit these
//! follows behind the group. meshoptimizer asks byte by byte what can be asked of a group at once.

use crate::sys::simd::dispatch;
use crate::sys::unchecked::UncheckedMut;

/// First byte of a stream of vertices, and of one of indices, with their versions.
const VERTICES: u8 = 0xA0;
const SEQUENCE: u8 = 0xD1;
/// Vertices of a block, where these have 32 bytes at most.
const BLOCK: usize = 256;
/// Bytes that are of the same number of bits.
const GROUP: usize = 16;
/// Groups whose bits are told by a byte.
const TOLD: usize = 4;
/// Bytes at the end of a stream of vertices: zeros, and the first vertex.
const TAIL: usize = 32;
/// Zeros at the end of a sequence.
const TAIL_OF_SEQUENCE: usize = 4;
/// An index is told by what it differs from one of two before it: from the other one once that is too much.
const FAR: i32 = 30;
/// Bytes of a number of 32 bits in groups of seven.
const LONGEST: usize = 5;

/// Most bytes of a block's lane: its groups and what tells of them, and one more group that is written over.
const LANE: usize = BLOCK / GROUP / TOLD + BLOCK + GROUP;

/// The stream of vertices of `N` bytes, 32 at most.
pub(super) fn vertices<const N: usize>(vertices: &[[u8; N]]) -> Vec<u8> {
    // most lanes take half of their bytes or less
    let mut out = Vec::with_capacity(1 + TAIL + vertices.len() * N / 2);
    out.push(VERTICES);
    dispatch!(blocks(vertices, &mut out));
    let first = vertices.first().copied().unwrap_or([0; N]);
    out.resize(out.len() + TAIL - N, 0);
    out.extend(first);
    out
}

#[inline(always)]
fn blocks<const N: usize>(vertices: &[[u8; N]], out: &mut Vec<u8>) {
    const { assert!(N <= TAIL) };
    let mut last = vertices.first().copied().unwrap_or([0; N]);
    let mut lanes = [[[0; GROUP]; BLOCK / GROUP]; N];
    for block in vertices.chunks(BLOCK) {
        let groups = block.len().div_ceil(GROUP);
        for (g, group) in block.chunks(GROUP).enumerate() {
            let mut all = [last; GROUP + 1];
            all[1..=group.len()].copy_from_slice(group);
            // behind the last vertex nothing changes any more
            last = group[group.len() - 1];
            all[1 + group.len()..].fill(last);
            for k in 0..N {
                for i in 0..GROUP {
                    lanes[k][g][i] = zigzag(all[i + 1][k].wrapping_sub(all[i][k]));
                }
            }
        }
        for lane in &lanes {
            put_lane(&lane[..groups], out);
        }
    }
}

/// The difference with its sign as the last bit.
#[inline(always)]
fn zigzag(difference: u8) -> u8 {
    difference << 1 ^ (difference as i8 >> 7) as u8
}

/// Adds the groups of a lane.
#[inline(always)]
fn put_lane(groups: &[[u8; GROUP]], out: &mut Vec<u8>) {
    let told = groups.len().div_ceil(TOLD);
    let mut bytes = [0; LANE];
    // SAFETY: a group takes 16 bytes at most, and writes no more than that beyond them
    let mut put = unsafe { UncheckedMut::new(&mut bytes) };
    let (mut end, mut bits_before) = (told, None);
    for (g, group) in groups.iter().enumerate() {
        let bits = best_bits(group, bits_before);
        bits_before = Some(bits);
        *put.at_mut(g / TOLD) |= (bits as u8) << (2 * (g % TOLD));
        end = put_group(group, bits, &mut put, end);
    }
    out.extend_from_slice(&bytes[..end]);
}

/// How many bits each byte of a group has; as numbers, how a stream tells so.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Bits {
    None,
    Two,
    Four,
    Eight,
}

/// Those that make a group shortest, the ones before it if several do but eight.
#[inline(always)]
fn best_bits(group: &[u8; GROUP], before: Option<Bits>) -> Bits {
    let (words, _) = group.as_chunks::<8>();
    let words = [0, 1].map(|i| u64::from_le_bytes(words[i]));
    if words[0] | words[1] == 0 {
        return Bits::None;
    }
    let beyond = |most: u8| words.iter().map(|&w| count_beyond(w, most)).sum::<u32>();
    let (two, four) = (4 + beyond(3), 8 + beyond(15));
    let (best, size) = match two < GROUP as u32 {
        true => (Bits::Two, two),
        false => (Bits::Eight, GROUP as u32),
    };
    let as_before = before == Some(Bits::Four) && best != Bits::Eight;
    match four < size || four == size && as_before {
        true => Bits::Four,
        false => best,
    }
}

/// How many of eight bytes are `most` or more, which is 127 at most.
#[inline(always)]
fn count_beyond(word: u64, most: u8) -> u32 {
    const ONES: u64 = 0x0101_0101_0101_0101;
    // to the lower seven bits of each byte is added what carries into the eighth
    let carried = (word & (0x7F * ONES)) + u64::from(0x80 - most) * ONES;
    ((carried | word) & (0x80 * ONES)).count_ones()
}

/// Writes a group from byte `at` on; returns where it ends. Up to a byte behind it is written over.
#[inline(always)]
fn put_group(group: &[u8; GROUP], bits: Bits, put: &mut UncheckedMut<u8>, at: usize) -> usize {
    match bits {
        Bits::None => at,
        Bits::Two => {
            let low = group.map(|v| v.min(3));
            let (fours, _) = low.as_chunks::<4>();
            for (i, four) in fours.iter().enumerate() {
                // to the upper byte, the first one highest
                let packed = u32::from_le_bytes(*four).wrapping_mul(0x4010_0401) >> 24;
                *put.at_mut(at + i) = packed as u8;
            }
            put_beyond(group, 3, put, at + GROUP / 4)
        }
        Bits::Four => {
            let low = group.map(|v| v.min(15));
            let packed: [u8; GROUP / 2] = std::array::from_fn(|i| low[2 * i] << 4 | low[2 * i + 1]);
            put.put(at, packed);
            put_beyond(group, 15, put, at + GROUP / 2)
        }
        Bits::Eight => {
            put.put(at, *group);
            at + GROUP
        }
    }
}

/// Writes the bytes of a group that are `most` or more: none of them is asked by a branch.
#[inline(always)]
fn put_beyond(group: &[u8; GROUP], most: u8, put: &mut UncheckedMut<u8>, mut at: usize) -> usize {
    for &v in group {
        *put.at_mut(at) = v;
        at += usize::from(v >= most);
    }
    at
}

/// The stream of an index sequence.
pub(super) fn sequence(indices: &[u32]) -> Vec<u8> {
    // most take a byte
    let mut out = Vec::with_capacity(1 + TAIL_OF_SEQUENCE + indices.len() * 5 / 4);
    out.push(SEQUENCE);
    let (mut last, mut current) = ([0u32; 2], 0);
    let mut bytes = [0; 64 * LONGEST];
    for some in indices.chunks(64) {
        // SAFETY: each takes 5 bytes at most
        let mut put = unsafe { UncheckedMut::new(&mut bytes) };
        let mut end = 0;
        for &index in some {
            let ahead = index.wrapping_sub(last[current]) as i32;
            current ^= usize::from(ahead.unsigned_abs() >= FAR as u32);
            let ahead = index.wrapping_sub(last[current]) as i32;
            let mut rest = ((ahead << 1 ^ ahead >> 31) as u32) << 1 | current as u32;
            last[current] = index;
            while rest > 127 {
                *put.at_mut(end) = rest as u8 | 128;
                rest >>= 7;
                end += 1;
            }
            *put.at_mut(end) = rest as u8;
            end += 1;
        }
        out.extend_from_slice(&bytes[..end]);
    }
    out.extend([0; TAIL_OF_SEQUENCE]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Numbers that change by little, by much, or not at all for a while.
    fn walk() -> impl Strategy<Value = Vec<u32>> {
        let step = (0..32u32, any::<u32>()).prop_map(|(bits, step)| step & ((1 << bits) - 1));
        let steps = prop::collection::vec((step, any::<bool>(), 1..40usize), 0..80);
        steps.prop_map(|steps| {
            let (mut at, mut all) = (0u32, Vec::new());
            for (step, down, times) in steps {
                let step = if down { step.wrapping_neg() } else { step };
                for time in 0..times {
                    at = at.wrapping_add(step.wrapping_mul(time as u32 % 3));
                    all.push(at);
                }
            }
            all
        })
    }

    /// Against the encoder of meshoptimizer.
    fn vertices_are_those_of_meshoptimizer<const N: usize>(numbers: &[u32], shifts: [u32; N]) {
        let vertex = |&n: &u32| shifts.map(|shift| (n >> shift) as u8);
        let all: Vec<[u8; N]> = numbers.iter().map(vertex).collect();
        let expected = meshopt::encode_vertex_buffer_level(&all, 0, Some(0)).unwrap();
        assert_eq!(vertices(&all), expected);
    }

    proptest! {
        #[test]
        fn streams_are_those_of_meshoptimizer(numbers in walk(), shifts in any::<[u8; 8]>()) {
            let shifts = shifts.map(|shift| u32::from(shift % 32));
            vertices_are_those_of_meshoptimizer(&numbers, shifts);
            vertices_are_those_of_meshoptimizer::<4>(&numbers, [0, 1, 2, 3].map(|k| shifts[k]));
            let indices: Vec<u32> = numbers.iter().map(|n| n >> 1).collect();
            let expected = meshopt::encode_index_sequence(&indices, 1 << 31).unwrap();
            prop_assert_eq!(sequence(&indices), expected);
        }
    }

    #[test]
    fn bytes_beyond_are_counted_as_they_are() {
        for most in [3, 15, 127] {
            for v in 0..=255u8 {
                let word = u64::from_le_bytes([v, 0, 255, most, most - 1, v, 128, v]);
                let counted = word.to_le_bytes().iter().filter(|&&b| b >= most).count();
                assert_eq!(count_beyond(word, most) as usize, counted, "{v} {most}");
            }
        }
    }
}
