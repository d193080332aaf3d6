//! Walks over free triangles, one at a time or two in turns.

use super::greedy::Starts;
use super::triangle::{after, before, triangle};
use crate::unchecked::{Unchecked, UncheckedMut};
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

/// Where a walk is.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct At {
    /// The half-edge over which its triangle, not in a strip yet, is entered.
    pub entry: u32,
    /// 1 if the last turn was to the left.
    pub turned_left: u8,
    /// Turns so far.
    pub turns: usize,
}

/// What a walk goes over.
pub(super) struct Ground<'a> {
    /// By half-edge its mate, see [`Triangles`](super::triangle::Triangles).
    mates: Unchecked<'a, u32>,
    /// By triangle the number of free neighbours, or [`USED`].
    free: UncheckedMut<'a, u8>,
    starts: &'a mut Starts,
    turns: &'a mut [Turn],
}

impl<'a> Ground<'a> {
    /// # Safety
    /// The numbers at all half-edges of triangles of which `free` has an element are such half-edges. The
    /// walk begins at one of them.
    #[inline(always)]
    pub(super) unsafe fn new(
        mates: &'a [u32],
        free: &'a mut [u8],
        starts: &'a mut Starts,
        turns: &'a mut [Turn],
    ) -> Self {
        // SAFETY: as the caller promises
        let (mates, free) = unsafe { (Unchecked::new(mates), UncheckedMut::new(free)) };
        Ground {
            mates,
            free,
            starts,
            turns,
        }
    }

    /// Counts the free neighbours of the triangle of `mate` down.
    #[inline(always)]
    fn count_down(&mut self, mate: u32) -> u8 {
        count_down(self.free.at_mut(triangle(mate) as usize))
    }

    /// Takes the triangle and goes to the neighbour with fewest free ones, if there is a free one, on a
    /// tie not to the side to which it did turn.
    ///
    /// Nothing hangs on a branch but the end: half of the turns cannot be foretold.
    #[inline(always)]
    fn step(&mut self, at: &mut At) -> bool {
        let entry = at.entry;
        *self.free.at_mut(triangle(entry) as usize) |= USED;
        let [left, right] = [after(entry), before(entry)].map(|h| self.mates.at(h as usize));
        let (free_left, free_right) = (self.count_down(left), self.count_down(right));
        *self.free.at_mut(0) = NO_TRIANGLE;
        if free_left & free_right >= USED {
            return false;
        }
        let turn_right = free_right < free_left.wrapping_add(at.turned_left);
        // the other one may be a start
        let other = select(turn_right, triangle(left), triangle(right));
        self.starts
            .push(select(turn_right, free_left, free_right), other);
        self.turns[at.turns] = Turn::new(entry, !turn_right);
        *at = At {
            entry: select(turn_right, right, left),
            turned_left: u8::from(!turn_right),
            turns: at.turns + 1,
        };
        true
    }
}

/// Walks until there is no free neighbour.
pub(super) fn walk(mut ground: Ground, at: &mut At) {
    let mut here = *at;
    while ground.step(&mut here) {}
    *at = here;
}

/// Walks over two pieces in turns until one of them has no free neighbour; returns whether it is the first.
///
/// Each step of a walk waits for what the one before has loaded, but not for those of the other walk.
pub(super) fn walk_both(mut grounds: [Ground; 2], [at, other]: [&mut At; 2]) -> bool {
    let [ground, second] = &mut grounds;
    let (mut here, mut there) = (*at, *other);
    let first = loop {
        if !ground.step(&mut here) {
            break true;
        }
        if !second.step(&mut there) {
            break false;
        }
    };
    (*at, *other) = (here, there);
    first
}
