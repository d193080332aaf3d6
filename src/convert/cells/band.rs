//! The cells of one band, where they are given: sums over their voxels, and where they touch.

use crate::convert::cells::contacts::{Contact, Contacts};
use crate::convert::known_band::KnownBand;
use crate::error::Result;
use crate::grid::{Ambiguous, Dims, Placement};
use crate::labels::{
    BandCells, InsideBand, RowRuns, Run, for_each_open_face, for_each_region_edge, label_below_0,
};
use crate::measure::{Row, VoxelSums, power_sums};
use crate::sys::memory_pool::MemoryReservation;
use std::collections::HashMap;

/// Voxels of a cell in a row, one behind the other.
#[derive(Debug, Clone, Copy)]
pub struct Stretch {
    /// First voxel.
    pub start: u32,
    /// What follows the last one.
    pub end: u32,
    /// Number of the cell among those of the band.
    pub cell: u32,
}

/// The part of a cell that is in one band and one component.
#[derive(Debug, Clone, Copy)]
pub struct CellPart {
    /// The cell; 0 if its voxels are in none.
    pub cell: u64,
    /// The component.
    pub component: u64,
    /// Sums over the voxels that the band owns.
    pub sums: VoxelSums,
}

/// A voxel of a component with a label below 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct BelowZero {
    /// Its place, z first.
    pub zyx: [u32; 3],
    /// Its label.
    pub label: i64,
}

/// What is found in a band.
#[derive(Debug, Default)]
pub struct CellsOfBand {
    /// The first voxel whose label is none that it may have.
    pub below_0: Option<BelowZero>,
    /// Parts of cells.
    pub parts: Vec<CellPart>,
    /// Pairs of cells that touch.
    pub contacts: Vec<Contact>,
}

/// What all bands have in common.
#[derive(Clone, Copy)]
pub struct CellSettings<'a> {
    /// Size of the grid.
    pub dims: Dims,
    /// Which voxels are neighbours.
    pub rule: Ambiguous,
    /// To find who touches whom.
    pub finds_contacts: bool,
    /// Where the grid lies, in the unit of measures.
    pub place: &'a Placement,
}

/// Finds the cells of a band, of whose voxels `inside` are in the region of interest, if there is one. What they take is
/// added to `held`, which has what the band takes.
///
/// # Errors
/// [`crate::Error::TooDense`].
pub fn cells_of_band(
    band: &KnownBand,
    cells: &BandCells,
    inside: Option<&InsideBand>,
    settings: &CellSettings,
    held: &mut MemoryReservation,
) -> Result<CellsOfBand> {
    let band_bytes = held.bytes();
    let mut finder = Finder {
        band,
        cells,
        settings,
        found: CellsOfBand::default(),
        number_of: HashMap::new(),
        last: (u64::MAX, u32::MAX, 0),
        rows: vec![0],
        stretches: Vec::new(),
    };
    finder.sum_rows(|bytes| held.grow_to(band_bytes + bytes))?;
    let found_bytes = held.bytes();
    if settings.finds_contacts {
        let mut contacts = Contacts::new(&finder.found.parts);
        finder.touching(&mut contacts, |bytes| held.grow_to(found_bytes + bytes))?;
        finder.found.contacts = contacts.finish();
    }
    for part in &mut finder.found.parts {
        part.sums.note_border(settings.dims);
    }
    if let Some(inside) = inside {
        finder.note_region_edge(inside);
    }
    Ok(finder.found)
}

struct Finder<'a> {
    band: &'a KnownBand,
    cells: &'a BandCells,
    settings: &'a CellSettings<'a>,
    found: CellsOfBand,
    /// Numbers of cells in components.
    number_of: HashMap<(u64, u32), u32>,
    /// What was looked up last, and its number.
    last: (u64, u32, u32),
    /// First stretch of each row, and one more.
    rows: Vec<u32>,
    stretches: Vec<Stretch>,
}

impl Finder<'_> {
    /// The number of a cell in a component of this class.
    fn number(&mut self, cell: u64, class: u32) -> u32 {
        if (self.last.0, self.last.1) != (cell, class) {
            let parts = &mut self.found.parts;
            let number = *self.number_of.entry((cell, class)).or_insert_with(|| {
                parts.push(CellPart {
                    cell,
                    component: self.band.components[class as usize].id,
                    sums: VoxelSums::default(),
                });
                parts.len() as u32 - 1
            });
            self.last = (cell, class, number);
        }
        self.last.2
    }

    /// Bytes of what is found, of maps half as much again while they grow.
    fn bytes(&self) -> u64 {
        let parts = self.found.parts.capacity() * size_of::<CellPart>();
        let numbers = self.number_of.capacity() * 48;
        (parts + numbers + self.stretches.capacity() * size_of::<Stretch>()) as u64
    }

    /// Cuts the runs of voxels below at the ends of cells, and sums up what the band owns; `take` takes the bytes for it.
    fn sum_rows(&mut self, mut take: impl FnMut(u64) -> Result<()>) -> Result<()> {
        let bits = &self.band.bits;
        let span = &bits.span;
        let rotated = self.settings.place.is_rotated();
        let mut run_number = 0;
        for (s, z) in span.z.clone().enumerate() {
            for (r, y) in span.y.clone().enumerate() {
                let owned = (r > 0 || y == 0) && (s > 0 || z == 0);
                let row = Row::new(y, z);
                for Run { start, end, above } in RowRuns::new(bits.row(s, r), span.nx) {
                    let class = self.band.class_of_run[run_number];
                    run_number += 1;
                    if above {
                        continue;
                    }
                    let cells = self.cells;
                    cells.for_each_in(s * span.rows() + r, [start, end], |start, end, cell| {
                        if let Some(label) = label_below_0(cell) {
                            let zyx = [z, y, start];
                            self.found.below_0.get_or_insert(BelowZero { zyx, label });
                            return;
                        }
                        let number = self.number(cell, class);
                        let sums = &mut self.found.parts[number as usize].sums;
                        if owned {
                            let [before, upto] = [start, end].map(power_sums);
                            let run = std::array::from_fn(|k| upto[k] - before[k]);
                            sums.add_run(start..end, run, &row);
                        }
                        if rotated {
                            sums.widen_in_world(start..end, [y, z], self.settings.place);
                        }
                        self.stretches.push(Stretch {
                            start,
                            end,
                            cell: number,
                        });
                    });
                }
                self.rows.push(self.stretches.len() as u32);
                take(self.bytes())?;
            }
        }
        Ok(())
    }

    fn row(&self, s: usize, r: usize) -> &[Stretch] {
        let row = s * self.band.bits.span.rows() + r;
        &self.stretches[self.rows[row] as usize..self.rows[row + 1] as usize]
    }

    /// Finds who touches whom, each pair of neighbouring voxels in the one band that owns it; `take` takes the bytes
    /// for them.
    fn touching(
        &self,
        contacts: &mut Contacts,
        mut take: impl FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        let span = &self.band.bits.span;
        let wide = self.settings.rule == Ambiguous::Separate;
        for (s, z) in span.z.clone().enumerate() {
            for (r, y) in span.y.clone().enumerate() {
                let (own_y, own_z) = (r > 0 || y == 0, s > 0 || z == 0);
                let here = self.row(s, r);
                if own_y && own_z {
                    contacts.within(here, [y, z]);
                }
                if r > 0 && own_z {
                    contacts.between(self.row(s, r - 1), here, wide, Some((1, [y - 1, z])));
                }
                if s > 0 && own_y {
                    contacts.between(self.row(s - 1, r), here, wide, Some((2, [y, z - 1])));
                }
                if s > 0 && r > 0 && wide {
                    contacts.between(self.row(s - 1, r - 1), here, false, None);
                    contacts.between(self.row(s, r - 1), self.row(s - 1, r), false, None);
                }
                take(contacts.bytes())?;
            }
        }
        Ok(())
    }

    /// Notes that cells touch the border at the edge of the region, as components do, and where one goes on in another
    /// there.
    fn note_region_edge(&mut self, inside: &InsideBand) {
        let mut parts = std::mem::take(&mut self.found.parts);
        let mut note = |cell: u32| parts[cell as usize].sums.touches_border = 1;
        let bits = &self.band.bits;
        for_each_region_edge(bits, inside, self.settings.rule, |row, x| {
            self.cell_at(row, x).into_iter().for_each(&mut note);
        });
        for_each_open_face(bits, inside, |voxels| {
            if let [Some(a), Some(b)] = voxels.map(|(row, x)| self.cell_at(row, x))
                && a != b
            {
                [a, b].into_iter().for_each(&mut note);
            }
        });
        self.found.parts = parts;
    }

    /// The number of the cell of a voxel, in a row that is counted through all slices.
    fn cell_at(&self, row: usize, x: u32) -> Option<u32> {
        let stretches = &self.stretches[self.rows[row] as usize..self.rows[row + 1] as usize];
        let behind = stretches.partition_point(|stretch| stretch.start <= x);
        let found = stretches[..behind].last()?;
        (x < found.end).then_some(found.cell)
    }
}
