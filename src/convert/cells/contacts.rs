//! Where two cells of one component touch.

use crate::convert::cells::band::{CellPart, Stretch};
use crate::sys::sorted_spill::Keyed;
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;

/// Two cells that touch, by the faces that their voxels share.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Contact {
    /// The cells, the smaller number first.
    pub cells: [u64; 2],
    /// Faces across each axis: those from the first to the second cell along it less those against it.
    pub faces: [i64; 3],
    /// Faces in all; none if voxels touch at edges alone.
    pub count: u64,
    /// Sums of twice the coordinates of the faces' middles, in voxels.
    pub place: [u64; 3],
}

impl Contact {
    /// Adds what is known of the same two elsewhere.
    pub fn merge(&mut self, other: &Contact) {
        debug_assert_eq!(self.cells, other.cells);
        for axis in 0..3 {
            self.faces[axis] += other.faces[axis];
            self.place[axis] += other.place[axis];
        }
        self.count += other.count;
    }

    /// The middle of all faces, in voxels; `None` if there is no face.
    pub fn middle(&self) -> Option<[f64; 3]> {
        let twice = 2.0 * self.count as f64;
        (self.count > 0).then(|| self.place.map(|sum| sum as f64 / twice))
    }

    /// The length of the sum of its faces, in the square of the unit of `spacing`: the area of a flat opening that is
    /// not seen from the side.
    pub fn area(&self, [x, y, z]: [f64; 3]) -> f64 {
        let size = [y * z, x * z, x * y];
        let along = (0..3).map(|a| self.faces[a] as f64 * size[a]);
        along.map(|v| v * v).sum::<f64>().sqrt()
    }
}

impl Keyed for Contact {
    fn key(&self) -> [u64; 2] {
        self.cells
    }
}

/// Contacts of a band while they are found.
pub struct Contacts<'a> {
    parts: &'a [CellPart],
    found: Vec<Contact>,
    place_of: HashMap<[u32; 2], u32>,
    /// The pair that was looked up last, and its place.
    last: ([u32; 2], u32),
}

impl<'a> Contacts<'a> {
    /// None yet, of these cells.
    pub fn new(parts: &'a [CellPart]) -> Self {
        Contacts {
            parts,
            found: Vec::new(),
            place_of: HashMap::new(),
            last: ([u32::MAX; 2], 0),
        }
    }

    /// Bytes of what is found, of the map half as much again while it grows.
    pub fn bytes(&self) -> u64 {
        (self.found.capacity() * size_of::<Contact>() + self.place_of.capacity() * 24) as u64
    }

    /// What is known of two cells, of which the first lies at the lower end of an axis; and whether that has the smaller
    /// number. `None` if they are one.
    fn of(&mut self, low: u32, high: u32) -> Option<(&mut Contact, bool)> {
        let [a, b] = [low, high].map(|part| self.parts[part as usize].cell);
        if a == b {
            return None;
        }
        if self.last.0 != [low, high] {
            let found = &mut self.found;
            let place = *self.place_of.entry([low, high]).or_insert_with(|| {
                found.push(Contact {
                    cells: [a.min(b), a.max(b)],
                    ..Contact::zeroed()
                });
                found.len() as u32 - 1
            });
            self.last = ([low, high], place);
        }
        Some((&mut self.found[self.last.1 as usize], a < b))
    }

    /// Adds faces across an axis between two cells.
    fn add(&mut self, [low, high]: [u32; 2], axis: usize, count: u32, place: [u64; 3]) {
        if let Some((contact, forward)) = self.of(low, high) {
            let faces = i64::from(count);
            contact.faces[axis] += if forward { faces } else { -faces };
            contact.count += u64::from(count);
            for (sum, place) in contact.place.iter_mut().zip(place) {
                *sum += place;
            }
        }
    }

    /// The neighbours in a row.
    pub fn within(&mut self, row: &[Stretch], [y, z]: [u32; 2]) {
        for pair in row.windows(2) {
            if pair[0].end == pair[1].start && pair[0].cell != pair[1].cell {
                let place = [2 * pair[0].end - 1, 2 * y, 2 * z].map(u64::from);
                self.add([pair[0].cell, pair[1].cell], 0, 1, place);
            }
        }
    }

    /// The neighbours in two rows, of which the first is the lower one. `faces` is the axis across which voxels of the
    /// same x share a face, if they do, and the place of the lower row; with `wide`, voxels a step apart along x are
    /// neighbours, too.
    pub fn between(
        &mut self,
        low: &[Stretch],
        high: &[Stretch],
        wide: bool,
        faces: Option<(usize, [u32; 2])>,
    ) {
        self.shifted(low, high, 0, faces);
        if wide {
            self.shifted(low, high, -1, None);
            self.shifted(low, high, 1, None);
        }
    }

    /// Voxels x of the lower row with voxels x + `dx` of the other one.
    fn shifted(
        &mut self,
        low: &[Stretch],
        high: &[Stretch],
        dx: i64,
        faces: Option<(usize, [u32; 2])>,
    ) {
        let (mut i, mut j) = (0, 0);
        while let (Some(a), Some(b)) = (low.get(i), high.get(j)) {
            let [b_start, b_end] = [b.start, b.end].map(|x| i64::from(x) - dx);
            let start = i64::from(a.start).max(b_start);
            let end = i64::from(a.end).min(b_end);
            if a.cell != b.cell && start < end {
                match faces {
                    Some((axis, [y, z])) => {
                        let (start, count) = (start as u64, (end - start) as u64);
                        let mut middle =
                            [2 * start + count - 1, 2 * u64::from(y), 2 * u64::from(z)];
                        middle[axis] += 1;
                        let place = middle.map(|twice| twice * count);
                        self.add([a.cell, b.cell], axis, count as u32, place);
                    }
                    None => {
                        self.of(a.cell, b.cell);
                    }
                }
            }
            let a_end = i64::from(a.end);
            i += usize::from(a_end <= b_end);
            j += usize::from(b_end <= a_end);
        }
    }

    /// All contacts, one of each pair.
    pub fn finish(mut self) -> Vec<Contact> {
        self.found.sort_unstable_by_key(|contact| contact.cells);
        self.found.dedup_by(|next, kept| {
            let same = next.cells == kept.cells;
            if same {
                kept.merge(next);
            }
            same
        });
        self.found
    }
}
