//! Paths over neighbouring triangles.

use super::{after, before};

/// Bit of a count that says the triangle is in a strip already.
const USED: u8 = 0x80;

/// Count of triangle 0, which stands for none: it stays used when it is counted down twice.
const NO_TRIANGLE: u8 = 0xC0;

/// What is to be made into strips, half-edge by half-edge; see [`stripify`](super::Stripifier::stripify).
#[derive(Clone, Copy)]
pub(super) struct Mesh<'a> {
    /// The vertex at which each half-edge begins.
    pub corners: &'a [u32],
    /// The half-edge across each.
    pub mates: &'a [u32],
}

impl Mesh<'_> {
    /// The corner of a half-edge's triangle that does not lie on it.
    #[inline(always)]
    pub(super) fn apex(&self, h: u32) -> u32 {
        self.corners[before(h) as usize]
    }
}

/// A strip enters a triangle over an edge, and leaves it: the corner that is new to the strip, and the
/// side to which it turns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step(u32);

impl Step {
    #[inline(always)]
    fn new(apex: u32, left: bool) -> Self {
        Step(apex << 1 | u32::from(left))
    }

    /// The corner off the edge by which the strip enters.
    #[inline(always)]
    pub(super) fn apex(self) -> u32 {
        self.0 >> 1
    }

    /// Whether the strip leaves over the edge after the one by which it enters, or over the one before.
    #[inline(always)]
    pub(super) fn left(self) -> bool {
        self.0 & 1 == 1
    }
}

/// A path over triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path<'a> {
    /// Half-edge over which the first triangle is left; one of its three if it is the only one.
    pub exit: u32,
    /// The triangles between the first and the last.
    pub steps: &'a [Step],
    /// Half-edge by which the last triangle is entered, if it is not the first.
    pub end: Option<u32>,
}

/// Finds the paths of a piece, one after the other.
#[derive(Debug, Default)]
pub(super) struct Greedy {
    /// Per triangle the number of neighbours not yet in a strip, with [`USED`] once it is in one.
    free: Vec<u8>,
    starts: Starts,
    /// Triangles before this one are used.
    cursor: usize,
    /// Steps from a strip's start on.
    ahead: Vec<Step>,
    /// Steps of the whole path, where it goes on behind its start, too.
    whole: Vec<Step>,
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
    /// Begins with a piece.
    pub(super) fn reset(&mut self, mates: &[[u32; 4]]) {
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

    /// The next path: from a triangle with fewest free neighbours to the neighbour with fewest free
    /// ones and so on, to the one without a swap on a tie; then on from the first triangle's other side.
    pub(super) fn next(&mut self, mesh: Mesh) -> Option<Path<'_>> {
        let t = self.start()?;
        self.ahead.clear();
        let [exit, back] = self.exits(t, mesh.mates);
        let Some(exit) = exit else {
            return Some(Path {
                exit: 4 * t,
                steps: &[],
                end: None,
            });
        };
        let mut steps = std::mem::take(&mut self.ahead);
        let end = self.walk::<false>(mesh, exit, false, &mut steps);
        self.ahead = steps;
        let entry_of = |h: u32| mesh.mates[h as usize];
        let Some(back) = back.filter(|&h| self.is_free(entry_of(h))) else {
            return Some(Path {
                exit,
                steps: &self.ahead,
                end: Some(end),
            });
        };
        let mut steps = std::mem::take(&mut self.whole);
        steps.clear();
        let start = self.walk::<true>(mesh, back, after(exit) == back, &mut steps);
        steps.reverse();
        steps.push(Step::new(mesh.apex(back), after(back) == exit));
        steps.extend_from_slice(&self.ahead);
        self.whole = steps;
        Some(Path {
            exit: start,
            steps: &self.whole,
            end: Some(end),
        })
    }

    fn start(&mut self) -> Option<u32> {
        if let Some(t) = self.starts.pop(&self.free) {
            return Some(t);
        }
        let unused = self.free[self.cursor..].iter().position(|f| f & USED == 0);
        self.cursor += unused?;
        Some(self.cursor as u32)
    }

    /// Whether the triangle of a half-edge is in no strip yet.
    fn is_free(&self, h: u32) -> bool {
        self.free[(h / 4) as usize] < USED
    }

    /// Counts the free neighbours of the triangle of `mate` down; returns the count. That of triangle 0
    /// must be set again after three at most.
    #[inline(always)]
    fn count_down(&mut self, mate: u32) -> u8 {
        let free = self.free[(mate / 4) as usize] - 1;
        self.free[(mate / 4) as usize] = free;
        free
    }

    /// Takes the first triangle of a strip; returns its half-edges to free neighbours, that with fewest
    /// free ones first, and no more than two.
    fn exits(&mut self, t: u32, mates: &[u32]) -> [Option<u32>; 2] {
        self.free[t as usize] |= USED;
        let mut exits = [(USED, None); 2];
        for h in 4 * t..4 * t + 3 {
            let mate = mates[h as usize];
            let free = self.count_down(mate);
            self.starts.push(free, mate / 4);
            if free < exits[0].0 {
                exits = [(free, Some(h)), exits[0]];
            } else if free < exits[1].0 {
                exits[1] = (free, Some(h));
            }
        }
        self.free[0] = NO_TRIANGLE;
        exits.map(|(_, h)| h)
    }

    /// Takes the triangles of a path from the one across `exit` on, until there is no free neighbour;
    /// returns the half-edge by which the last one is entered. Steps are those of the way there, or, if
    /// `BACK`, of the way back.
    #[inline(always)]
    fn walk<const BACK: bool>(
        &mut self,
        mesh: Mesh,
        exit: u32,
        mut turned_left: bool,
        steps: &mut Vec<Step>,
    ) -> u32 {
        let mut entry = mesh.mates[exit as usize];
        loop {
            self.free[(entry / 4) as usize] |= USED;
            let edges = [after(entry), before(entry)];
            let [left, right] = edges.map(|h| mesh.mates[h as usize]);
            let (free_left, free_right) = (self.count_down(left), self.count_down(right));
            self.free[0] = NO_TRIANGLE;
            if free_left.min(free_right) >= USED {
                return entry;
            }
            // On a tie not to the side it did turn to. Compiled without a branch; with one that is forced it
            // takes as long, since half of the turns cannot be foretold.
            let turn_right = free_right < free_left + u8::from(turned_left);
            let (other, free) = if turn_right {
                (left, free_left)
            } else {
                (right, free_right)
            };
            // the other one may be a start
            self.starts.push(free, other / 4);
            steps.push(match (BACK, turn_right) {
                (false, _) => Step::new(mesh.corners[edges[1] as usize], !turn_right),
                // on the way back it is entered over the edge by which it is left, and turned the other way
                (true, false) => Step::new(mesh.corners[entry as usize], false),
                (true, true) => Step::new(mesh.corners[edges[0] as usize], true),
            });
            entry = if turn_right { right } else { left };
            turned_left = !turn_right;
        }
    }
}
