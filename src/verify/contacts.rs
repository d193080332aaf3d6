//! Where cells touch, by the cell of each voxel: faces that their voxels share, macrocube by macrocube.

use super::openings::{NeckRows, Opening};
use super::report::Issues;
use super::spill::Spill;
use super::tile::Context;
use crate::error::Result;
use crate::grid::Ambiguous;
use std::collections::BTreeMap;

/// Records that a sort keeps in memory: 0.6 MiB.
const IN_MEMORY: usize = 1 << 13;
/// Words of a record: the cells, faces across each axis as whole numbers with signs, how many, and where.
const WORDS: usize = 9;

/// Two cells that touch, in a macrocube.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Contact {
    /// Faces across each axis: those from the smaller to the larger id along it less those against it.
    faces: [i64; 3],
    count: u64,
    /// Sums of twice the coordinates of their middles.
    place: [u64; 3],
}

/// Contacts as records.
pub(super) type Contacts = Vec<[u64; WORDS]>;

/// Voxels that are neighbours, as steps from the lower corner of a cube of eight: those that share a face, then those that
/// share an edge.
const FACES: [[[i32; 3]; 2]; 3] = [
    [[0, 0, 0], [1, 0, 0]],
    [[0, 0, 0], [0, 1, 0]],
    [[0, 0, 0], [0, 0, 1]],
];
const EDGES: [[[i32; 3]; 2]; 6] = [
    [[0, 0, 0], [1, 1, 0]],
    [[1, 0, 0], [0, 1, 0]],
    [[0, 0, 0], [1, 0, 1]],
    [[1, 0, 0], [0, 0, 1]],
    [[0, 0, 0], [0, 1, 1]],
    [[0, 1, 0], [0, 0, 1]],
];

/// The contacts of a macrocube of voxels from `lo` to `hi`, in a grid whose last one is `end`. What has its lower corner in
/// a plane that the next macrocube begins with is counted there. `cells` writes those of the slice at a z, 0 for voxels
/// above.
pub(super) fn of_cube(
    [lo, hi, end]: [[i32; 3]; 3],
    rule: Ambiguous,
    mut cells: impl FnMut(i32, &mut Vec<u64>),
) -> Contacts {
    let edges: &[_] = match rule {
        Ambiguous::Separate => &EDGES,
        Ambiguous::Join => &[],
    };
    let width = (hi[0] - lo[0] + 1) as usize;
    let mut found: BTreeMap<[u64; 2], Contact> = BTreeMap::new();
    let mut slices = [Vec::new(), Vec::new()];
    cells(lo[2], &mut slices[1]);
    let own = |a: usize| lo[a]..hi[a] + i32::from(hi[a] == end[a]);
    for z in own(2) {
        slices.swap(0, 1);
        if z < hi[2] {
            cells(z + 1, &mut slices[1]);
        }
        for y in own(1) {
            for x in own(0) {
                let low = [x, y, z];
                for (i, pair) in FACES.iter().chain(edges).enumerate() {
                    let ends = pair.map(|step| [0, 1, 2].map(|a| low[a] + step[a]));
                    let reach: [i32; 3] = std::array::from_fn(|a| pair[0][a].max(pair[1][a]));
                    if (0..3).any(|a| low[a] + reach[a] > hi[a]) {
                        continue;
                    }
                    let [a, b] = ends.map(|[x, y, z_of]| {
                        let row = (y - lo[1]) as usize * width;
                        slices[(z_of - z) as usize][row + (x - lo[0]) as usize]
                    });
                    if a != b && a != 0 && b != 0 {
                        let contact = found.entry([a.min(b), a.max(b)]).or_default();
                        if i < FACES.len() {
                            contact.faces[i] += if a < b { 1 } else { -1 };
                            contact.count += 1;
                            for axis in 0..3 {
                                let twice = 2 * low[axis] + i32::from(axis == i);
                                contact.place[axis] += twice as u64;
                            }
                        }
                    }
                }
            }
        }
    }
    let pack = |([a, b], c): ([u64; 2], Contact)| {
        let [fx, fy, fz] = c.faces.map(|faces| faces as u64);
        let [x, y, z] = c.place;
        [a, b, fx, fy, fz, c.count, x, y, z]
    };
    found.into_iter().map(pack).collect()
}

/// Collects the contacts of all macrocubes.
pub(super) struct ContactLedger(Spill<WORDS>);

impl ContactLedger {
    pub fn new() -> Self {
        ContactLedger(Spill::new(IN_MEMORY))
    }

    /// # Errors
    /// If a temporary file cannot be written, here and below, or read back.
    pub fn add(&mut self, contacts: &Contacts) -> Result<()> {
        contacts.iter().try_for_each(|record| self.0.push(*record))
    }

    /// Compares them with the table of necks, of cells of labels.
    pub fn check(self, cx: &Context, issues: &mut Issues) -> Result<()> {
        let Some(mut rows) = NeckRows::open(cx, "labels") else {
            return Ok(());
        };
        let mut sorted = self.0.into_sorted()?;
        let mut next = sorted.next()?;
        while let Some(first) = next {
            let mut contact = Contact::default();
            while let Some(record) = next.filter(|record| record[..2] == first[..2]) {
                contact.count += record[5];
                for a in 0..3 {
                    contact.faces[a] += record[2 + a] as i64;
                    contact.place[a] += record[6 + a];
                }
                next = sorted.next()?;
            }
            rows.compare(&opening([first[0], first[1]], &contact, cx), issues);
        }
        rows.finish(issues);
        Ok(())
    }
}

/// The row of a contact.
fn opening(cells: [u64; 2], contact: &Contact, cx: &Context) -> Opening {
    let place = cx.manifest.measured();
    let [x, y, z] = place.spacing;
    let size = [y * z, x * z, x * y];
    let along = (0..3).map(|a| contact.faces[a] as f64 * size[a]);
    let area = along.map(|v| v * v).sum::<f64>().sqrt();
    let twice = 2.0 * contact.count as f64;
    let middle =
        (contact.count > 0).then(|| place.world(contact.place.map(|sum| sum as f64 / twice)));
    let [x, y, z] = [0, 1, 2].map(|a| middle.map(|middle| middle[a]));
    Opening {
        cells,
        numbers: [None, None, x, y, z, Some(area)],
    }
}
