//! Writes paths as strips, and strips as one stitched strip.

use super::greedy::Path;
use super::join;

/// The entries of one strip, and where they may stand.
#[derive(Debug, Default)]
pub(super) struct Strip {
    entries: Vec<u32>,
    len: usize,
    /// Whether the first triangle is made for an odd place.
    odd: bool,
}

impl Strip {
    /// Writes a path, from that place on from which its first turn needs no swap.
    pub(super) fn write(&mut self, path: &Path) {
        self.odd = path.steps().next().is_some_and(|(_, left)| left);
        // so many, if each step needs a swap; what is behind them means nothing
        let room = 2 * path.turns() + 4;
        if self.entries.len() < room {
            self.entries.resize(room, 0);
        }
        let (triangles, exit) = (path.triangles, path.exit);
        let (first, last) = (triangles.first(exit), triangles.last(exit));
        let [mut earlier, mut later] = if self.odd {
            [last, first]
        } else {
            [first, last]
        };
        let entries = &mut self.entries[..room];
        entries[..3].copy_from_slice(&[triangles.apex(exit), earlier, later]);
        let mut len = 3;
        let mut odd = !self.odd;
        path.steps().for_each(|(apex, left)| {
            // Triangles at odd places go on to the side before the edge of entry without a swap, those at
            // even ones to the side after it. Two entries are written and one or two kept: a branch would
            // be mispredicted at every second swap.
            let swap = left == odd;
            entries[len] = if swap { earlier } else { apex };
            entries[len + 1] = apex;
            len += 1 + usize::from(swap);
            earlier = if swap { earlier } else { later };
            later = apex;
            // an entry more or less turns the parity, so that the next triangle is odd after a turn to
            // the left, with a swap or without
            odd = left;
        });
        if let Some(entry) = path.end {
            entries[len] = triangles.apex(entry);
            len += 1;
        }
        self.len = len;
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
    even: Vec<u32>,
    /// Strips of odd length.
    between: Vec<u32>,
    /// Strips of even length for odd places.
    odd: Vec<u32>,
}

impl Stitcher {
    /// Forgets all strips.
    pub(super) fn clear(&mut self) {
        for part in [&mut self.even, &mut self.between, &mut self.odd] {
            part.clear();
        }
    }

    /// Takes a strip.
    pub(super) fn push(&mut self, strip: &Strip) {
        let entries = &strip.entries[..strip.len];
        if strip.len.is_multiple_of(2) {
            let part = if strip.odd {
                &mut self.odd
            } else {
                &mut self.even
            };
            join(part, entries[0]);
            part.extend_from_slice(entries);
        } else if strip.odd == (self.between.len() % 2 == 1) {
            join(&mut self.between, entries[0]);
            self.between.extend_from_slice(entries);
        } else {
            join(&mut self.between, entries[strip.len - 1]);
            self.between.extend(entries.iter().rev());
        }
    }

    /// Appends all strips as one to `out`, where its first entry counts as even.
    pub(super) fn write(&self, out: &mut Vec<u32>) {
        let base = out.len();
        for (part, is_odd) in [
            (&self.even, false),
            (&self.between, false),
            (&self.odd, true),
        ] {
            let Some(&first) = part.first() else { continue };
            if out.len() > base {
                join(out, first);
            }
            if is_odd && (out.len() - base).is_multiple_of(2) {
                out.push(first);
            }
            out.extend_from_slice(part);
        }
    }
}
