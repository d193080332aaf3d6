//! Which pieces are exported: those of chosen cells, objects or surfaces, and caps.

use crate::error::{Error, Result};
use crate::manifest::{Manifest, PartsBy, WholeTotals, file_inside};
use crate::sys::id_set::IdSet;
use crate::table::{Chosen, Table, TableReader};
use crate::tile::PieceIds;
use std::path::Path;

/// Adds an id of at most `most`.
fn add(ids: &mut IdSet, id: u64, most: u64, table: &Path) -> Result<()> {
    if id > most {
        let found = format!("the id {id}");
        let expected = format!("ids up to {most}, as index.json has it");
        return Err(Error::format(table, found, expected));
    }
    ids.insert(id);
    Ok(())
}

/// What is chosen.
#[derive(Debug, Default)]
struct Part {
    table: Table,
    /// Of that table.
    ids: IdSet,
    /// Objects whose caps are kept: of chosen cells or surfaces those that they border, if all surfaces of all these
    /// objects are kept, for then caps still close them.
    capped: Option<IdSet>,
    vertices: u64,
}

/// Which pieces are exported.
#[derive(Debug)]
pub(super) struct Choice(Option<Part>);

impl Choice {
    /// How many cells, objects or surfaces are chosen of how many; `None` if all are.
    pub fn share(&self, manifest: &Manifest) -> Option<[u64; 2]> {
        let part = self.0.as_ref()?;
        Some([part.ids.len(), part.table.total(manifest)])
    }

    /// Bytes that the choice of a part takes: a bit for each row of its table and three for each object.
    pub fn bytes(&self, manifest: &Manifest) -> u64 {
        let whole = whole(manifest);
        match &self.0 {
            None => 0,
            Some(part) => whole.of(part.table) / 8 + whole.objects * 3 / 8,
        }
    }

    /// Reads the tables if not all is chosen.
    ///
    /// # Errors
    /// [`Error::Usage`] for a condition that cannot be, [`Error::Format`] for a damaged table, [`Error::Io`].
    pub fn new(dir: &Path, manifest: &Manifest, chosen: &Chosen) -> Result<Self> {
        if chosen.is_all() {
            return Ok(Choice(None));
        }
        let whole = whole(manifest);
        let mut part = Part {
            table: chosen.table,
            ..Part::default()
        };
        let mut table = chosen.table.open(dir, manifest)?;
        let path = table.path().to_path_buf();
        let query = chosen.query(&table)?;
        let id = table.own_column("id")?;
        let largest_id = match (chosen.table, &manifest.cells) {
            // labels are any numbers
            (Table::Cells, Some(PartsBy::Labels { .. })) => u64::MAX,
            (table, _) => whole.of(table),
        };
        query.run(&mut table, |row| {
            add(&mut part.ids, row.whole(id)?, largest_id, &path)
        })?;
        let mut table = Table::Surfaces.open(dir, manifest)?;
        let path = table.path().to_path_buf();
        let [cell, object] = [table.own_column("cell")?, table.own_column("object")?];
        let [id, vertices] = [table.own_column("id")?, table.own_column("vertices")?];
        let of_table = match chosen.table {
            Table::Cells => cell,
            Table::Objects => object,
            Table::Surfaces => id,
        };
        let [mut kept, mut left] = [IdSet::default(), IdSet::default()];
        while let Some(row) = table.next_row()? {
            let keep = part.ids.contains(row.whole(of_table)?);
            let ids = if keep { &mut kept } else { &mut left };
            add(ids, row.whole(object)?, whole.objects, &path)?;
            if keep {
                part.vertices = part.vertices.saturating_add(row.whole(vertices)?);
            }
        }
        part.capped = match chosen.table {
            // an object that the grid cuts on all sides has caps and no surface
            Table::Objects => manifest.cap.then(|| part.ids.clone()),
            Table::Cells | Table::Surfaces => (manifest.cap && !kept.meets(&left)).then_some(kept),
        };
        Ok(Choice(Some(part)))
    }

    /// True if a piece is exported; that of cell 0 is a cap.
    pub fn keeps(&self, piece: &PieceIds) -> bool {
        match &self.0 {
            None => true,
            Some(part) if piece.cell == 0 => part
                .capped
                .as_ref()
                .is_some_and(|o| o.contains(piece.object)),
            Some(part) => part.ids.contains(piece.of(part.table)),
        }
    }

    /// True if what is exported comes with the caps that close it.
    pub fn has_caps(&self, manifest: &Manifest) -> bool {
        match &self.0 {
            None => manifest.cap,
            Some(part) => part.capped.is_some(),
        }
    }

    /// True if everything is exported.
    pub fn is_whole(&self) -> bool {
        self.0.is_none()
    }

    /// Openings at which cells that are exported end, for the cell on the other side is not; `None` if objects were chosen, or
    /// some surfaces of a cell and others not.
    ///
    /// # Errors
    /// As of [`Choice::new`].
    pub fn open_necks(&self, dir: &Path, manifest: &Manifest) -> Result<Option<u64>> {
        let Some(path) = &manifest.tables.necks else {
            return Ok(None);
        };
        let cells = match &self.0 {
            None => None,
            Some(part) => match part.table {
                Table::Objects => return Ok(None),
                Table::Cells => Some(part.ids.clone()),
                Table::Surfaces => match whole_cells(&part.ids, dir, manifest)? {
                    None => return Ok(None),
                    cells => cells,
                },
            },
        };
        let keeps = |cell: u64| cells.as_ref().is_none_or(|cells| cells.contains(cell));
        let mut table = Table::Cells.open(dir, manifest)?;
        let [id, necks] = [table.own_column("id")?, table.own_column("necks")?];
        // cells that were left out of the set count in this column
        let mut open = 0u64;
        while let Some(row) = table.next_row()? {
            if keeps(row.whole(id)?) {
                open = open.saturating_add(row.whole(necks)?);
            }
        }
        let path = file_inside(dir, path, "open the table")?;
        let mut table = TableReader::open_keyed(&path, "cell_a")?;
        let ends = [table.own_column("cell_a")?, table.own_column("cell_b")?];
        while let Some(row) = table.next_row()? {
            if keeps(row.whole(ends[0])?) && keeps(row.whole(ends[1])?) {
                open = open.saturating_sub(2);
            }
        }
        Ok(Some(open))
    }

    /// Vertices that will be exported, those of caps not counted if it is a part.
    pub fn vertices(&self, manifest: &Manifest) -> u64 {
        self.0
            .as_ref()
            .map_or(manifest.totals.vertices, |p| p.vertices)
    }
}

/// The cells that surfaces are of; `None` if these have others, too.
fn whole_cells(surfaces: &IdSet, dir: &Path, manifest: &Manifest) -> Result<Option<IdSet>> {
    let mut table = Table::Surfaces.open(dir, manifest)?;
    let [id, cell] = [table.own_column("id")?, table.own_column("cell")?];
    let [mut kept, mut left] = [IdSet::default(), IdSet::default()];
    while let Some(row) = table.next_row()? {
        let keep = surfaces.contains(row.whole(id)?);
        let cells = if keep { &mut kept } else { &mut left };
        cells.insert(row.whole(cell)?);
    }
    Ok((!kept.meets(&left)).then_some(kept))
}

/// The largest id of a cell. Those that labels give are not without gaps.
///
/// # Errors
/// What reading the table of cells returns.
pub(super) fn largest_cell(dir: &Path, manifest: &Manifest) -> Result<u64> {
    if !matches!(manifest.cells, Some(PartsBy::Labels { .. })) {
        return Ok(whole(manifest).cells);
    }
    let mut table = Table::Cells.open(dir, manifest)?;
    let id = table.own_column("id")?;
    let mut largest = 0;
    while let Some(row) = table.next_row()? {
        largest = row.whole(id)?.max(largest);
    }
    Ok(largest)
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
