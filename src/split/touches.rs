//! Where basins touch: the greatest saddle of each pair in a block, and the faces that they share.

use super::SlabGrid;
use super::ascent::{Piece, RowPieces};
use super::distance::{Block, Level, Levels};
use super::metric::{Peak, Saddle};
use crate::grid::Ambiguous;
use std::collections::HashMap;
use std::ops::Range;

/// Two basins that touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Touch<B> {
    /// The basins, the smaller number first.
    pub basins: [B; 2],
    /// The greatest saddle.
    pub saddle: Saddle,
    /// Faces of voxels between the first and the second one, across each axis: those that look along it less those
    /// that look against it.
    pub faces: [i64; 3],
}

/// The basins of a block and of one voxel around it, but for the slice above it: who touches whom is looked for
/// towards smaller indices.
#[derive(Debug)]
pub struct Window<'a> {
    /// Rows of pieces by slice and row: slices from the one below the block on, rows from the one before it to the one
    /// behind it, none of those outside of the volume.
    pub pieces: RowPieces,
    /// The block.
    pub block: &'a Block,
    /// Its volume.
    pub grid: SlabGrid,
}

impl Window<'_> {
    /// The rows of the window.
    pub fn rows(&self) -> Range<u32> {
        grown_rows(self.block, &self.grid)
    }

    /// The slices of the window.
    pub fn slices(&self) -> Range<u32> {
        self.block.z.start.saturating_sub(1)..self.block.z.end
    }
}

/// The rows of a block and one on each side, within the volume.
pub fn grown_rows(block: &Block, grid: &SlabGrid) -> Range<u32> {
    block.y.start.saturating_sub(1)..(block.y.end + 1).min(grid.dims.0[1])
}

/// A row of voxels.
struct Row<'a, T> {
    pieces: &'a [Piece],
    levels: &'a [T],
    /// Linear index of its first voxel.
    first: u64,
}

/// Finds the pairs of basins that touch in a block, with the greatest saddle of each, by rising numbers.
pub fn touches<T: Level>(window: &Window, levels: &Levels<T>, rule: Ambiguous) -> Vec<Touch<u32>> {
    let (rows, slices, block) = (window.rows(), window.slices(), window.block);
    let row = |y: u32, z: u32| -> Option<Row<T>> {
        if !rows.contains(&y) || !slices.contains(&z) {
            return None;
        }
        let at = (z - slices.start) as usize * rows.len() + (y - rows.start) as usize;
        let (r, s) = (y + 1 - block.y.start, z + 1 - block.z.start);
        Some(Row {
            pieces: window.pieces.row(at),
            levels: levels.row(r as usize, s as usize),
            first: window.grid.dims.linear([0, y, z]),
        })
    };
    let mut found = Found::default();
    for z in block.z.clone() {
        for y in block.y.clone() {
            let here = row(y, z).expect("of the block");
            found.within(&here);
            for (axis, beside) in [row(y.wrapping_sub(1), z), row(y, z.wrapping_sub(1))]
                .iter()
                .enumerate()
            {
                let Some(beside) = beside else { continue };
                found.between(&here, beside, 0, Some(axis + 1));
                if rule == Ambiguous::Separate {
                    found.between(&here, beside, -1, None);
                    found.between(&here, beside, 1, None);
                }
            }
            if rule == Ambiguous::Separate {
                for y in [y.wrapping_sub(1), y + 1] {
                    if let Some(across) = row(y, z.wrapping_sub(1)) {
                        found.between(&here, &across, 0, None);
                    }
                }
            }
        }
    }
    found.touches.sort_unstable_by_key(|touch| touch.basins);
    found.touches
}

/// Pairs that were found so far.
#[derive(Default)]
struct Found {
    touches: Vec<Touch<u32>>,
    place: HashMap<[u32; 2], u32, Mixer>,
    /// The place of the pair that was looked up last.
    last: usize,
}

impl Found {
    /// The neighbours of a row among themselves.
    fn within<T: Level>(&mut self, row: &Row<T>) {
        for pair in row.pieces.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            if a.last.checked_add(1) == Some(b.start) && a.end != b.end {
                let voxel = |x: u16| Peak {
                    level: row.levels[usize::from(x)].get(),
                    voxel: row.first + u64::from(x),
                };
                let touch = self.touch(a.end, b.end);
                touch.faces[0] += if a.end < b.end { 1 } else { -1 };
                touch.saddle = touch.saddle.max(Saddle::of(voxel(a.last), voxel(b.start)));
            }
        }
    }

    /// Voxels x of a row with voxels x + `dx` of one before it; `axis` is that of the faces between them.
    fn between<T: Level>(&mut self, here: &Row<T>, there: &Row<T>, dx: i32, axis: Option<usize>) {
        let (mut i, mut j) = (0, 0);
        while let (Some(a), Some(b)) = (here.pieces.get(i), there.pieces.get(j)) {
            let start = i32::from(a.start).max(i32::from(b.start) - dx);
            let [last_a, last_b] = [i32::from(a.last), i32::from(b.last) - dx];
            let last = last_a.min(last_b);
            if a.end != b.end && start <= last {
                let touch = self.touch(b.end, a.end);
                if let Some(axis) = axis {
                    let faces = i64::from(last - start + 1);
                    touch.faces[axis] += if b.end < a.end { faces } else { -faces };
                }
                raise(
                    &mut touch.saddle,
                    [here, there],
                    start as usize..last as usize + 1,
                    dx,
                );
            }
            i += usize::from(last_a <= last_b);
            j += usize::from(last_b <= last_a);
        }
    }

    /// What is known of a pair.
    #[inline(always)]
    fn touch(&mut self, a: u32, b: u32) -> &mut Touch<u32> {
        let basins = [a.min(b), a.max(b)];
        if self
            .touches
            .get(self.last)
            .is_none_or(|touch| touch.basins != basins)
        {
            let new = self.touches.len() as u32;
            self.last = *self.place.entry(basins).or_insert(new) as usize;
            if self.last == self.touches.len() {
                let none = Peak {
                    level: 0,
                    voxel: u64::MAX,
                };
                self.touches.push(Touch {
                    basins,
                    saddle: Saddle {
                        low: none,
                        high: u64::MAX,
                    },
                    faces: [0; 3],
                });
            }
        }
        &mut self.touches[self.last]
    }
}

/// Raises a saddle to the greatest of the pairs of voxels x and x + `dx` of two rows.
#[inline(always)]
fn raise<T: Level>(saddle: &mut Saddle, rows: [&Row<T>; 2], x: Range<usize>, dx: i32) {
    let moved = |x: usize| x.wrapping_add_signed(dx as isize);
    let [here, there] = [
        &rows[0].levels[x.clone()],
        &rows[1].levels[moved(x.start)..moved(x.end)],
    ];
    let lower = |(a, b): (&T, &T)| (*a).min(*b);
    let most = here.iter().zip(there).map(lower).fold(T::default(), T::max);
    if most.get() < saddle.low.level {
        return;
    }
    for (i, pair) in here.iter().zip(there).enumerate() {
        if lower(pair) == most {
            let [a, b] = [
                (rows[0], x.start + i, *pair.0),
                (rows[1], moved(x.start + i), *pair.1),
            ]
            .map(|(row, x, level)| Peak {
                level: level.get(),
                voxel: row.first + x as u64,
            });
            *saddle = (*saddle).max(Saddle::of(a, b));
        }
    }
}

/// Hashes a pair of numbers by a product: the maps are looked into millions of times, and nobody chooses their keys.
#[derive(Default, Clone)]
pub struct Mixer;

/// See [`Mixer`].
#[derive(Default)]
pub struct Mixed(u64);

impl std::hash::BuildHasher for Mixer {
    type Hasher = Mixed;

    fn build_hasher(&self) -> Mixed {
        Mixed(0)
    }
}

impl std::hash::Hasher for Mixed {
    fn write(&mut self, bytes: &[u8]) {
        bytes.chunks(8).for_each(|chunk| {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        });
    }

    #[inline]
    fn write_u32(&mut self, number: u32) {
        self.write_u64(u64::from(number));
    }

    #[inline]
    fn write_u64(&mut self, number: u64) {
        let mixed = (self.0.rotate_left(26) ^ number).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 32;
    }

    fn write_usize(&mut self, _: usize) {
        // the length of an array, which is always the same
    }

    fn finish(&self) -> u64 {
        self.0
    }
}
