//! Which cells and caps are exported.

use crate::error::{Error, Result};
use crate::manifest::{Manifest, WholeTotals};
use crate::table::{Query, Table, TableReader};
use std::path::Path;

/// Ids as a bit each.
#[derive(Debug, Default)]
struct Ids(Vec<u64>);

impl Ids {
    /// Adds an id of at most `most`.
    fn add(&mut self, id: u64, most: u64, table: &Path) -> Result<()> {
        if id > most {
            let found = format!("the id {id}");
            let expected = format!("ids up to {most}, as index.json has it");
            return Err(Error::format(table, found, expected));
        }
        let word = (id / 64) as usize;
        if word >= self.0.len() {
            self.0.resize(word + 1, 0);
        }
        self.0[word] |= 1 << (id % 64);
        Ok(())
    }

    fn has(&self, id: u64) -> bool {
        let word = usize::try_from(id / 64).ok().and_then(|w| self.0.get(w));
        word.is_some_and(|w| w >> (id % 64) & 1 == 1)
    }

    fn meets(&self, other: &Ids) -> bool {
        self.0.iter().zip(&other.0).any(|(a, b)| a & b != 0)
    }
}

/// Cells for which a condition holds.
#[derive(Debug, Default)]
struct Part {
    cells: Ids,
    /// Objects that these border, if caps are kept: they are if all surfaces of all these objects are,
    /// for then they still close them.
    capped: Option<Ids>,
    vertices: u64,
}

/// Which pieces are exported.
#[derive(Debug)]
pub(super) struct Choice(Option<Part>);

impl Choice {
    /// How many cells are chosen of how many, if there is a condition.
    pub fn share(&self, manifest: &Manifest) -> Option<[u64; 2]> {
        let ones = |words: &[u64]| words.iter().map(|w| u64::from(w.count_ones())).sum();
        let part = self.0.as_ref()?;
        Some([ones(&part.cells.0), manifest.totals.cells])
    }

    /// Bytes that the choice of a part takes: a bit for each cell and two for each object.
    pub fn bytes(manifest: &Manifest) -> u64 {
        let whole = whole(manifest);
        whole.cells / 8 + whole.objects / 4
    }

    /// Reads the tables if there is a condition.
    ///
    /// # Errors
    /// [`Error::Usage`] for a condition that cannot be or holds for no cell, [`Error::Format`] for a
    /// damaged table, [`Error::Io`].
    pub fn new(dir: &Path, manifest: &Manifest, condition: Option<&str>) -> Result<Self> {
        if condition.is_none() {
            return Ok(Choice(None));
        }
        let whole = whole(manifest);
        let mut part = Part::default();
        let mut table = Table::Cells.open(dir, manifest)?;
        let path = table.path().to_path_buf();
        let query = Query::default().filter(condition, table.columns())?;
        let id = column(&table, "id")?;
        query.run(&mut table, |row| {
            part.cells.add(row.whole(id)?, whole.cells, &path)
        })?;
        let mut table = Table::Surfaces.open(dir, manifest)?;
        let path = table.path().to_path_buf();
        let [cell, object] = [column(&table, "cell")?, column(&table, "object")?];
        let vertices = column(&table, "vertices")?;
        let [mut kept, mut left] = [Ids::default(), Ids::default()];
        while let Some(row) = table.next_row()? {
            let keep = part.cells.has(row.whole(cell)?);
            let ids = if keep { &mut kept } else { &mut left };
            ids.add(row.whole(object)?, whole.objects, &path)?;
            if keep {
                part.vertices = part.vertices.saturating_add(row.whole(vertices)?);
            }
        }
        part.capped = (manifest.cap && !kept.meets(&left)).then_some(kept);
        Ok(Choice(Some(part)))
    }

    /// True if the pieces of this cell and object are exported; cell 0 is a cap.
    pub fn keeps(&self, cell: u64, object: u64) -> bool {
        match &self.0 {
            None => true,
            Some(part) if cell == 0 => part.capped.as_ref().is_some_and(|o| o.has(object)),
            Some(part) => part.cells.has(cell),
        }
    }

    /// True if everything is exported.
    pub fn is_whole(&self) -> bool {
        self.0.is_none()
    }

    /// Vertices that will be exported, those of caps not counted if it is a part.
    pub fn vertices(&self, manifest: &Manifest) -> u64 {
        self.0
            .as_ref()
            .map_or(manifest.totals.vertices, |p| p.vertices)
    }
}

/// What the ids in the tile set run up to.
pub(super) fn whole(manifest: &Manifest) -> WholeTotals {
    let t = &manifest.totals;
    manifest.selection.as_ref().map_or(
        WholeTotals {
            cells: t.cells,
            objects: t.objects,
            surfaces: t.surfaces,
            voxels_above: t.voxels_above,
        },
        |s| s.of,
    )
}

fn column(table: &TableReader, name: &str) -> Result<usize> {
    table
        .column(name)
        .ok_or_else(|| Error::format(table.path(), "none", format!("a column {name}")))
}
