//! The first strips: greedy paths over triangle neighbours.

use super::crossings::{CROSSING, Crossings, after, before, edges};

/// Bit of a count that says the triangle is in a strip already.
const USED: u8 = 0x80;

/// Count of triangle 0, which stands for none: it stays used when it is counted down twice.
const NO_TRIANGLE: u8 = 0xC0;

/// Scratch of the greedy stage.
#[derive(Debug, Default)]
pub(super) struct Greedy {
    /// Per triangle the number of neighbours not yet in a strip, with [`USED`] once it is in one.
    free: Vec<u8>,
    starts: Starts,
    /// Triangles before this one are used.
    cursor: usize,
}

/// Stacks of triangles with 0, 1 and 2 free neighbours. Entries go stale when the number falls; every
/// unused triangle with that number is in its stack.
///
/// One array holds them: a number only falls, so no triangle is twice in a stack. A fourth stack takes
/// what belongs to none, each on top of the one before, since whether there is anything to push cannot
/// be foretold and a branch on it costs more than the push.
#[derive(Debug, Default)]
struct Starts {
    entries: Vec<u32>,
    /// Where each stack begins: all have the same room.
    room: usize,
    /// Where each stack ends.
    end: [usize; 4],
}

impl Starts {
    fn reset(&mut self, triangles: usize) {
        self.room = triangles;
        self.entries.resize(3 * triangles + 1, 0);
        self.end = [0, triangles, 2 * triangles, 3 * triangles];
    }

    #[inline(always)]
    fn push(&mut self, free: u8, t: u32) {
        let stack = usize::from(free.min(3));
        let end = &mut self.end[stack];
        self.entries[*end] = t;
        *end += usize::from(stack != 3);
    }

    /// The triangle pushed last that still has as few free neighbours as when it was pushed.
    fn pop(&mut self, free: &[u8]) -> Option<u32> {
        for (stack, end) in self.end[..3].iter_mut().enumerate() {
            let start = stack * self.room;
            let entries = &self.entries[start..*end];
            let live = |t: &u32| usize::from(free[*t as usize]) == stack;
            let found = entries.iter().rposition(live);
            *end = start + found.unwrap_or(0);
            if let Some(at) = found {
                return Some(entries[at]);
            }
        }
        None
    }
}

/// Number of mates of a triangle; the fourth means nothing.
#[inline(always)]
fn neighbours(m: &[u32; 4]) -> u8 {
    // two at a time: bit 31 of a half is set by the sum where any lower bit of it is
    const LOWER: u64 = 0x7fff_ffff_7fff_ffff;
    let some = |a: u32, b: u32| {
        let pair = u64::from(a) | u64::from(b) << 32;
        let some = ((pair & LOWER) + LOWER) | pair;
        (some >> 31) & 0x1_0000_0001
    };
    let count = some(m[0], m[1]) + some(m[2], 0);
    (count + (count >> 32)) as u8
}

impl Greedy {
    /// Labels every triangle: a strip starts at a triangle with fewest free neighbours, and goes on
    /// to the neighbour with fewest free neighbours, to the one without a swap on a tie.
    pub(super) fn label(&mut self, crossings: &mut Crossings) {
        self.reset(crossings.mates);
        while let Some(t) = self.start() {
            crossings.ends.push(t);
            let last = self.path(t, crossings);
            if last != t {
                crossings.ends.push(last);
            }
        }
    }

    fn reset(&mut self, mates: &[u32]) {
        let (mates, _) = mates.as_chunks::<4>();
        self.starts.reset(mates.len());
        self.free.clear();
        self.free.extend(mates.iter().map(neighbours));
        if let Some(first) = self.free.first_mut() {
            *first = NO_TRIANGLE;
        }
        for (i, eight) in self.free.chunks(8).enumerate().rev() {
            if eight == [3; 8] {
                continue; // inside the piece, as nearly all are
            }
            for (t, &free) in eight.iter().enumerate().rev() {
                if free < 3 {
                    self.starts.push(free, (8 * i + t) as u32);
                }
            }
        }
        self.cursor = 0;
    }

    fn start(&mut self) -> Option<u32> {
        if let Some(t) = self.starts.pop(&self.free) {
            return Some(t);
        }
        let unused = self.free[self.cursor..].iter().position(|f| f & USED == 0);
        self.cursor += unused?;
        Some(self.cursor as u32)
    }

    /// Counts the free neighbours of the triangle of `mate` down; returns the count. That of triangle 0
    /// must be set again after two at most.
    #[inline(always)]
    fn count_down(&mut self, mate: u32) -> u8 {
        let free = self.free[(mate / 4) as usize] - 1;
        self.free[(mate / 4) as usize] = free;
        free
    }

    /// Labels the triangles of one strip from `t` on; returns the last.
    fn path(&mut self, t: u32, crossings: &mut Crossings) -> u32 {
        let Some(exit) = self.leave_first(t, crossings.mates) else {
            crossings.skip(4 * t);
            return t;
        };
        crossings.skip(after(exit));
        let mut entry = crossings.mates[exit as usize];
        let mut turned_left = false;
        loop {
            let here = entry / 4;
            self.free[here as usize] |= USED;
            let edges = [after(entry), before(entry)];
            let [left, right] = edges.map(|h| crossings.mates[h as usize]);
            let (free_left, free_right) = (self.count_down(left), self.count_down(right));
            self.free[0] = NO_TRIANGLE;
            if free_left.min(free_right) >= USED {
                crossings.states[here as usize] = CROSSING[(edges[0] % 4) as usize];
                return here;
            }
            // On a tie not to the side it did turn to. A branch, as compiled: most turns can be foretold,
            // and choosing without one took 23 clocks a step for 16.
            let turn_right = free_right < free_left + u8::from(turned_left);
            let (skipped, other, free) = if turn_right {
                (edges[0], left, free_left)
            } else {
                (edges[1], right, free_right)
            };
            // the other one may be a start
            self.starts.push(free, other / 4);
            entry = if turn_right { right } else { left };
            crossings.states[here as usize] = CROSSING[(skipped % 4) as usize];
            turned_left = !turn_right;
        }
    }

    /// Takes the first triangle of a strip; returns its half-edge to the neighbour to go on with, if
    /// any: the first of those with fewest free neighbours.
    fn leave_first(&mut self, t: u32, mates: &[u32]) -> Option<u32> {
        self.free[t as usize] |= USED;
        let (mut exit, mut fewest) = (None, USED);
        for h in edges(t) {
            let mate = mates[h as usize];
            let free = self.count_down(mate);
            self.free[0] = NO_TRIANGLE;
            self.starts.push(free, mate / 4);
            if free < fewest {
                (exit, fewest) = (Some(h), free);
            }
        }
        exit
    }
}
