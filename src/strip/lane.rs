//! What makes the strips of one piece, walk by walk.

use super::greedy::Greedy;
use super::triangle::{Triangle, Triangles};
use super::walk::{self, At, Ground};
use super::write::{Stitcher, Strip};

/// What is kept from piece to piece.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    greedy: Greedy,
    strip: Strip,
    stitcher: Stitcher,
}

/// A piece in the making.
#[derive(Debug)]
pub(super) struct Lane<'a> {
    /// Which one it is.
    pub number: usize,
    /// Strips so far.
    pub strips: usize,
    piece: Triangles<'a>,
    scratch: &'a mut Scratch,
}

impl<'a> Lane<'a> {
    /// Without a piece.
    pub(super) fn new(scratch: &'a mut Scratch) -> Self {
        let mut lane = Lane {
            number: 0,
            strips: 0,
            piece: Triangles::default(),
            scratch,
        };
        lane.take(0, &[]);
        lane
    }

    /// Takes a piece, and makes strips up to the first walk; false if there is none.
    pub(super) fn take(&mut self, number: usize, piece: &'a [Triangle]) -> bool {
        (self.number, self.strips) = (number, 0);
        self.scratch.stitcher.clear();
        self.scratch.greedy.take(piece);
        self.piece = Triangles::new(piece);
        self.begin()
    }

    /// Makes strips of one triangle until there is something to walk; false at the piece's end.
    fn begin(&mut self) -> bool {
        while let Some(walks) = self.scratch.greedy.begin(self.piece) {
            if walks {
                return true;
            }
            self.end_strip();
        }
        false
    }

    /// After the end of a walk, up to the next one; false at the piece's end.
    pub(super) fn go_on(&mut self) -> bool {
        self.scratch.greedy.turn_back(self.piece) || {
            self.end_strip();
            self.begin()
        }
    }

    fn end_strip(&mut self) {
        let Scratch {
            greedy,
            strip,
            stitcher,
        } = &mut *self.scratch;
        strip.write(&greedy.path(self.piece));
        stitcher.push(strip);
        self.strips += 1;
    }

    fn ground(&mut self) -> (Ground<'_>, &mut At) {
        // SAFETY: the piece that was taken last
        unsafe { self.scratch.greedy.ground(self.piece) }
    }

    /// Walks to the end.
    pub(super) fn walk(&mut self) {
        let (ground, at) = self.ground();
        walk::walk(ground, at);
    }

    /// Appends all strips as one.
    pub(super) fn write(&self, out: &mut Vec<u32>) {
        self.scratch.stitcher.write(out);
    }
}

/// Walks in both lanes until one comes to its end; returns whether it is the first.
pub(super) fn walk_both(a: &mut Lane, b: &mut Lane) -> bool {
    let (ground, at) = a.ground();
    let (second, other) = b.ground();
    walk::walk_both([ground, second], [at, other])
}
