//! What makes the strips of one piece, walk by walk.

use super::Faces;
use super::greedy::Greedy;
use super::{walk, write};

/// A piece in the making.
#[derive(Debug, Default)]
pub(super) struct Lane {
    /// Which one it is.
    pub piece: usize,
    /// Strips so far.
    pub strips: usize,
    greedy: Greedy,
    strip: write::Strip,
    stitcher: write::Stitcher,
}

impl Lane {
    /// Takes a piece, and makes strips up to the first walk; false if there is none.
    pub(super) fn take(&mut self, piece: usize, faces: Faces) -> bool {
        (self.piece, self.strips) = (piece, 0);
        self.stitcher.clear();
        self.greedy.take(faces);
        self.begin()
    }

    /// Makes strips of one triangle until there is something to walk; false at the piece's end.
    fn begin(&mut self) -> bool {
        while let Some(walks) = self.greedy.begin() {
            if walks {
                return true;
            }
            self.end_strip();
        }
        false
    }

    /// After the end of a walk, up to the next one; false at the piece's end.
    pub(super) fn go_on(&mut self) -> bool {
        self.greedy.turn_back() || {
            self.end_strip();
            self.begin()
        }
    }

    fn end_strip(&mut self) {
        self.strip.write(&self.greedy.path());
        self.stitcher.push(&self.strip);
        self.strips += 1;
    }

    /// Walks to the end.
    pub(super) fn walk(&mut self) {
        let (ground, at) = self.greedy.ground();
        walk::walk(ground, at);
    }

    /// Appends all strips as one.
    pub(super) fn write(&self, out: &mut Vec<u32>) {
        self.stitcher.write(out);
    }
}

/// Walks in both lanes until one comes to its end; returns whether it is the first.
pub(super) fn walk_both(a: &mut Lane, b: &mut Lane) -> bool {
    let (ground, at) = a.greedy.ground();
    let (second, other) = b.greedy.ground();
    walk::walk_both([ground, second], [at, other])
}
