//! The first strips: greedy paths over triangle neighbours.

use super::NONE;
use super::crossings::{Crossings, after, before};

/// Bit of a count that says the triangle is in a strip already.
const USED: u8 = 0x80;

/// Scratch of the greedy stage.
#[derive(Debug, Default)]
pub(super) struct Greedy {
    /// Per triangle the number of neighbours not yet in a strip, with [`USED`] once it is in one.
    free: Vec<u8>,
    /// Stacks of triangles with 0, 1 and 2 of them. Entries go stale when the number falls; every
    /// unused triangle with that number is in its stack.
    starts: [Vec<u32>; 3],
    /// Triangles before this one are used.
    cursor: usize,
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
        for stack in &mut self.starts {
            stack.clear();
        }
        self.free.clear();
        let neighbours = |m: &[u32]| m.iter().filter(|&&h| h != NONE).count() as u8;
        self.free.extend(mates.chunks_exact(3).map(neighbours));
        for (t, &free) in self.free.iter().enumerate().rev() {
            if free < 3 {
                self.starts[usize::from(free)].push(t as u32);
            }
        }
        self.cursor = 0;
    }

    fn start(&mut self) -> Option<u32> {
        for count in 0..3 {
            while let Some(t) = self.starts[count].pop() {
                if usize::from(self.free[t as usize]) == count {
                    return Some(t);
                }
            }
        }
        let unused = self.free[self.cursor..].iter().position(|f| f & USED == 0);
        self.cursor += unused?;
        Some(self.cursor as u32)
    }

    /// Labels the triangles of one strip from `t` on; returns the last.
    fn path(&mut self, t: u32, crossings: &mut Crossings) -> u32 {
        let mut first = 3 * t;
        let mut entry = None;
        let mut turn_left = false;
        loop {
            let here = first / 3;
            let exit = self.take(here, first, turn_left, crossings.mates);
            let crossed = match (entry, exit) {
                (Some(entry), Some(exit)) => third(entry, exit),
                (Some(end), None) | (None, Some(end)) => after(end),
                (None, None) => 3 * here,
            };
            crossings.skip(crossed);
            let Some(exit) = exit else { return here };
            // the side it did turn to is the one to avoid next
            turn_left = entry.is_some_and(|entry| exit == after(entry));
            let next = crossings.mates[exit as usize];
            entry = Some(next);
            first = if turn_left { before(next) } else { after(next) };
        }
    }

    /// Takes a triangle; returns its half-edge to the neighbour to go on with, if any. Of equals the
    /// half-edge `first` wins.
    fn take(&mut self, t: u32, first: u32, turn_left: bool, mates: &[u32]) -> Option<u32> {
        self.free[t as usize] |= USED;
        let mut exit = None;
        let mut fewest = USED;
        let mut h = first;
        for _ in 0..3 {
            let mate = mates[h as usize];
            if mate != NONE {
                let free = &mut self.free[(mate / 3) as usize];
                *free -= 1;
                let free = *free;
                if free < USED {
                    if free < 3 {
                        self.starts[usize::from(free)].push(mate / 3);
                    }
                    if free < fewest {
                        fewest = free;
                        exit = Some(h);
                    }
                }
            }
            h = if turn_left { before(h) } else { after(h) };
        }
        exit
    }
}

/// The third half-edge of the triangle of two.
fn third(a: u32, b: u32) -> u32 {
    if after(a) == b { after(b) } else { after(a) }
}
