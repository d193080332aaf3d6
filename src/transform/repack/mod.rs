//! A tile set in another form: other primitives, encoding or layout, the same surface.
//!
//! No volume is needed. Tiles are read and written one by one, so memory is a tile per thread and two bits per
//! cell. What stays: positions to the bit, the order of vertices and
//! pieces, ids, measures, colours and the tables. Strips stay to the entry as long as they stay
//! strips, so going to the web and back gives the same files but for the normals, which the quantized
//! encodings round once.

mod tiles;

use crate::error::{Error, Result};
use crate::manifest::{
    COMPONENTS, Form, LEGEND, LEGEND_SVG, Manifest, NECKS, Tables, Totals, WALLS,
};
use crate::progress::Progress;
use crate::store;
use crate::table::Table;
use crate::tile::check_reach;
use crate::tileset::{Output, TileSet, TilesetWriter, outward, refuse_same};
use crate::transform::ids::several;
use crate::transform::new_tiles::make_tiles;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// What to write.
#[derive(Debug, Clone, Copy, Default)]
pub struct RepackOptions {
    /// The form of the new tiles.
    pub form: Form,
    /// Replace a tile set that is in the destination.
    pub force: bool,
}

/// What was written; the command prints it with `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RepackReport {
    /// Tiles written.
    pub tiles: u64,
    /// Triangles in them.
    pub triangles: u64,
    /// Bytes of the tiles.
    pub bytes: u64,
    /// Bytes that they had before.
    pub bytes_before: u64,
    /// Wall time.
    pub seconds: f64,
    /// Largest resident set of the process so far, in bytes.
    pub peak_rss_bytes: u64,
}

/// Writes the tile set in `from` in another form to the directory `to`.
///
/// # Errors
/// [`Error::Usage`] if both directories are the same, or macrocubes are too large for the encoding;
/// [`Error::OutputExists`]; [`Error::Format`] if the tile set is damaged; [`Error::Io`];
/// [`Error::Interrupted`]. Nothing is left under a final name then.
pub fn repack(
    from: &Path,
    to: &Path,
    options: &RepackOptions,
    progress: &dyn Progress,
) -> Result<RepackReport> {
    repack_into(from, to, options, progress).map_err(|e| outward(e, to))
}

fn repack_into(
    from: &Path,
    to: &Path,
    options: &RepackOptions,
    progress: &dyn Progress,
) -> Result<RepackReport> {
    let start = Instant::now();
    let set = TileSet::open(from)?;
    let manifest = set.manifest();
    refuse_same(from, to)?;
    let tiling = manifest.tiling();
    check_reach(options.form.encoding, tiling)?;
    let several = several(&set)?;
    let output = Output::create(to, options.force)?;
    let work = output.work();
    let mut made = manifest.clone();
    made.primitives = options.form.primitives;
    made.encoding = options.form.encoding;
    made.layout = options.form.layout;
    made.lod = None;
    copy_tables(&set, work, &mut made)?;
    let recoder = tiles::Recoder {
        form: options.form,
        several: &several,
    };
    let mut writer = TilesetWriter::new(work)?;
    make_tiles(&set, &recoder, &mut writer, progress, |()| {})?;
    let written = writer.written();
    let totals = Totals {
        strips: written.strips,
        strip_indices: written.strip_indices,
        bytes: written.bytes,
        ..made.totals
    };
    made.totals = totals;
    made.layers.clear();
    writer.finish(made)?;
    output.commit()?;
    Ok(RepackReport {
        tiles: totals.tiles,
        triangles: totals.triangles,
        bytes: totals.bytes,
        bytes_before: manifest.totals.bytes,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: crate::sys::process_memory::peak_rss_bytes(),
    })
}

/// Copies the tables, and the picture of colours if there is one, under the names of the format.
fn copy_tables(set: &TileSet, work: &Path, made: &mut Manifest) -> Result<()> {
    let copy = |name: &str, file: &str| {
        let source = set.path(name)?;
        let copied = store::copy(&source, &work.join(file));
        copied.map_err(|e| Error::io(&source, "copy", e))
    };
    copy(&made.tables.cells, Table::Cells.file())?;
    copy(&made.tables.objects, Table::Objects.file())?;
    copy(&made.tables.surfaces, Table::Surfaces.file())?;
    for (name, file) in [
        (&made.tables.components, COMPONENTS),
        (&made.tables.necks, NECKS),
        (&made.tables.walls, WALLS),
    ] {
        if let Some(name) = name {
            copy(name, file)?;
        }
    }
    let tables = Tables::named(made.tables.parquet.is_some()).with_those_of(&made.tables);
    // those in Parquet are made of these
    made.tables = tables;
    let selection = made.selection.as_mut();
    if let Some(colours) = selection.and_then(|s| s.colour_by.as_mut()) {
        // sets may lack the SVG, which the index does not name
        let svg = set.dir().join(LEGEND_SVG);
        if svg.is_file() {
            copy(LEGEND_SVG, LEGEND_SVG)?;
        }
        copy(&colours.legend, LEGEND)?;
        colours.legend = LEGEND.to_owned();
    }
    Ok(())
}
