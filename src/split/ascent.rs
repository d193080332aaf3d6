//! Where each voxel of air goes up to, and where these ways end within a block.
//!
//! A voxel goes to the steepest of its neighbours that are greater in the order, see [`Peak`]. The slope of a step is
//! the difference of the roots of the levels, in 1/1024, over the length of the step: squares of slopes are compared by
//! products of integers, and of equally steep ones the greater is taken. So the way of a voxel depends on the levels
//! around it alone, whatever the cut into blocks.

use super::distance::{Block, Level, Levels};
use super::metric::{Metric, Peak};
use crate::grid::{Ambiguous, Dims};
use crate::sys::simd::dispatch;

/// Code of a way: the place of the neighbour among 27, from the last to the first, so that of two neighbours with the
/// same level the greater code is that of the smaller index.
type Code = u8;
/// The voxel itself: it is a maximum.
const PEAK: Code = 13;
/// Not of the block.
const OUTSIDE: Code = 27;
/// Solid.
const SOLID: Code = 28;
/// Bits of a code in a key, below those of the level.
const CODE_BITS: u32 = 5;

/// A step to a neighbour along x, y and z.
type Step = [i32; 3];

/// Steps of the same length, and its square.
#[derive(Debug)]
struct Class {
    square: u64,
    steps: Vec<Step>,
}

/// The steps that a way can take.
#[derive(Debug)]
pub struct Ways {
    /// By length.
    classes: Vec<Class>,
    /// Roots of the levels.
    roots: Vec<u32>,
}

fn code(step: Step) -> Code {
    let [x, y, z] = step.map(|d| (d + 1) as u8);
    26 - (9 * z + 3 * y + x)
}

/// The step of a code below 27.
fn step_of(code: Code) -> Step {
    let place = i32::from(26 - code);
    [place % 3 - 1, place / 3 % 3 - 1, place / 9 - 1]
}

/// The neighbours of a voxel of a cell: 18 or 6.
pub fn neighbours(rule: Ambiguous) -> impl Iterator<Item = Step> {
    let most = match rule {
        Ambiguous::Separate => 2,
        Ambiguous::Join => 1,
    };
    let length = |step: &Step| step.iter().map(|d| d * d).sum::<i32>();
    let steps = (0..27).rev().map(step_of);
    steps.filter(move |step| (1..=most).contains(&length(step)))
}

impl Ways {
    /// The steps to neighbours of a cell.
    pub fn new(metric: &Metric, rule: Ambiguous) -> Self {
        let mut classes: Vec<Class> = Vec::new();
        for step in neighbours(rule) {
            let squares = step.map(|d| u64::from(d != 0));
            let square = (0..3)
                .map(|a| squares[a] * u64::from(metric.weights()[a]))
                .sum();
            match classes.iter_mut().find(|class| class.square == square) {
                Some(class) => class.steps.push(step),
                None => classes.push(Class {
                    square,
                    steps: vec![step],
                }),
            }
        }
        classes.sort_by_key(|class| class.square);
        Ways {
            classes,
            roots: metric.roots(),
        }
    }

    /// Writes the codes of all voxels of a block, with what is around them, to the same places as in `levels`.
    fn codes<T: Level>(&self, levels: &Levels<T>, block: &Block, nx: usize, ways: &mut Vec<u32>) {
        ways.clear();
        ways.resize(levels.data().len(), UNSEEN | u32::from(OUTSIDE));
        let mut keys = vec![vec![0; nx]; self.classes.len()];
        for s in 1..=block.z.len() {
            for r in 1..=block.y.len() {
                let at = levels.at(r, s);
                let out = &mut ways[at..][..nx];
                dispatch!(self.row(levels, at, &mut keys, out));
            }
        }
    }

    /// The codes of the row of `levels` that begins `at` a place.
    #[inline(always)]
    fn row<T: Level>(&self, levels: &Levels<T>, at: usize, keys: &mut [Vec<u32>], out: &mut [u32]) {
        let own = &levels.data()[at..][..out.len()];
        for (class, keys) in self.classes.iter().zip(keys.iter_mut()) {
            greatest(levels, at, class, keys);
        }
        match &keys {
            // neighbours across faces and, where there are 18, across edges of cubes
            [near] => {
                for ((out, &level), &near) in out.iter_mut().zip(own).zip(near) {
                    *out = self.choose(level.get(), &[near]);
                }
            }
            [near, far] => {
                for (x, (out, &level)) in out.iter_mut().zip(own).enumerate() {
                    *out = self.choose(level.get(), &[near[x], far[x]]);
                }
            }
            keys => {
                let mut here = vec![0; keys.len()];
                for (x, (out, &level)) in out.iter_mut().zip(own).enumerate() {
                    here.iter_mut()
                        .zip(keys.iter())
                        .for_each(|(here, keys)| *here = keys[x]);
                    *out = self.choose(level.get(), &here);
                }
            }
        }
    }

    /// The way of a voxel, whose greatest neighbours of each class have these keys: a code that is not yet followed.
    #[inline(always)]
    fn choose(&self, level: u32, keys: &[u32]) -> u32 {
        if level == 0 {
            return IS_SOLID;
        }
        let own = level << CODE_BITS | u32::from(PEAK);
        let (mut best, mut square) = (own, 1);
        for (class, &key) in self.classes.iter().zip(keys) {
            // what is nearer and as great is as steep
            let steeper = key > best
                && (best == own || {
                    let root = |key: u32| u64::from(self.roots[(key >> CODE_BITS) as usize]);
                    let here = u64::from(self.roots[level as usize]);
                    let [far, near] = [root(key), root(best)].map(|root| root - here);
                    far * far * square >= near * near * class.square
                });
            if steeper {
                (best, square) = (key, class.square);
            }
        }
        UNSEEN | best & CODES
    }
}

/// The key of the greatest neighbour of a class, for each voxel of the row that begins `at` a place.
#[inline(always)]
fn greatest<T: Level>(levels: &Levels<T>, at: usize, class: &Class, keys: &mut [u32]) {
    keys.fill(0);
    let sixes = class.steps.chunks_exact(6);
    let pairs = sixes.remainder().chunks_exact(2);
    for six in sixes {
        rise::<T, 6>(levels, at, six.try_into().expect("6"), keys);
    }
    for pair in pairs {
        rise::<T, 2>(levels, at, pair.try_into().expect("2"), keys);
    }
}

/// Raises keys to those of `N` neighbours.
#[inline(always)]
fn rise<T: Level, const N: usize>(
    levels: &Levels<T>,
    at: usize,
    steps: &[Step; N],
    keys: &mut [u32],
) {
    let by = levels.steps();
    let rows = steps.map(|step| {
        let from = (0..3).fold(at, |at, a| {
            at.wrapping_add_signed(step[a] as isize * by[a] as isize)
        });
        &levels.data()[from..][..keys.len()]
    });
    let codes = steps.map(|step| u32::from(code(step)));
    for (x, key) in keys.iter_mut().enumerate() {
        for i in 0..N {
            *key = (*key).max(rows[i][x].get() << CODE_BITS | codes[i]);
        }
    }
}

/// Where ways of a block end: at a maximum in it, or at the first voxel beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct End {
    /// The maximum, or the voxel beside the block.
    pub voxel: u64,
    /// The level of a maximum, 0 of a voxel beside the block.
    pub level: u32,
    /// The smallest linear index of the voxels whose ways end here.
    pub first: u64,
}

impl End {
    /// The maximum, if it is one.
    pub fn peak(&self) -> Option<Peak> {
        (self.level > 0).then_some(Peak {
            level: self.level,
            voxel: self.voxel,
        })
    }
}

/// Voxels of a row one after the other whose ways have the same end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Piece {
    /// The first one.
    pub start: u16,
    /// The last one.
    pub last: u16,
    /// Number of the end, or of what it became.
    pub end: u32,
}

/// The pieces of rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowPieces {
    /// Where each row begins, and where the last one ends.
    pub rows: Vec<u32>,
    /// All of them, by row and x.
    pub pieces: Vec<Piece>,
}

impl Default for RowPieces {
    fn default() -> Self {
        RowPieces::new()
    }
}

impl RowPieces {
    /// Without rows.
    pub fn new() -> Self {
        RowPieces {
            rows: vec![0],
            pieces: Vec::new(),
        }
    }

    /// Appends a piece to the row that is being made; it grows the last one if it goes on with it.
    pub fn push(&mut self, piece: Piece) {
        let begin = self.rows.last().map_or(0, |&row| row as usize);
        match self.pieces[begin..].last_mut() {
            Some(last)
                if last.end == piece.end && last.last.checked_add(1) == Some(piece.start) =>
            {
                last.last = piece.last;
            }
            _ => self.pieces.push(piece),
        }
    }

    /// Ends a row.
    pub fn end_row(&mut self) {
        self.rows.push(self.pieces.len() as u32);
    }

    /// Appends a row of pieces with other numbers; those that go on with each other become one.
    pub fn push_row(&mut self, row: &[Piece], mut name: impl FnMut(u32) -> u32) {
        for piece in row {
            self.push(Piece {
                end: name(piece.end),
                ..*piece
            });
        }
        self.end_row();
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len() - 1
    }

    /// The pieces of a row.
    pub fn row(&self, row: usize) -> &[Piece] {
        &self.pieces[self.rows[row] as usize..self.rows[row + 1] as usize]
    }

    /// What voxel `x` of a row belongs to, if it is air.
    pub fn at(&self, row: usize, x: u16) -> Option<u32> {
        let row = self.row(row);
        let after = row.partition_point(|piece| piece.start <= x);
        let piece = row[..after].last()?;
        (x <= piece.last).then_some(piece.end)
    }
}

/// The ends of all ways of a block, and which voxels lead to each.
#[derive(Debug)]
pub struct Ends {
    /// In the order of their first voxels.
    pub ends: Vec<End>,
    /// Rows of the block by z and y.
    pub pieces: RowPieces,
}

/// The bits of a code.
const CODES: u32 = (1 << CODE_BITS) - 1;
/// With it, a way is a code; without, it is the number of its end.
const UNSEEN: u32 = 1 << 31;
/// The way of a solid voxel.
const IS_SOLID: u32 = UNSEEN | SOLID as u32;

/// Follows the ways of all voxels of a block, in the memory of `buffer`, which can be used again.
pub fn ends<T: Level>(
    levels: &Levels<T>,
    ways: &Ways,
    dims: Dims,
    block: &Block,
    buffer: &mut Vec<u32>,
) -> Ends {
    let nx = dims.0[0] as usize;
    ways.codes(levels, block, nx, buffer);
    let by = levels.steps();
    let mut moves = [0; 1 << CODE_BITS];
    for (code, by_code) in (0..27).zip(&mut moves) {
        let step = step_of(code);
        *by_code = (0..3).map(|a| step[a] as isize * by[a] as isize).sum();
    }
    let mut follow = Follow {
        moves,
        ways: buffer,
        ends: Vec::new(),
    };
    let mut pieces = RowPieces::new();
    let place = Places { block, by, dims };
    for s in 1..=block.z.len() {
        for r in 1..=block.y.len() {
            let at = levels.at(r, s);
            for x in at..at + nx {
                let way = follow.ways[x];
                if way >= UNSEEN && way != IS_SOLID {
                    follow.from(x, levels, &place);
                }
            }
            push_row(&follow.ways[at..][..nx], &mut pieces);
        }
    }
    Ends {
        ends: follow.ends,
        pieces,
    }
}

fn push_row(ends: &[u32], pieces: &mut RowPieces) {
    let mut x = 0;
    for same in ends.chunk_by(|a, b| a == b) {
        let start = x;
        x += same.len();
        if same[0] != IS_SOLID {
            pieces.push(Piece {
                start: start as u16,
                last: (x - 1) as u16,
                end: same[0],
            });
        }
    }
    pieces.end_row();
}

/// Which voxel of the volume an element of a block's levels is.
struct Places<'a> {
    block: &'a Block,
    by: [usize; 3],
    dims: Dims,
}

impl Places<'_> {
    fn voxel(&self, at: usize) -> u64 {
        let [_, by_y, by_z] = self.by;
        let [x, y, z] = [at % by_y, at % by_z / by_y, at / by_z];
        let [y, z] = [y as u32 + self.block.y.start, z as u32 + self.block.z.start];
        // elements begin one voxel before the block
        self.dims.linear([x as u32 - 1, y - 1, z - 1])
    }
}

struct Follow<'a> {
    /// Elements from a voxel to the next one of a way, by code.
    moves: [isize; 1 << CODE_BITS],
    /// The code of each voxel until its end is known, then the number of that.
    ways: &'a mut [u32],
    ends: Vec<End>,
}

impl Follow<'_> {
    #[inline(always)]
    fn next(&self, at: usize, way: u32) -> usize {
        at.wrapping_add_signed(self.moves[(way & CODES) as usize])
    }

    /// Follows the way of a voxel to its end, and tells it to all voxels on it.
    #[inline]
    fn from<T: Level>(&mut self, from: usize, levels: &Levels<T>, place: &Places) {
        let mut at = from;
        let end = loop {
            let way = self.ways[at];
            if way < UNSEEN {
                break way;
            }
            let code = (way & CODES) as Code;
            if code == PEAK || code == OUTSIDE {
                let level = match code {
                    PEAK => levels.data()[at].get(),
                    _ => 0,
                };
                self.ends.push(End {
                    voxel: place.voxel(at),
                    level,
                    first: place.voxel(from),
                });
                let end = self.ends.len() as u32 - 1;
                self.ways[at] = end;
                break end;
            }
            at = self.next(at, way);
        };
        let mut at = from;
        loop {
            let way = self.ways[at];
            if way < UNSEEN {
                return;
            }
            self.ways[at] = end;
            at = self.next(at, way);
        }
    }
}
