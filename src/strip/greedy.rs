//! The first strips: greedy paths over triangle neighbours.

use super::crossings::{CROSSING, Crossings, after, before, edges};

/// Bit of a count that says the triangle is in a strip already.
const USED: u8 = 0x80;

/// Count of triangle 0, which stands for none: it stays used when it is counted down once.
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
    len: [usize; 4],
}

impl Starts {
    fn reset(&mut self, triangles: usize) {
        self.room = triangles;
        self.entries.resize(3 * triangles + 1, 0);
        self.len = [0; 4];
    }

    #[inline(always)]
    fn push(&mut self, free: u8, t: u32) {
        let stack = usize::from(free.min(3));
        self.entries[stack * self.room + self.len[stack]] = t;
        self.len[stack] += usize::from(stack != 3);
    }

    /// The triangle pushed last that still has as few free neighbours as when it was pushed.
    fn pop(&mut self, free: &[u8]) -> Option<u32> {
        for (stack, len) in self.len.iter_mut().enumerate() {
            let entries = &self.entries[stack * self.room..][..*len];
            let live = |t: &u32| usize::from(free[*t as usize]) == stack;
            let found = entries.iter().rposition(live);
            *len = found.unwrap_or(0);
            if let Some(at) = found {
                return Some(entries[at]);
            }
        }
        None
    }
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
        let neighbours = |m: &[u32; 4]| {
            m[..3]
                .iter()
                .map(|&h| u8::from(h != super::NONE))
                .sum::<u8>()
        };
        self.free.extend(mates.iter().map(neighbours));
        if let Some(first) = self.free.first_mut() {
            *first = NO_TRIANGLE;
        }
        for (t, &free) in self.free.iter().enumerate().rev() {
            if free < 3 {
                self.starts.push(free, t as u32);
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

    /// Counts the free neighbours of the triangle of `mate` down, if there is one; returns the count.
    #[inline(always)]
    fn count_down(&mut self, mate: u32) -> u8 {
        let free = self.free[(mate / 4) as usize] - 1;
        self.free[(mate / 4) as usize] = free;
        self.free[0] = NO_TRIANGLE;
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
        let mut turn_left = false;
        loop {
            let here = entry / 4;
            self.free[here as usize] |= USED;
            let (left, right) = (after(entry), before(entry));
            // the side it did turn to is the one to avoid next
            let [first, second] = if turn_left {
                [right, left]
            } else {
                [left, right]
            };
            let (a, b) = (
                crossings.mates[first as usize],
                crossings.mates[second as usize],
            );
            let (free_a, free_b) = (self.count_down(a), self.count_down(b));
            if free_a.min(free_b) >= USED {
                crossings.states[here as usize] = CROSSING[(left % 4) as usize];
                return here;
            }
            // which one it is cannot be foretold, so nothing branches on it
            let turn = free_b < free_a;
            let (skipped, beyond, free) = if turn {
                (first, a, free_a)
            } else {
                (second, b, free_b)
            };
            // the other one is taken at once
            self.starts.push(free, beyond / 4);
            entry = if turn { b } else { a };
            crossings.states[here as usize] = CROSSING[(skipped % 4) as usize];
            turn_left = turn_left == turn;
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
            self.starts.push(free, mate / 4);
            if free < fewest {
                (exit, fewest) = (Some(h), free);
            }
        }
        exit
    }
}
