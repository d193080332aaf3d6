//! Paths over neighbouring triangles.
//!
//! A path begins at a triangle with fewest free neighbours, goes to the neighbour with fewest free ones and
//! so on, to the one without a swap on a tie; then on from the first triangle's other side.

use super::starts::Starts;
use super::triangle::{Triangle, Triangles, after, count_mates, half_edge, triangle};
use super::walk::{Ground, NO_TRIANGLE, Turn, USED, count_down};
use crate::sys::unchecked::UncheckedMut;

/// A path over triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path<'a> {
    /// The triangles of the piece.
    pub triangles: Triangles<'a>,
    /// Half-edge over which the first triangle is left; one of its three if it is the only one.
    pub exit: u32,
    /// Turns of the walk that ended at the first triangle, and the half-edge over which it began, where
    /// there was one.
    back: (&'a [Turn], Option<u32>),
    /// Turns of the walk that ended at the last triangle.
    ahead: &'a [Turn],
    /// The half-edge over which that one began.
    from: u32,
    /// Half-edge by which the last triangle is entered, if it is not the first.
    pub end: Option<u32>,
}

impl Path<'_> {
    /// The number of triangles between the first and the last.
    pub(super) fn turns(&self) -> usize {
        self.back.0.len() + usize::from(self.back.1.is_some()) + self.ahead.len()
    }

    /// The triangles between the first and the last: the corner off the edge over which each is entered, and
    /// whether it is left over the edge after that or over the one before.
    #[inline(always)]
    pub(super) fn steps(&self) -> impl DoubleEndedIterator<Item = (u32, bool)> {
        let all = self.triangles;
        let (back, start) = self.back;
        // on the way back it is entered over the edge by which it is left, and turned the other way
        let back = back.iter().rev().map(move |turn| match turn.left() {
            true => (all.first(turn.entry()), false),
            false => (all.last(turn.entry()), true),
        });
        let start = start.map(|h| (all.apex(h), after(h) == self.from));
        let ahead = self.ahead.iter();
        let ahead = ahead.map(move |turn| (all.apex(turn.entry()), turn.left()));
        back.chain(start).chain(ahead)
    }
}

/// Finds paths; holds scratch that is kept from piece to piece.
#[derive(Debug, Default)]
pub(super) struct Greedy {
    /// Per triangle the number of neighbours not yet in a strip, with [`USED`] once it is in one.
    free: Vec<u8>,
    starts: Starts,
    /// Triangles before this one are used.
    cursor: usize,
    /// Turns from a path's start on, then those back from it.
    turns: Vec<Turn>,
}

/// The paths of a piece, one after the other.
pub(super) struct Paths<'a> {
    triangles: Triangles<'a>,
    greedy: &'a mut Greedy,
}

impl Greedy {
    /// The paths of a piece, whose mates it repeats.
    ///
    /// # Panics
    /// If a mate is no half-edge of the piece.
    pub(super) fn paths<'a>(&'a mut self, piece: &'a mut [Triangle]) -> Paths<'a> {
        let triangles = piece.len();
        count_mates(piece, &mut self.free);
        self.starts.reset(triangles);
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
        if self.turns.len() < triangles {
            self.turns.resize(triangles, Turn::default());
        }
        Paths {
            // SAFETY: mates are half-edges of the piece, as was asserted, and nothing is asked for but at
            // these and at those of triangles that have a count
            triangles: unsafe { Triangles::new(piece) },
            greedy: self,
        }
    }

    fn start(&mut self) -> Option<u32> {
        if let Some(t) = self.starts.pop(&self.free) {
            return Some(t);
        }
        let all_used = u64::from_ne_bytes([USED; 8]);
        let (eights, _) = self.free[self.cursor..].as_chunks();
        let is_free = |&eight: &[u8; 8]| u64::from_ne_bytes(eight) & all_used != all_used;
        let used = eights.iter().position(is_free);
        self.cursor += 8 * used.unwrap_or(eights.len());
        let used = self.free[self.cursor..].iter().position(|&f| f < USED);
        self.cursor += used?;
        Some(self.cursor as u32)
    }

    /// Takes the first triangle of a strip; returns its half-edges to free neighbours, that with fewest
    /// free ones first, and no more than two.
    fn exits(&mut self, t: u32, piece: Triangles) -> [Option<u32>; 2] {
        self.free[t as usize] |= USED;
        let mut exits = [(USED, None); 2];
        for h in half_edge(t)..half_edge(t) + 3 {
            let neighbour = triangle(piece.mate(h));
            let free = count_down(&mut self.free[neighbour as usize]);
            self.starts.push(free, neighbour);
            if free < exits[0].0 {
                exits = [(free, Some(h)), exits[0]];
            } else if free < exits[1].0 {
                exits[1] = (free, Some(h));
            }
        }
        self.free[0] = NO_TRIANGLE;
        exits.map(|(_, h)| h)
    }
}

impl Paths<'_> {
    /// Finds the next one.
    pub(super) fn next(&mut self) -> Option<Path<'_>> {
        let triangles = self.triangles;
        let t = self.greedy.start()?;
        let [exit, back] = self.greedy.exits(t, triangles);
        let Some(exit) = exit else {
            return Some(Path {
                triangles,
                exit: half_edge(t),
                back: (&[], None),
                ahead: &[],
                from: half_edge(t),
                end: None,
            });
        };
        let (ahead, end) = self.ground().walk(triangles.mate(exit), false, 0);
        let is_free = |&h: &u32| self.greedy.free[triangle(triangles.mate(h)) as usize] < USED;
        let back = back.filter(is_free);
        let other_end = back.map(|back| {
            let turned_left = after(exit) == back;
            self.ground().walk(triangles.mate(back), turned_left, ahead)
        });
        let (turns, first) = other_end.unwrap_or((ahead, exit));
        let (ahead, rest) = self.greedy.turns.split_at(ahead);
        Some(Path {
            triangles,
            exit: first,
            back: (&rest[..turns - ahead.len()], back),
            ahead,
            from: exit,
            end: Some(end),
        })
    }

    fn ground(&mut self) -> Ground<'_> {
        let greedy = &mut *self.greedy;
        Ground {
            triangles: self.triangles,
            // SAFETY: every triangle has a count
            free: unsafe { UncheckedMut::new(&mut greedy.free) },
            starts: &mut greedy.starts,
            turns: &mut greedy.turns,
        }
    }
}
