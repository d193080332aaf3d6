//! The rows of the tables that are kept.

use crate::error::{Error, Result};
use crate::manifest::{COMPONENTS, Manifest, NECKS, WALLS, file_inside};
use crate::sys::id_set::IdSet;
use crate::table::{Row, Table, TableReader};
use crate::tile::read::PieceIds;
use crate::transform::select::choice::Choice;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// What was kept of the tables.
#[derive(Debug, Default)]
pub struct Rows {
    /// Cells.
    pub cells: u64,
    /// Components that kept cells are parts of, where cells are parts of components.
    pub components: u64,
    /// Openings between kept cells.
    pub necks: u64,
    /// Walls between kept cells.
    pub walls: u64,
    /// Surfaces.
    pub surfaces: u64,
    /// Surfaces of each kept object: how many were kept, and how many there are.
    pub objects: BTreeMap<u64, [u64; 2]>,
    /// Cells that keep more than one surface.
    pub several: IdSet,
    /// Vertices of the surfaces.
    pub vertices: u64,
    /// Their edges on the border of the volume.
    pub border_edges: u64,
    /// Voxels of the objects.
    pub voxels_above: u64,
}

impl Rows {
    /// True if every object in the part has all its surfaces.
    pub fn complete(&self) -> bool {
        self.objects.values().all(|[kept, all]| kept == all)
    }
}

/// Copies the rows of what was chosen, of the surfaces of that, and of the cells and objects that have one of these.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if a table is damaged.
pub fn copy_rows(from: &Path, to: &Path, manifest: &Manifest, choice: &Choice) -> Result<Rows> {
    let mut rows = Rows::default();
    let cells = copy_surfaces(from, to, manifest, choice, &mut rows)?;
    let component = Table::Cells.open(from, manifest)?.column("component");
    let mut parts = Parts::default();
    // what has no surface stays if nothing was left out
    let all = choice.count() == choice.table().total(manifest);
    filter(from, to, manifest, Table::Cells, |row, id| {
        let keep = match choice.table() {
            Table::Cells => choice.has(id),
            Table::Objects | Table::Surfaces => all || cells.contains(id),
        };
        rows.cells += u64::from(keep);
        if keep {
            parts.cells.insert(id);
        }
        if let (true, Some(component)) = (keep, component) {
            parts.add(row.number(component)?);
        }
        Ok(keep)
    })?;
    [rows.components, rows.necks, rows.walls] = parts.copy(from, to, manifest)?;
    let reader = Table::Objects.open(from, manifest)?;
    let voxels = reader.column("voxels");
    let mut lone = Vec::new();
    filter(from, to, manifest, Table::Objects, |row, id| {
        let keep = match choice.table() {
            Table::Objects => choice.has(id),
            Table::Cells | Table::Surfaces => all || rows.objects.contains_key(&id),
        };
        if let (true, Some(voxels)) = (keep, voxels) {
            rows.voxels_above = rows.voxels_above.saturating_add(row.whole(voxels)?);
        }
        if keep && !rows.objects.contains_key(&id) {
            lone.push(id);
        }
        Ok(keep)
    })?;
    rows.objects.extend(lone.into_iter().map(|id| (id, [0, 0])));
    Ok(rows)
}

/// What is kept of cells, and of the components that they are parts of.
#[derive(Default)]
struct Parts {
    cells: IdSet,
    components: IdSet,
    /// A cell has voxels in several components, which its row does not name.
    all: bool,
}

impl Parts {
    /// The component that the row of a kept cell names.
    fn add(&mut self, component: Option<f64>) {
        match component {
            Some(component) => _ = self.components.insert(component as u64),
            None => self.all = true,
        }
    }

    /// Copies the rows of components of kept cells, and of necks and walls between kept cells; returns how many of each.
    fn copy(&self, from: &Path, to: &Path, manifest: &Manifest) -> Result<[u64; 3]> {
        let tables = &manifest.tables;
        let mut counts = [0; 3];
        let of_components = (&self.components, self.all, &["id"][..]);
        let of_pairs = (&self.cells, false, &["cell_a", "cell_b"][..]);
        let all = [
            (&tables.components, COMPONENTS, of_components),
            (&tables.necks, NECKS, of_pairs),
            (&tables.walls, WALLS, of_pairs),
        ];
        for (count, (path, name, (kept, all, columns))) in counts.iter_mut().zip(all) {
            let Some(path) = path else { continue };
            let path = file_inside(from, path, "open the table")?;
            let mut reader = TableReader::open_keyed(&path, columns[0])?;
            let ids = columns.iter().map(|column| reader.own_column(column));
            let ids = ids.collect::<Result<Vec<_>>>()?;
            copy_if(&mut reader, &to.join(name), |row| {
                let mut keep = true;
                for &id in &ids {
                    keep &= all || kept.contains(row.whole(id)?);
                }
                *count += u64::from(keep);
                Ok(keep)
            })?;
        }
        Ok(counts)
    }
}

/// Copies the rows of kept surfaces; the cells that these border.
fn copy_surfaces(
    from: &Path,
    to: &Path,
    manifest: &Manifest,
    choice: &Choice,
    rows: &mut Rows,
) -> Result<IdSet> {
    let mut cells = IdSet::default();
    let reader = Table::Surfaces.open(from, manifest)?;
    let [cell, object] = [reader.own_column("cell")?, reader.own_column("object")?];
    let vertices = reader.own_column("vertices")?;
    let border = reader.own_column("border_edges")?;
    filter(from, to, manifest, Table::Surfaces, |row, surface| {
        let ids = PieceIds {
            cell: row.whole(cell)?,
            object: row.whole(object)?,
            surface,
            ..PieceIds::default()
        };
        let keep = choice.style(&ids).is_some();
        let counts = rows.objects.entry(ids.object).or_default();
        counts[1] = counts[1].saturating_add(1);
        if keep {
            counts[0] += 1;
            rows.surfaces += 1;
            rows.vertices = rows.vertices.saturating_add(row.whole(vertices)?);
            rows.border_edges = rows.border_edges.saturating_add(row.whole(border)?);
            if !cells.insert(ids.cell) {
                rows.several.insert(ids.cell);
            }
        }
        Ok(keep)
    })?;
    rows.objects.retain(|_, [kept, _]| *kept > 0);
    Ok(cells)
}

/// Copies the rows that `keep` accepts by their id.
fn filter(
    from: &Path,
    to: &Path,
    manifest: &Manifest,
    table: Table,
    mut keep: impl FnMut(&Row, u64) -> Result<bool>,
) -> Result<()> {
    let mut reader = table.open(from, manifest)?;
    let id = reader.column("id").unwrap_or(0);
    copy_if(&mut reader, &to.join(table.file()), |row| {
        keep(row, row.whole(id)?)
    })
}

/// Copies the rows that `keep` accepts to a new file.
fn copy_if(
    reader: &mut TableReader,
    path: &Path,
    mut keep: impl FnMut(&Row) -> Result<bool>,
) -> Result<()> {
    let failed = |e| Error::io(path, "write", e);
    let mut out = BufWriter::new(File::create(path).map_err(failed)?);
    let header: Vec<String> = reader.columns().iter().map(|c| c.header()).collect();
    writeln!(out, "{}", header.join(",")).map_err(failed)?;
    while let Some(row) = reader.next_row()? {
        if keep(&row)? {
            writeln!(out, "{}", row.line()?).map_err(failed)?;
        }
    }
    out.flush().map_err(failed)
}
