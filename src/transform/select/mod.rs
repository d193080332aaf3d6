//! A part of a tile set, or a painted copy: the pieces of chosen cells, objects or surfaces in a tile set of their own.
//!
//! What is chosen is kept or left out with all its surfaces, so edges still meet. Geometry is copied bit
//! for bit, ids and measures stay those of the whole, and tiles without a kept piece vanish.
//! Cells and objects that were not chosen from stay as long as they have a kept surface. Caps stay if all surfaces of
//! the objects in the part are kept, for then they still close them; else all caps go and the part is open at the
//! volume's faces, as a set made without `--cap` is.

mod choice;
mod legend;
mod rows;
mod tiles;

pub use crate::picture::{Map, hex, parse_colour};
pub use choice::{ColourRule, PaintRule};

use crate::error::Result;
use crate::manifest::{Manifest, Selection, Tables, WholeTotals};
use crate::progress::Progress;
use crate::table::{Chosen, Table, warn_of_outside};
use crate::tileset::{Output, TileSet, TilesetWriter, outward, refuse_same};
use choice::Choice;
use serde::Serialize;
use std::path::Path;
use tiles::{Kept, copy_tiles};

/// What to keep and how to paint it.
#[derive(Debug, Clone, Default)]
pub struct SelectOptions {
    /// The cells, objects or surfaces; conditions of colours are on the same table.
    pub chosen: Chosen,
    /// Leave out those that are chosen, instead of keeping them.
    pub omit: bool,
    /// Colours of some of them, later ones over earlier ones and all over `colour_by`.
    pub paint: Vec<PaintRule>,
    /// Colours by the values of a column.
    pub colour_by: Option<ColourRule>,
    /// Replace a tile set that is in the destination.
    pub force: bool,
}

/// What a selection made; the command prints it with `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SelectReport {
    /// Tiles written.
    pub tiles: u64,
    /// Triangles in them.
    pub triangles: u64,
    /// Cells kept.
    pub cells: u64,
    /// Objects kept.
    pub objects: u64,
    /// Surfaces kept.
    pub surfaces: u64,
    /// Bytes of the tiles.
    pub bytes: u64,
    /// How the part was chosen, as in its manifest.
    pub selection: Selection,
    /// Things the user should know, such as that nothing is left.
    pub warnings: Vec<String>,
}

/// Writes a part of the tile set in `from`, or a painted copy, to the directory `to`. Memory: some 16
/// bytes per row that is kept, 40 per object, and a tile per thread.
///
/// # Errors
/// [`crate::Error::Usage`] for conditions and colours that cannot be, or if both directories are the same;
/// [`crate::Error::OutputExists`]; [`crate::Error::Format`] if the tile set is damaged; [`crate::Error::Io`];
/// [`crate::Error::Interrupted`]. Nothing is left under a final name then.
pub fn select(
    from: &Path,
    to: &Path,
    options: &SelectOptions,
    progress: &dyn Progress,
) -> Result<SelectReport> {
    select_into(from, to, options, progress).map_err(|e| outward(e, to))
}

fn select_into(
    from: &Path,
    to: &Path,
    options: &SelectOptions,
    progress: &dyn Progress,
) -> Result<SelectReport> {
    let set = TileSet::open(from)?;
    let manifest = set.manifest();
    refuse_same(from, to)?;
    let choice = Choice::new(from, manifest, options)?;
    let outside = warn_of_outside(from, manifest, &options.chosen, options.omit)?;
    let output = Output::create(to, options.force)?;
    let work = output.work();
    let mut made = manifest.clone();
    let rows = rows::copy_rows(from, work, manifest, &choice)?;
    let kept = Kept {
        choice: &choice,
        rows: &rows,
        caps: manifest.cap && rows.complete(),
        primitives: manifest.primitives,
    };
    let mut writer = TilesetWriter::new(work)?;
    copy_tiles(&set, &mut writer, &mut made, &kept, progress)?;
    if let Some(legend) = choice.legend() {
        legend::write(work, legend)?;
    }
    let selection = choice.selection(manifest);
    made.selection = Some(selection.clone());
    made.lod = None;
    made.tables = Tables::named(manifest.tables.parquet.is_some()).with_those_of(&manifest.tables);
    if manifest.cells.is_some() {
        made.totals.components = rows.components;
        made.totals.necks = rows.necks;
    }
    made.totals.walls = rows.walls;
    let totals = made.totals;
    made.layers.clear();
    writer.finish(made)?;
    output.commit()?;
    let mut warnings: Vec<String> = choice.lost_colours().into_iter().collect();
    warnings.extend(outside);
    if totals.surfaces == 0 {
        warnings.push(match options.chosen.table {
            Table::Surfaces => "no surface is left: the tile set is empty".to_owned(),
            table => {
                let name = table.singular();
                format!("no {name} with a surface is left: the tile set is empty")
            }
        });
    }
    warnings.iter().for_each(|w| progress.warn(w));
    Ok(SelectReport {
        tiles: totals.tiles,
        triangles: totals.triangles,
        cells: totals.cells,
        objects: totals.objects,
        surfaces: totals.surfaces,
        bytes: totals.bytes,
        selection,
        warnings,
    })
}

/// What the whole had, of which `manifest` may be a part already.
fn whole(manifest: &Manifest) -> WholeTotals {
    match &manifest.selection {
        Some(earlier) => earlier.of,
        None => WholeTotals {
            cells: manifest.totals.cells,
            objects: manifest.totals.objects,
            surfaces: manifest.totals.surfaces,
            voxels_above: manifest.totals.voxels_above,
        },
    }
}
