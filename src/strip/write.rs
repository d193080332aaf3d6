//! Writes paths as strips, and strips as one stitched strip.

use super::greedy::Path;
use super::join;
use crate::sys::unchecked::UncheckedMut;
use std::hint::select_unpredictable as select;

/// Entries; behind them is room that means nothing.
#[derive(Debug, Default)]
struct Part {
    entries: Vec<u32>,
    len: usize,
}

impl Part {
    fn get(&self) -> &[u32] {
        &self.entries[..self.len]
    }

    /// Room for so many entries behind the last one.
    fn room(&mut self, more: usize) -> &mut [u32] {
        let end = self.len + more;
        if self.entries.len() < end {
            self.entries.resize(end.max(2 * self.entries.len()), 0);
        }
        &mut self.entries[self.len..end]
    }
}

/// Strips of a piece, sorted by the places where they fit.
///
/// A strip that ends at the parity at which it began fits as it is at even places or at odd ones, and leaves
/// the parity as it is; one that does not fits at both, for backwards it fits where it does not forwards.
/// So the first kind goes behind each other by parity, the second kind between them, and all fit but where
/// no strip turns the parity.
#[derive(Debug, Default)]
pub(super) struct Stitcher {
    /// Strips of even length for even places.
    even: Part,
    /// Strips of odd length.
    between: Part,
    /// Strips of even length for odd places.
    odd: Part,
}

impl Stitcher {
    /// Forgets all strips.
    pub(super) fn clear(&mut self) {
        for part in [&mut self.even, &mut self.between, &mut self.odd] {
            part.len = 0;
        }
    }

    /// Takes a path as a strip, made for places from which its first turn needs no swap.
    pub(super) fn push(&mut self, path: &Path) {
        let left = |turn: Option<(u32, bool)>| turn.map(|(_, left)| left);
        let odd = left(path.steps().next()).unwrap_or(false);
        // where another triangle would stand, see `write`
        let next = left(path.steps().next_back()).unwrap_or(!odd) ^ path.end.is_some();
        let part = match (odd, next) {
            (false, false) => &mut self.even,
            (true, true) => &mut self.odd,
            _ => &mut self.between,
        };
        let backwards = odd != next && odd == part.len.is_multiple_of(2);
        let last = part.get().last().copied();
        let join = if last.is_some() { 2 } else { 0 };
        let room = part.room(join + most_entries(path));
        let len = write(path, odd, &mut room[join..]);
        let strip = &mut room[join..join + len];
        if backwards {
            strip.reverse();
        }
        let first = strip[0];
        if let Some(last) = last {
            room[..2].copy_from_slice(&[last, first]);
        }
        part.len += join + len;
    }

    /// Appends all strips as one to `out`, where its first entry counts as even.
    pub(super) fn write(&self, out: &mut Vec<u32>) {
        let base = out.len();
        for (part, is_odd) in [
            (&self.even, false),
            (&self.between, false),
            (&self.odd, true),
        ] {
            let Some(&first) = part.get().first() else {
                continue;
            };
            if out.len() > base {
                join(out, first);
            }
            if is_odd && (out.len() - base).is_multiple_of(2) {
                out.push(first);
            }
            out.extend_from_slice(part.get());
        }
    }
}

/// Entries of a path, if each step needs a swap.
fn most_entries(path: &Path) -> usize {
    2 * path.turns() + 4
}

/// Writes a path as a strip whose first triangle stands at an odd place, or at an even one; returns the number of
/// entries, [`most_entries`] at most. What is behind them means nothing.
fn write(path: &Path, odd: bool, entries: &mut [u32]) -> usize {
    let (triangles, exit) = (path.triangles, path.exit);
    let (first, last) = (triangles.first(exit), triangles.last(exit));
    let [mut earlier, mut later] = if odd { [last, first] } else { [first, last] };
    entries[..3].copy_from_slice(&[triangles.apex(exit), earlier, later]);
    assert!(entries.len() >= most_entries(path));
    // SAFETY: these are two for each step and 4
    let mut entries = unsafe { UncheckedMut::new(entries) };
    let mut len = 3;
    let mut odd = !odd;
    path.steps().for_each(|(apex, left)| {
        // Triangles at odd places go on to the side before the edge of entry without a swap, those at
        // even ones to the side after it. Two entries are written and one or two kept: a branch would
        // be mispredicted at every second swap.
        let swap = left == odd;
        *entries.at_mut(len) = select(swap, earlier, apex);
        *entries.at_mut(len + 1) = apex;
        len += 1 + usize::from(swap);
        earlier = select(swap, earlier, later);
        later = apex;
        // an entry more or less turns the parity, so that the next triangle is odd after a turn to
        // the left, with a swap or without
        odd = left;
    });
    if let Some(entry) = path.end {
        *entries.at_mut(len) = triangles.apex(entry);
        len += 1;
    }
    len
}
