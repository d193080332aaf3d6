//! Triangles at which paths may begin.

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
    /// Forgets all, and makes room for as many triangles in each stack.
    pub(super) fn reset(&mut self, triangles: usize) {
        self.room = triangles;
        if self.entries.len() < 3 * triangles + 1 {
            self.entries.resize(3 * triangles + 1, 0);
        }
        for stack in 0..3 {
            self.end[stack] = 1 + stack * triangles;
        }
    }

    /// Pushes a triangle with so many free neighbours, if these are fewer than 3.
    #[inline(always)]
    pub(super) fn push(&mut self, free: u8, t: u32) {
        let end = &mut self.end[usize::from(free)];
        self.entries[*end] = t;
        *end += usize::from(free < 3);
    }

    /// The triangle pushed last that still has as few free neighbours as when it was pushed.
    pub(super) fn pop(&mut self, free: &[u8]) -> Option<u32> {
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
