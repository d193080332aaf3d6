//! What triangles say of cells, and of the surfaces between them and objects.

use crate::error::Result;
use crate::grid::Extent;
use crate::verify::inside::Span;
use crate::verify::spill::{Merge, Spill};
use crate::verify::sweep::Component;
use std::collections::BTreeMap;

/// Records that each sort keeps in memory: half a mebibyte at most.
const IN_MEMORY: usize = 1 << 12;
/// Surfaces that are summed up in memory: 1.3 MiB.
const GATHERED: usize = 1 << 11;

/// The part of a surface in a tile: of one cell and one object.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::verify) struct PartSums {
    /// Its ids, which are those that its piece states, and its sums. A vertex on the seam of two parts counts with one of
    /// them, whatever the tile.
    pub component: Component,
    /// The voxels below at which its triangles begin, which are of the cell.
    pub begins: Begins,
}

/// Around voxels.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::verify) struct Begins {
    pub span: Span,
    /// The same along the axes of the world, if these are not the grid's.
    pub far: Extent,
}

/// Words of [`Begins`] behind a cell.
const BEGINS: usize = 1 + 2 + 6;

impl Begins {
    pub fn add(&mut self, other: &Begins) {
        self.span.add(&other.span);
        self.far.merge(&other.far);
    }

    fn pack(&self, cell: u64) -> [u64; BEGINS] {
        let corner = |[x, y, z]: [u16; 3]| u64::from(x) << 32 | u64::from(y) << 16 | u64::from(z);
        let mut words = [0; BEGINS];
        words[..3].copy_from_slice(&[cell, corner(self.span.lo), corner(self.span.hi)]);
        words[3..].copy_from_slice(&self.far.words());
        words
    }

    fn unpack(words: &[u64; BEGINS]) -> Self {
        let corner = |word: u64| [32, 16, 0].map(|shift| (word >> shift) as u16);
        Begins {
            span: Span {
                lo: corner(words[1]),
                hi: corner(words[2]),
            },
            far: Extent::from_words(std::array::from_fn(|i| words[3 + i])),
        }
    }
}

/// Where the triangles of cells begin, by rising cells.
pub(super) struct SortedBegins {
    merge: Merge<BEGINS>,
    next: Option<[u64; BEGINS]>,
}

impl SortedBegins {
    /// Of a cell; those of smaller ones are left out.
    ///
    /// # Errors
    /// If a temporary file cannot be read back.
    pub fn of(&mut self, cell: u64) -> Result<Begins> {
        let mut all = Begins::default();
        while let Some(words) = self.next.filter(|words| words[0] <= cell) {
            if words[0] == cell {
                all.add(&Begins::unpack(&words));
            }
            self.next = self.merge.next()?;
        }
        Ok(all)
    }
}

/// Numbers in pairs, sorted.
pub(super) struct Pairs {
    merge: Merge<2>,
    next: Option<[u64; 2]>,
}

impl Pairs {
    /// # Errors
    /// If a temporary file cannot be read back, here and below.
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

    /// How many pairs are left, each counted once.
    pub fn count(&mut self) -> Result<u64> {
        let (mut count, mut last) = (0, None);
        while let Some(pair) = self.next {
            count += u64::from(last != Some(pair));
            last = Some(pair);
            self.next = self.merge.next()?;
        }
        Ok(count)
    }
}

/// Collects what triangles say of cells, tile by tile.
pub(in crate::verify) struct PartLedger {
    /// By surface: neighbouring tiles have the same ones.
    gathered: BTreeMap<u64, Component>,
    begins: BTreeMap<u64, Begins>,
    all_begins: Spill<BEGINS>,
    /// Cells with the tiles that have triangles of them.
    tiles: Spill<2>,
}

impl Default for PartLedger {
    fn default() -> Self {
        PartLedger {
            gathered: BTreeMap::new(),
            begins: BTreeMap::new(),
            all_begins: Spill::new(IN_MEMORY),
            tiles: Spill::new(IN_MEMORY),
        }
    }
}

impl PartLedger {
    /// Adds a part in a tile, which has a number. Hands on sums when there are too many of them.
    pub fn add(
        &mut self,
        part: &PartSums,
        tile: u64,
        mut full: impl FnMut(&Component) -> Result<()>,
    ) -> Result<()> {
        let ids = part.component.ids;
        self.tiles.push([ids.cell, tile])?;
        self.begins
            .entry(ids.cell)
            .and_modify(|known| known.add(&part.begins))
            .or_insert(part.begins);
        if self.begins.len() >= IN_MEMORY {
            self.spill_begins()?;
        }
        match self.gathered.get_mut(&ids.surface) {
            // what contradicts itself is found when all are sorted
            Some(known) if known.ids == ids => known.absorb(&part.component),
            _ => {
                if let Some(other) = self.gathered.insert(ids.surface, part.component) {
                    full(&other)?;
                }
            }
        }
        if self.gathered.len() >= GATHERED {
            self.drain(full)?;
        }
        Ok(())
    }

    /// Hands on all sums.
    pub fn drain(&mut self, full: impl FnMut(&Component) -> Result<()>) -> Result<()> {
        let all = std::mem::take(&mut self.gathered);
        all.values().try_for_each(full)
    }

    fn spill_begins(&mut self) -> Result<()> {
        let all = std::mem::take(&mut self.begins);
        all.iter()
            .try_for_each(|(cell, begins)| self.all_begins.push(begins.pack(*cell)))
    }

    /// Where triangles of cells begin, and tiles by cell.
    pub(super) fn into_sorted(mut self) -> Result<(SortedBegins, Pairs)> {
        self.spill_begins()?;
        let mut merge = self.all_begins.into_sorted()?;
        let begins = SortedBegins {
            next: merge.next()?,
            merge,
        };
        Ok((begins, Pairs::of(self.tiles)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::sweep::Ids;

    #[test]
    fn sums_come_back_by_their_numbers() {
        let part = |surface: u64, cell: u64| PartSums {
            component: Component {
                ids: Ids {
                    surface,
                    cell,
                    object: 1,
                },
                tiles: 1,
                ..Component::default()
            },
            begins: Begins {
                span: Span {
                    lo: [cell as u16, 7, 65_535],
                    hi: [1 + surface as u16, 8, 65_535],
                },
                ..Begins::default()
            },
        };
        let (mut ledger, mut sums) = (PartLedger::default(), Vec::new());
        let mut note = |c: &Component| {
            sums.push((c.ids.surface, c.ids.cell, c.tiles));
            Ok(())
        };
        for (surface, cell, tile) in [(2, 9, 5), (3, 9, 5), (2, 9, 4), (1, 4, 0), (2, 8, 5)] {
            ledger.add(&part(surface, cell), tile, &mut note).unwrap();
        }
        ledger.drain(&mut note).unwrap();
        assert_eq!(sums, [(2, 9, 2), (1, 4, 1), (2, 8, 1), (3, 9, 1)]);
        let (mut begins, mut tiles) = ledger.into_sorted().unwrap();
        assert_eq!(begins.of(5).unwrap().span, Span::default());
        let nine = begins.of(9).unwrap().span;
        assert_eq!((nine.lo, nine.hi), ([9, 7, 65_535], [4, 8, 65_535]));
        let mut seen = Vec::new();
        tiles
            .each(9, |tile| {
                seen.push(tile);
                Ok(())
            })
            .unwrap();
        assert_eq!((seen, tiles.count().unwrap()), (vec![4, 5], 0));
    }
}
