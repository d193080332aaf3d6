//! The cubes that the surface cuts, a batch at a time.
//!
//! How many cubes of a row are cut cannot be foretold, so the processor begins anew at the end of nearly every row.
//! If triangles were made in that loop, it would then wait for all that leads to the first of them, one after the
//! other: the case, its plan, the edges' numbers, their piece, and the place there. Some rows of cubes are listed
//! first, in a short loop, and their triangles made in a long one.

use crate::surface::case_table::{EDGE_LOWER, edge_axis};
use crate::surface::edges::{Edges, below};
use crate::surface::mesher::TileBox;
use std::ops::Range;

/// Numbers of edges that a cube's corners can name: eight counters, and the four of them that lie on
/// the cube's upper x side.
pub const NUMBERS: usize = COUNTERS + 4;

/// Where the number of each cube edge is found among these: x edges, then those along y and z
/// at the cube's lower x side, then at its upper one.
pub const NUMBER_OF_EDGE: [u8; 12] = [0, 1, 2, 3, 4, 8, 5, 9, 6, 10, 7, 11];

/// Crossed edges that are counted from cube to cube (Flying Edges, Schroeder et al. 2015).
const COUNTERS: usize = 8;

/// The edge that each counter stands for.
const COUNTED: [u8; COUNTERS] = [0, 1, 2, 3, 4, 6, 8, 10];

/// Cubes in a word of bits.
const WORD: usize = 64;

/// By case, by how much each counter rises past the cube.
static STEPS: [[u8; COUNTERS]; 256] = steps();

const fn steps() -> [[u8; COUNTERS]; 256] {
    let mut steps = [[0; COUNTERS]; 256];
    let mut case = 0;
    while case < 256 {
        let mut counter = 0;
        while counter < COUNTERS {
            let edge = COUNTED[counter];
            let lower = EDGE_LOWER[edge as usize];
            let upper = lower + (1 << edge_axis(edge));
            steps[case][counter] = (case >> lower ^ case >> upper) as u8 & 1;
            counter += 1;
        }
        case += 1;
    }
    steps
}

/// A cube that the surface cuts, in one cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct ActiveCube {
    /// The numbers of its crossed edges, see [`NUMBER_OF_EDGE`]; nothing for others.
    pub numbers: [u32; NUMBERS],
    /// Its place in the row.
    pub x: u32,
    /// Its place in the slice of cubes.
    pub column: u32,
    /// Its case: a bit for each corner that is above.
    pub case: u8,
    /// It touches the volume's faces.
    pub on_border: bool,
}

/// Cubes of a slice in their order, those of a few rows.
#[derive(Debug)]
pub struct Batch {
    /// Not in the stack: to find a number there takes the compiler an instruction more.
    cubes: Box<[ActiveCube; 2 * WORD]>,
    len: usize,
}

impl Batch {
    /// No cubes.
    pub fn new() -> Self {
        let none = ActiveCube {
            numbers: [0; NUMBERS],
            x: 0,
            column: 0,
            case: 0,
            on_border: false,
        };
        Batch {
            cubes: Box::new([none; 2 * WORD]),
            len: 0,
        }
    }

    /// The cubes, of which none is left.
    #[inline(always)]
    pub fn take(&mut self) -> &[ActiveCube] {
        &self.cubes[..std::mem::take(&mut self.len)]
    }

    /// Adds active cubes of a row until there are enough to go on with. False if there are no more; then
    /// those at hand wait for others.
    #[inline(always)]
    pub fn list(&mut self, row: &mut CubeRow, edges: &Edges, tile: &TileBox) -> bool {
        let (cx, [y, z]) = (tile.cubes[0] as usize, row.place);
        while row.words.start < row.words.end {
            let w = row.words.start;
            row.words.start += 1;
            let here = row.starts.map(|s| edges.bits[s + w]);
            let next = match w + 1 < edges.row_words {
                true => row.starts.map(|s| edges.bits[s + w + 1]),
                false => [0; 4],
            };
            let border = tile.border_cubes(w, [y, z]);
            let mut left = active(here, next) & below(cx, w);
            let mut numbers = row.numbers;
            while left != 0 {
                let i = left.trailing_zeros();
                left &= left - 1;
                let x = WORD * w + i as usize;
                let case = case_at(here, next, i);
                let steps = &STEPS[case];
                let after: [u32; COUNTERS] =
                    std::array::from_fn(|c| numbers[c] + u32::from(steps[c]));
                // there is room for a word's cubes, which the remainder says without a check
                let cube = &mut self.cubes[self.len % (2 * WORD)];
                cube.numbers[..COUNTERS].copy_from_slice(&numbers);
                cube.numbers[COUNTERS..].copy_from_slice(&after[4..]);
                cube.x = x as u32;
                cube.column = (y * cx + x) as u32;
                cube.case = case as u8;
                cube.on_border = border >> i & 1 == 1;
                self.len += 1;
                numbers = after;
            }
            row.numbers = numbers;
            if self.len >= WORD {
                return true;
            }
        }
        false
    }
}

/// A row of cubes of which some may be listed.
#[derive(Debug)]
pub struct CubeRow {
    /// Row and slice.
    place: [usize; 2],
    /// Words that are left.
    words: Range<usize>,
    /// The first words of its four rows of voxels.
    starts: [usize; 4],
    /// The counters at the next cube.
    numbers: [u32; COUNTERS],
}

impl CubeRow {
    /// Row `y` of slice `z` of cubes.
    #[inline(always)]
    pub fn new(edges: &Edges, [y, z]: [usize; 2]) -> Self {
        let row = z * edges.rows + y;
        let rows = [row, row + 1, row + edges.rows, row + edges.rows + 1];
        let is_empty = rows.iter().all(|&row| edges.is_empty(row));
        CubeRow {
            place: [y, z],
            words: 0..if is_empty { 0 } else { edges.row_words },
            starts: rows.map(|row| row * edges.row_words),
            numbers: first_numbers(rows.map(|row| edges.first[row])),
        }
    }
}

/// The counters at the begin of a row of cubes, by the first numbers along each axis of its four rows of voxels.
#[inline(always)]
fn first_numbers(rows: [[u32; 3]; 4]) -> [u32; COUNTERS] {
    let [x, y, z] = [0, 1, 2].map(|axis| rows.map(|row| row[axis]));
    [x[0], x[1], x[2], x[3], y[0], y[2], z[0], z[1]]
}

/// The cubes of 64 whose corners are not all alike, by the words of their four rows and the next ones.
#[inline(always)]
fn active(here: [u64; 4], next: [u64; 4]) -> u64 {
    let further: [u64; 4] = std::array::from_fn(|r| here[r] >> 1 | next[r] << 63);
    let any = here.iter().chain(&further).fold(0, |a, &b| a | b);
    let all = here.iter().chain(&further).fold(!0, |a, &b| a & b);
    any & !all
}

/// The case of cube `i` of a word.
#[inline(always)]
fn case_at(here: [u64; 4], next: [u64; 4], i: u32) -> usize {
    let pair = |r: usize| match i {
        63 => here[r] >> 63 | (next[r] & 1) << 1,
        i => here[r] >> i & 3,
    };
    (pair(0) | pair(1) << 2 | pair(2) << 4 | pair(3) << 6) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Tiling};
    use crate::labels::Bits;
    use proptest::prelude::*;

    /// A tile of its own with random bits.
    fn tile() -> impl Strategy<Value = (TileBox, Bits)> {
        let cubes = [1..140u32, 1..5, 1..5];
        (cubes, any::<u64>(), 1..60u64).prop_map(|(cubes, seed, share)| {
            let dims = Dims(cubes.map(|n| n + 1));
            let tile = TileBox::of(
                Tiling {
                    dims,
                    macrocube: [200; 3],
                },
                [0; 3],
            );
            let above =
                |at: u64| (at ^ seed).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32 & 63 < share;
            (tile, bits(dims, |at| above(dims.linear(at))))
        })
    }

    fn bits(dims: Dims, above: impl Fn([u32; 3]) -> bool) -> Bits {
        use crate::labels::{Span, Voxels};
        let [nx, ny, nz] = dims.0;
        let span = Span {
            nx,
            y: 0..ny,
            z: 0..nz,
        };
        let all = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        let samples = all.map(|at| u8::from(above(at))).collect();
        let voxels = Voxels::of(span.clone(), samples);
        let mut bits = Bits::default();
        bits.classify(&voxels, span, Some(1));
        bits
    }

    proptest! {
        /// Against each cube by itself: every crossed edge of it has the number that counts those before it.
        #[test]
        fn active_cubes_are_those_with_crossed_edges_and_know_their_numbers((tile, bits) in tile()) {
            let mut edges = Edges::default();
            edges.find(&bits, &tile);
            let [cx, cy, cz] = tile.cubes.map(|c| c as usize);
            let mut listed = Vec::new();
            let mut batch = Batch::new();
            for z in 0..cz {
                let mut of_slice = Vec::new();
                for y in 0..cy {
                    let mut row = CubeRow::new(&edges, [y, z]);
                    while batch.list(&mut row, &edges, &tile) {
                        of_slice.extend_from_slice(batch.take());
                    }
                }
                of_slice.extend_from_slice(batch.take());
                listed.extend(of_slice.into_iter().map(|cube| (z, cube)));
            }
            prop_assert!(batch.take().is_empty());
            let word = |[x, y, z]: [usize; 3]| (z * edges.rows + y) * edges.row_words + x / 64;
            let is_above = |at: [usize; 3]| edges.bits[word(at)] >> (at[0] % 64) & 1 == 1;
            let mut numbers = std::collections::BTreeMap::new();
            for (number, [y, z], words) in edges.crossed_rows() {
                let mut next = edges.first[number][0];
                for axis in 0..3 {
                    for x in (0..=cx).filter(|x| words[x / 64][axis] >> (x % 64) & 1 == 1) {
                        numbers.insert(([x, y, z], axis), next);
                        next += 1;
                    }
                }
            }
            let mut listed = listed.into_iter();
            for z in 0..cz {
                for (y, x) in (0..cy).flat_map(|y| (0..cx).map(move |x| (y, x))) {
                    let corner = |c: usize| [x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)];
                    let case = (0..8).fold(0, |bits, c| bits | usize::from(is_above(corner(c))) << c);
                    if case == 0 || case == 255 {
                        continue;
                    }
                    let (slice, cube) = listed.next().expect("an active cube is listed");
                    prop_assert_eq!((slice, usize::from(cube.case)), (z, case));
                    prop_assert_eq!((cube.x as usize, cube.column as usize), (x, y * cx + x));
                    let border = tile.border_cubes(x / 64, [y, z]) >> (x % 64) & 1 == 1;
                    prop_assert_eq!(cube.on_border, border);
                    for edge in 0..12u8 {
                        let (lower, axis) = (EDGE_LOWER[usize::from(edge)], edge_axis(edge));
                        if let Some(&number) = numbers.get(&(corner(lower.into()), axis)) {
                            let place = NUMBER_OF_EDGE[usize::from(edge)];
                            prop_assert_eq!(cube.numbers[usize::from(place)], number);
                        }
                    }
                }
            }
            prop_assert!(listed.next().is_none());
        }
    }
}
