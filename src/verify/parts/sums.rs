//! What triangles say of cells.

use crate::error::Result;
use crate::grid::Extent;
use crate::verify::inside::Span;
use crate::verify::paint::{Colour, MIXED};
use crate::verify::spill::{Merge, Spill};
use std::collections::BTreeMap;

/// Records that each sort keeps in memory: half a mebibyte.
const IN_MEMORY: usize = 1 << 12;

/// Words of [`CellSums`] in a record, and of a record with the two numbers that it is sorted by.
const WORDS: usize = 14;
const RECORD: usize = 2 + WORDS;

/// Sums over triangles of a cell.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::verify) struct CellSums {
    pub cell: u64,
    /// The surface of the triangles, if they are of one.
    pub surface: u64,
    pub triangles: u64,
    /// In squares of the placement's unit.
    pub area: f64,
    /// Tiles that have some of them.
    pub tiles: u64,
    /// Around the voxels below at which they begin.
    pub begins: Span,
    /// The same along the axes of the world, if these are not the grid's.
    pub far: Extent,
    /// As of [`crate::verify::sweep::Component`], here and below.
    pub names: u8,
    pub measures: u64,
    pub mixed: bool,
    pub colour: Colour,
    /// Surfaces of its component; 0 until that is known.
    pub surfaces: u64,
}

impl CellSums {
    /// Adds other triangles of the cell.
    pub fn add(&mut self, other: &CellSums) {
        self.triangles += other.triangles;
        self.area += other.area;
        self.tiles += other.tiles;
        self.begins.add(&other.begins);
        self.far.merge(&other.far);
        self.names |= other.names;
        self.mixed |= other.mixed || self.measures != other.measures;
        if self.colour != other.colour {
            self.colour = MIXED;
        }
    }

    /// A record that is sorted by two numbers, and the cell's sums.
    fn pack(&self, key: [u64; 2]) -> [u64; RECORD] {
        let corner = |[x, y, z]: [u16; 3]| u64::from(x) << 32 | u64::from(y) << 16 | u64::from(z);
        let flags = u64::from(self.mixed) << 2 | u64::from(self.names);
        let own = [
            self.triangles,
            self.area.to_bits(),
            self.tiles << 3 | flags,
            self.measures,
            u64::from(self.colour),
            corner(self.begins.lo),
            corner(self.begins.hi),
            self.surfaces,
        ];
        let all = key.into_iter().chain(own).chain(self.far.words());
        let mut record = [0; RECORD];
        record.iter_mut().zip(all).for_each(|(to, word)| *to = word);
        record
    }

    /// The sums in a record.
    fn unpack(r: &[u64; RECORD]) -> Self {
        let corner = |word: u64| [32, 16, 0].map(|shift| (word >> shift) as u16);
        CellSums {
            cell: 0,
            surface: 0,
            triangles: r[2],
            area: f64::from_bits(r[3]),
            tiles: r[4] >> 3,
            mixed: r[4] & 4 != 0,
            names: (r[4] & 3) as u8,
            measures: r[5],
            colour: r[6] as u32,
            begins: Span {
                lo: corner(r[7]),
                hi: corner(r[8]),
            },
            surfaces: r[9],
            far: Extent::from_words(std::array::from_fn(|i| r[10 + i])),
        }
    }
}

/// Sums of cells, sorted by two numbers.
pub(super) struct CellSpill(Spill<RECORD>);

impl CellSpill {
    pub fn new() -> Self {
        CellSpill(Spill::new(IN_MEMORY))
    }

    /// Adds sums.
    ///
    /// # Errors
    /// If a temporary file fails, here and below.
    pub fn push(&mut self, key: [u64; 2], sums: &CellSums) -> Result<()> {
        self.0.push(sums.pack(key))
    }

    pub fn into_sorted(self) -> Result<SortedCells> {
        let mut merge = self.0.into_sorted()?;
        let next = merge.next()?;
        Ok(SortedCells { merge, next })
    }
}

/// Sums of cells by rising numbers.
pub(super) struct SortedCells {
    merge: Merge<RECORD>,
    next: Option<[u64; RECORD]>,
}

impl SortedCells {
    /// The smallest first number that is left.
    pub fn peek(&self) -> Option<u64> {
        self.next.map(|record| record[0])
    }

    /// The next sums, if their first number is this one: the second number, and what has both added up.
    pub fn next_of(&mut self, first: u64) -> Result<Option<(u64, CellSums)>> {
        let Some(record) = self.next.filter(|record| record[0] == first) else {
            return Ok(None);
        };
        let mut sums = CellSums::unpack(&record);
        self.next = self.merge.next()?;
        while let Some(other) = self.next.filter(|other| other[..2] == record[..2]) {
            sums.add(&CellSums::unpack(&other));
            self.next = self.merge.next()?;
        }
        Ok(Some((record[1], sums)))
    }
}

/// Numbers in pairs, sorted.
pub(super) struct Pairs {
    merge: Merge<2>,
    next: Option<[u64; 2]>,
}

impl Pairs {
    pub fn of(spill: Spill<2>) -> Result<Self> {
        let mut merge = spill.into_sorted()?;
        let next = merge.next()?;
        Ok(Pairs { merge, next })
    }

    /// Calls `each` with the second numbers, each once, of pairs with this first number. Those of smaller ones are left out.
    pub fn each(&mut self, first: u64, mut each: impl FnMut(u64) -> Result<()>) -> Result<()> {
        let mut last = None;
        while let Some([key, value]) = self.next.filter(|pair| pair[0] <= first) {
            if key == first && last != Some(value) {
                each(value)?;
                last = Some(value);
            }
            self.next = self.merge.next()?;
        }
        Ok(())
    }
}

/// Collects what triangles say of cells, tile by tile.
pub(in crate::verify) struct PartLedger {
    /// By surface and cell: neighbouring tiles have the same ones.
    gathered: BTreeMap<[u64; 2], CellSums>,
    cells: CellSpill,
    tiles: Spill<2>,
}

impl Default for PartLedger {
    fn default() -> Self {
        PartLedger {
            gathered: BTreeMap::new(),
            cells: CellSpill::new(),
            tiles: Spill::new(IN_MEMORY),
        }
    }
}

impl PartLedger {
    /// Adds triangles of a cell and a surface.
    pub fn add(&mut self, sums: &CellSums) -> Result<()> {
        let known = self.gathered.entry([sums.surface, sums.cell]);
        known
            .and_modify(|known| known.add(sums))
            .or_insert_with(|| *sums);
        if self.gathered.len() >= IN_MEMORY {
            self.spill()?;
        }
        Ok(())
    }

    /// Says that a tile has triangles of a surface.
    pub fn add_tile(&mut self, surface: u64, tile: u64) -> Result<()> {
        self.tiles.push([surface, tile])
    }

    fn spill(&mut self) -> Result<()> {
        let all = std::mem::take(&mut self.gathered);
        all.iter()
            .try_for_each(|(key, sums)| self.cells.push(*key, sums))
    }

    /// Cells by surface, and tiles by surface.
    pub(super) fn into_sorted(mut self) -> Result<(SortedCells, Pairs)> {
        self.spill()?;
        Ok((self.cells.into_sorted()?, Pairs::of(self.tiles)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_come_back_by_their_numbers() {
        let sums = |cell: u64, surface: u64| CellSums {
            cell,
            surface,
            triangles: 3,
            area: 0.5,
            tiles: 1,
            begins: Span {
                lo: [cell as u16, 7, 65_535],
                hi: [1 + cell as u16, 8, 65_535],
            },
            names: 2,
            measures: u64::MAX - 1,
            ..CellSums::default()
        };
        let mut ledger = PartLedger::default();
        for (cell, surface) in [(9, 2), (4, 2), (9, 1), (9, 2)] {
            ledger.add(&sums(cell, surface)).unwrap();
        }
        for (surface, tile) in [(2, 5), (2, 5), (1, 0), (2, 4)] {
            ledger.add_tile(surface, tile).unwrap();
        }
        let (mut cells, mut tiles) = ledger.into_sorted().unwrap();
        assert_eq!(cells.next_of(2).unwrap().map(|c| c.0), None);
        assert_eq!(cells.next_of(1).unwrap().map(|c| c.0), Some(9));
        assert_eq!(cells.peek(), Some(2));
        assert_eq!(cells.next_of(2).unwrap().map(|c| c.0), Some(4));
        let (cell, both) = cells.next_of(2).unwrap().unwrap();
        assert_eq!(
            (cell, both.triangles, both.area, both.tiles),
            (9, 6, 1.0, 2)
        );
        assert_eq!(
            (both.begins.lo, both.begins.hi),
            ([9, 7, 65_535], [10, 8, 65_535])
        );
        assert_eq!(
            (both.names, both.measures, both.mixed),
            (2, u64::MAX - 1, false)
        );
        let mut seen = Vec::new();
        let mut note = |tile| {
            seen.push(tile);
            Ok(())
        };
        tiles.each(2, &mut note).unwrap();
        tiles.each(3, &mut note).unwrap();
        assert_eq!(seen, [4, 5]);
    }
}
