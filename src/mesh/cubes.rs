//! The triangles of a tile's cubes and which of them are neighbours.

use crate::cpu::dispatch;
use crate::mesh::edges::{EdgeWord, Edges, below};
use crate::mesh::table::{Across, Case, MAX_TRIANGLES};
use crate::mesh::tile::TileBox;
use std::sync::LazyLock;

/// No triangle lies across this edge inside the tile.
pub const NONE: u32 = u32::MAX;

/// Triangles in the order of their cubes, by rising z, y, x.
#[derive(Debug, Default)]
pub struct Triangles {
    /// Edge numbers of the corners.
    pub corners: Vec<[u32; 3]>,
    /// For half-edge `3 t + e` the half-edge across it, or [`NONE`].
    pub mates: Vec<u32>,
    /// Half-edges on the volume's faces.
    pub border: Vec<u32>,
    /// Half-edges on the upper y face of the row of cubes before, two slots per x.
    row_slots: Vec<[u32; 2]>,
    /// Half-edges on the upper z face of the slice of cubes before, two slots per cube.
    slice_slots: Vec<[u32; 2]>,
}

/// A case prepared for the loop: half-edges by what lies across.
#[derive(Debug, Clone, Copy)]
struct Plan {
    triangles: u8,
    corners: [[u8; 3]; MAX_TRIANGLES],
    /// The mate inside the cube, or 255.
    inside: [u8; 3 * MAX_TRIANGLES],
    /// Half-edges on faces 0, 2, 4 and on faces 1, 3, 5, by slot; 255 where there is none.
    low: [[u8; 2]; 3],
    high: [[u8; 2]; 3],
}

const ABSENT: u8 = 255;

/// The plans of a rule's 256 cases.
pub struct Plans(Box<[Plan; 256]>);

impl Plans {
    /// For the table of one rule.
    pub fn of(rule: crate::grid::Ambiguous) -> &'static Plans {
        use crate::grid::Ambiguous;
        static SEPARATE: LazyLock<Plans> = LazyLock::new(|| Plans::new(Ambiguous::Separate));
        static JOIN: LazyLock<Plans> = LazyLock::new(|| Plans::new(Ambiguous::Join));
        match rule {
            Ambiguous::Separate => &SEPARATE,
            Ambiguous::Join => &JOIN,
        }
    }

    fn new(rule: crate::grid::Ambiguous) -> Self {
        let table = crate::mesh::table::cases(rule);
        Plans(Box::new(std::array::from_fn(|c| Plan::new(&table[c]))))
    }
}

impl Plan {
    fn new(case: &Case) -> Self {
        let mut plan = Plan {
            triangles: case.triangles,
            corners: case.edges,
            inside: [ABSENT; 3 * MAX_TRIANGLES],
            low: [[ABSENT; 2]; 3],
            high: [[ABSENT; 2]; 3],
        };
        for t in 0..usize::from(case.triangles) {
            for e in 0..3 {
                let half_edge = (3 * t + e) as u8;
                match case.across[t][e] {
                    Across::Inside(mate) => plan.inside[half_edge as usize] = mate,
                    Across::Face { face, slot } => {
                        let side = if face % 2 == 0 {
                            &mut plan.low
                        } else {
                            &mut plan.high
                        };
                        side[face as usize / 2][slot as usize] = half_edge;
                    }
                }
            }
        }
        plan
    }
}

impl Triangles {
    /// Makes the triangles of all cubes of a tile; reuses the memory.
    pub fn make(&mut self, edges: &Edges, tile: &TileBox, plans: &Plans) {
        dispatch!(self.make_inlined(edges, tile, plans));
    }

    #[inline(always)]
    fn make_inlined(&mut self, edges: &Edges, tile: &TileBox, plans: &Plans) {
        let [cx, cy, cz] = tile.cubes.map(|c| c as usize);
        self.corners.clear();
        self.mates.clear();
        self.border.clear();
        self.row_slots.resize(cx, [NONE; 2]);
        self.slice_slots.resize(cx * cy, [NONE; 2]);
        let row = edges.row_words;
        let slice = edges.rows * row;
        for z in 0..cz {
            for y in 0..cy {
                let start = z * slice + y * row;
                let starts = [start, start + row, start + slice, start + slice + row];
                self.cube_row(edges, tile, plans, starts, [y, z]);
            }
        }
    }

    #[inline(always)]
    fn cube_row(
        &mut self,
        edges: &Edges,
        tile: &TileBox,
        plans: &Plans,
        starts: [usize; 4],
        [y, z]: [usize; 2],
    ) {
        let cx = tile.cubes[0] as usize;
        let mut x_slots = [NONE; 2];
        for w in 0..edges.row_words {
            let here = starts.map(|s| edges.bits[s + w]);
            // the same rows one voxel further along x
            let further: [u64; 4] = std::array::from_fn(|i| {
                let next = if w + 1 < edges.row_words {
                    edges.bits[starts[i] + w + 1]
                } else {
                    0
                };
                here[i] >> 1 | next << 63
            });
            let any = here.iter().chain(&further).fold(0, |a, &b| a | b);
            let all = here.iter().chain(&further).fold(!0, |a, &b| a & b);
            let mut active = any & !all & below(cx, w);
            while active != 0 {
                let bit = active & active.wrapping_neg();
                active ^= bit;
                let i = bit.trailing_zeros();
                let x = 64 * w + i as usize;
                let pair = |r: usize| (here[r] >> i & 1) | (further[r] >> i & 1) << 1;
                let case = pair(0) | pair(1) << 2 | pair(2) << 4 | pair(3) << 6;
                let word = |r: usize| &edges.words[starts[r] + w];
                let words = [word(0), word(1), word(2), word(3)];
                self.cube(
                    &plans.0[case as usize],
                    &numbers(words, bit),
                    tile,
                    [x, y, z],
                    &mut x_slots,
                );
            }
        }
    }

    #[inline(always)]
    fn cube(
        &mut self,
        plan: &Plan,
        numbers: &[u32; 16],
        tile: &TileBox,
        [x, y, z]: [usize; 3],
        x_slots: &mut [u32; 2],
    ) {
        let first = self.mates.len() as u32;
        let count = usize::from(plan.triangles);
        // the mask says what is so anyway, and saves a check
        let number = |edge: u8| numbers[usize::from(edge) & 15];
        let corners = plan.corners[..count].iter();
        self.corners
            .extend(corners.map(|&[a, b, c]| [number(a), number(b), number(c)]));
        let inside = plan.inside[..3 * count].iter();
        self.mates.extend(inside.map(|&mate| match mate {
            ABSENT => NONE,
            mate => first + u32::from(mate),
        }));
        let (cx, cy) = (tile.cubes[0] as usize, tile.cubes[1] as usize);
        let at = [x, y, z];
        for axis in 0..3 {
            let slots = match axis {
                0 => &mut *x_slots,
                1 => &mut self.row_slots[x],
                _ => &mut self.slice_slots[y * cx + x],
            };
            for slot in 0..2 {
                let low = plan.low[axis][slot];
                if low != ABSENT {
                    let half_edge = first + u32::from(low);
                    if at[axis] > 0 {
                        let mate = slots[slot];
                        self.mates[half_edge as usize] = mate;
                        self.mates[mate as usize] = half_edge;
                    } else if tile.first_cube[axis] == 0 {
                        self.border.push(half_edge);
                    }
                }
                let high = plan.high[axis][slot];
                if high != ABSENT {
                    let half_edge = first + u32::from(high);
                    slots[slot] = half_edge;
                    if at[axis] + 1 == tile.cubes[axis] as usize && tile.is_last[axis] {
                        self.border.push(half_edge);
                    }
                }
            }
        }
        debug_assert!(y < cy);
    }
}

/// Numbers of the 12 edges of the cube at `bit`, whose rows (y, z), (y+1, z), (y, z+1) and
/// (y+1, z+1) have these words; only those of crossed edges mean anything, and the last four never.
#[inline(always)]
fn numbers(words: [&EdgeWord; 4], bit: u64) -> [u32; 16] {
    let [w00, w10, w01, w11] = words;
    [
        w00.at(0, bit),
        w10.at(0, bit),
        w01.at(0, bit),
        w11.at(0, bit),
        w00.at(1, bit),
        w00.after(1, bit),
        w01.at(1, bit),
        w01.after(1, bit),
        w00.at(2, bit),
        w00.after(2, bit),
        w10.at(2, bit),
        w10.after(2, bit),
        0,
        0,
        0,
        0,
    ]
}
