//! Paths over neighbouring triangles.
//!
//! A path begins at a triangle with fewest free neighbours, goes to the neighbour with fewest free ones and
//! so on, to the one without a swap on a tie; then on from the first triangle's other side.

use super::triangle::{Triangle, Triangles, after, count_mates, half_edge, triangle};
use super::walk::{At, Ground, NO_TRIANGLE, Turn, USED, count_down};

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
    pub(super) fn steps(&self) -> impl Iterator<Item = (u32, bool)> {
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

/// Finds the paths of a piece, one after the other.
#[derive(Debug, Default)]
pub(super) struct Greedy {
    /// Per triangle the number of neighbours not yet in a strip, with [`USED`] once it is in one.
    free: Vec<u8>,
    starts: Starts,
    /// Triangles before this one are used.
    cursor: usize,
    /// Turns from a path's start on, then those back from it.
    turns: Vec<Turn>,
    /// Where its walk is.
    at: At,
    path: Open,
}

/// A path in the making.
#[derive(Debug, Clone, Copy, Default)]
struct Open {
    /// Half-edge over which the walk ahead left the first triangle.
    exit: u32,
    /// Another one to a neighbour that was free.
    back: Option<u32>,
    /// Once the walk ahead has ended: its turns, and the half-edge by which its last triangle is entered.
    ahead: Option<(usize, u32)>,
}

/// Stacks of triangles with 0, 1 and 2 free neighbours. Entries go stale when the number falls; every
/// unused triangle with that number is in its stack.
///
/// One array holds them: a number only falls, so no triangle is twice in a stack. Its first element takes
/// what belongs to none, each on top of the one before, since whether there is anything to push cannot
/// be foretold and a branch on it costs more than the push.
#[derive(Debug)]
pub(super) struct Starts {
    entries: Vec<u32>,
    /// Where each stack begins behind that element: all have the same room.
    room: usize,
    /// By number where its stack ends; the first element for those without one.
    end: [usize; 256],
}

impl Default for Starts {
    fn default() -> Self {
        Starts {
            entries: Vec::new(),
            room: 0,
            end: [0; 256],
        }
    }
}

impl Starts {
    fn reset(&mut self, triangles: usize) {
        self.room = triangles;
        if self.entries.len() < 3 * triangles + 1 {
            self.entries.resize(3 * triangles + 1, 0);
        }
        for stack in 0..3 {
            self.end[stack] = 1 + stack * triangles;
        }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, free: u8, t: u32) {
        let end = &mut self.end[usize::from(free)];
        self.entries[*end] = t;
        *end += usize::from(free < 3);
    }

    /// The triangle pushed last that still has as few free neighbours as when it was pushed.
    fn pop(&mut self, free: &[u8]) -> Option<u32> {
        for (stack, end) in self.end[..3].iter_mut().enumerate() {
            let start = 1 + stack * self.room;
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

impl Greedy {
    /// Begins with a piece.
    pub(super) fn take(&mut self, piece: &[Triangle]) {
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
    }

    /// Begins the next path; returns whether it has more than one triangle, and so is to be walked.
    pub(super) fn begin(&mut self, piece: Triangles) -> Option<bool> {
        let t = self.start()?;
        let [exit, back] = self.exits(t, piece);
        self.path = Open {
            exit: exit.unwrap_or(half_edge(t)),
            back,
            ahead: None,
        };
        self.at = At {
            entry: piece.mate(self.path.exit),
            turned_left: 0,
            turns: 0,
        };
        Some(exit.is_some())
    }

    /// What the walk goes over, and where it is.
    ///
    /// # Safety
    /// `piece` is the one that was taken.
    pub(super) unsafe fn ground<'a>(
        &'a mut self,
        piece: Triangles<'a>,
    ) -> (Ground<'a>, &'a mut At) {
        let turns = &mut self.turns[..self.free.len()];
        // SAFETY: mates are half-edges of the piece, as was asserted when it was taken, so their triangles are
        // inside, and have a count; and every walk begins at a mate
        let ground = unsafe { Ground::new(piece.0, &mut self.free, &mut self.starts, turns) };
        (ground, &mut self.at)
    }

    /// After the end of a walk: begins the one from the first triangle's other side, if there is one.
    pub(super) fn turn_back(&mut self, piece: Triangles) -> bool {
        if self.path.ahead.is_some() {
            return false;
        }
        self.path.ahead = Some((self.at.turns, self.at.entry));
        let is_free = |&h: &u32| self.free[triangle(piece.mate(h)) as usize] < USED;
        self.path.back = self.path.back.filter(is_free);
        let Some(back) = self.path.back else {
            return false;
        };
        self.at.entry = piece.mate(back);
        self.at.turned_left = u8::from(after(self.path.exit) == back);
        true
    }

    /// The path, after its walks.
    pub(super) fn path<'a>(&'a self, triangles: Triangles<'a>) -> Path<'a> {
        let Open { exit, back, ahead } = self.path;
        let (turns, end) = ahead.unzip();
        let (ahead, rest) = self.turns.split_at(turns.unwrap_or(0));
        Path {
            triangles,
            exit: if back.is_some() { self.at.entry } else { exit },
            back: (&rest[..self.at.turns - ahead.len()], back),
            ahead,
            from: exit,
            end,
        }
    }

    fn start(&mut self) -> Option<u32> {
        if let Some(t) = self.starts.pop(&self.free) {
            return Some(t);
        }
        let unused = self.free[self.cursor..].iter().position(|f| f & USED == 0);
        self.cursor += unused?;
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
