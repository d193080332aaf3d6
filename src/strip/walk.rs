//! Walks over free triangles.

use super::starts::Starts;
use super::triangle::{Triangles, triangle};
use crate::sys::unchecked::UncheckedMut;
use std::hint::select_unpredictable as select;

/// Bit of a count that says the triangle is in a strip already.
pub(super) const USED: u8 = 0x80;

/// Count of triangle 0, which stands for none: it stays used when it is counted down twice.
pub(super) const NO_TRIANGLE: u8 = 0xC0;

/// Counts a triangle's free neighbours down; returns the count. That of triangle 0 must be set again after
/// three at most.
#[inline(always)]
pub(super) fn count_down(count: &mut u8) -> u8 {
    *count = count.wrapping_sub(1);
    *count
}

/// A triangle of a walk between its ends: the half-edge over which it is entered, and whether it is left
/// over the edge after that or over the one before.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Turn(u32);

impl Turn {
    #[inline(always)]
    fn new(entry: u32, left: bool) -> Self {
        Turn(entry << 1 | u32::from(left))
    }

    #[inline(always)]
    pub(super) fn entry(self) -> u32 {
        self.0 >> 1
    }

    #[inline(always)]
    pub(super) fn left(self) -> bool {
        self.0 & 1 == 1
    }
}

/// What a walk goes over.
pub(super) struct Ground<'a> {
    pub triangles: Triangles<'a>,
    /// By triangle the number of free neighbours, or [`USED`].
    pub free: UncheckedMut<'a, u8>,
    pub starts: &'a mut Starts,
    /// Room for those of all triangles.
    pub turns: &'a mut [Turn],
}

/// Where a walk is.
#[derive(Clone, Copy)]
struct At {
    /// The half-edge over which its triangle, not in a strip yet, is entered.
    entry: u32,
    /// The half-edges across the edge after that and the one before it.
    across: [u32; 2],
    /// 1 if the last turn was to the left.
    turned_left: u32,
    /// Turns so far.
    turns: usize,
}

impl Ground<'_> {
    /// Counts the free neighbours of a triangle down.
    #[inline(always)]
    fn count_down(&mut self, triangle: u32) -> u32 {
        u32::from(count_down(self.free.at_mut(triangle as usize)))
    }

    /// Takes the triangle and goes to the neighbour with fewest free ones, if there is a free one, on a
    /// tie not to the side to which it did turn.
    ///
    /// Nothing hangs on a branch but the end: half of the turns cannot be foretold. And nothing waits for
    /// the choice but to be chosen: what is across the next triangle is loaded for both neighbours.
    #[inline(always)]
    fn step(&mut self, at: &mut At) -> bool {
        let [left, right] = at.across;
        *self.free.at_mut(triangle(at.entry) as usize) |= USED;
        let (to_left, to_right) = (triangle(left), triangle(right));
        let (free_left, free_right) = (self.count_down(to_left), self.count_down(to_right));
        *self.free.at_mut(0) = NO_TRIANGLE;
        if free_left & free_right >= u32::from(USED) {
            return false;
        }
        let turn_right = free_right < free_left + at.turned_left;
        let beyond = [left, right].map(|entry| self.triangles.across(entry));
        // the other one may be a start
        let other = select(turn_right, to_left, to_right);
        let free = select(turn_right, free_left, free_right);
        self.starts.push(free as u8, other);
        self.turns[at.turns] = Turn::new(at.entry, !turn_right);
        *at = At {
            entry: select(turn_right, right, left),
            across: [0, 1].map(|i| select(turn_right, beyond[1][i], beyond[0][i])),
            turned_left: u32::from(!turn_right),
            turns: at.turns + 1,
        };
        true
    }

    /// Walks from the triangle that is entered over a half-edge, after a turn to the left or to the right, until
    /// there is no free neighbour. Its turns are written from `turns` on; returns where they end, and the
    /// half-edge over which the last triangle is entered.
    pub(super) fn walk(&mut self, entry: u32, turned_left: bool, turns: usize) -> (usize, u32) {
        let mut at = At {
            entry,
            across: self.triangles.across(entry),
            turned_left: u32::from(turned_left),
            turns,
        };
        while self.step(&mut at) {}
        (at.turns, at.entry)
    }
}
