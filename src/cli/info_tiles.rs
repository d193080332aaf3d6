//! `alvis info` of a tile set: what it is, and what can be done with it.

use super::convert::from;
use super::output::{self, things};
use super::region::region_text;
use crate::error::Result;
use crate::grid::{Ambiguous, Dims, Filter, Placement, Region, Unit, filters_text};
use crate::manifest::{
    Encoding, FORMAT, Layout, Level, Levels, MANIFEST, Manifest, PARTIAL, PartsBy, Primitives,
    Selection, Step, Table, Totals,
};
use crate::store;
use serde::Serialize;
use std::path::Path;

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub struct Report<'a> {
    format: &'static str,
    name: String,
    dims: Dims,
    spacing: [f64; 3],
    unit: Unit,
    table_unit: Unit,
    origin: [f64; 3],
    directions: [[f64; 3]; 3],
    source: &'a str,
    filters: &'a [Filter],
    #[serde(skip_serializing_if = "Option::is_none")]
    region: Option<&'a Region>,
    generator: String,
    threshold: f64,
    ambiguous: Ambiguous,
    cap: bool,
    min_voxels: u64,
    macrocube: [u32; 3],
    primitives: Primitives,
    encoding: Encoding,
    layout: Layout,
    totals: Totals,
    /// What cells are, where they are parts of components.
    #[serde(skip_serializing_if = "Option::is_none")]
    cells: Option<&'a PartsBy>,
    selection: Option<&'a Selection>,
    /// Levels of detail over the tiles, the coarsest last.
    #[serde(skip_serializing_if = "Option::is_none")]
    levels: Option<&'a [Level]>,
}

/// True if a directory has the index of a tile set, or has one in the making.
pub fn is_tile_set(path: &Path) -> bool {
    store::is_file(&path.join(MANIFEST)) || path.join(PARTIAL).is_dir()
}

/// Prints what the tile set in `dir` is.
///
/// # Errors
/// Those of [`Manifest::open`].
pub fn print(dir: &Path, as_json: bool) -> Result<()> {
    let opened = OpenedTiles::open(dir)?;
    if as_json {
        return output::print_json(&opened.report());
    }
    output::print(&text(dir, &opened.manifest, opened.levels.as_ref()))
}

/// A tile set, and what its levels of detail say.
pub struct OpenedTiles<'a> {
    dir: &'a Path,
    manifest: Manifest,
    levels: Option<Levels>,
}

impl<'a> OpenedTiles<'a> {
    /// Of the tile set in `dir`.
    ///
    /// # Errors
    /// Those of [`Manifest::open`] and [`Levels::open`].
    pub fn open(dir: &'a Path) -> Result<Self> {
        let manifest = Manifest::open(dir)?;
        let levels = Levels::open(dir, &manifest)?;
        Ok(OpenedTiles {
            dir,
            manifest,
            levels,
        })
    }

    /// What `--json` prints.
    pub fn report(&self) -> Report<'_> {
        Report {
            levels: self.levels.as_ref().map(|l| &l.levels[..]),
            ..report(self.dir, &self.manifest)
        }
    }
}

fn report<'a>(dir: &Path, m: &'a Manifest) -> Report<'a> {
    Report {
        format: FORMAT,
        name: crate::volume::file_name(dir),
        dims: m.grid.dims,
        spacing: m.placement.spacing,
        unit: m.placement.unit,
        table_unit: m.measured().unit,
        origin: m.placement.origin,
        directions: m.placement.directions,
        source: &m.source.name,
        filters: &m.filters,
        region: m.region.as_ref(),
        generator: made_by(m),
        threshold: m.threshold,
        ambiguous: m.ambiguous,
        cap: m.cap,
        min_voxels: m.dust.map_or(0, |d| d.min_voxels),
        macrocube: m.grid.macrocube,
        primitives: m.primitives,
        encoding: m.encoding,
        layout: m.layout,
        totals: m.totals,
        cells: m.cells.as_ref(),
        selection: m.selection.as_ref(),
        levels: None,
    }
}

fn made_by(m: &Manifest) -> String {
    format!("{} {}", m.generator.name, m.generator.version)
}

/// A value of the index as it stands there.
fn word(value: impl Serialize) -> String {
    let json = serde_json::to_value(value).unwrap_or_default();
    json.as_str().map_or_else(|| json.to_string(), String::from)
}

/// Where the tiles come from.
fn origin(m: &Manifest) -> Vec<(&'static str, String)> {
    let source = &m.source;
    let mut made = format!("{}, {} voxels, {}", source.name, source.dims, source.dtype);
    if let Some(crop) = &source.crop {
        // a crop counts the voxels that filters leave
        let of = if m.filters.is_empty() {
            ""
        } else {
            "filtered and then "
        };
        made += &format!(", {of}cropped to {crop}");
    }
    vec![("made from", made), ("made by", made_by(m))]
}

/// One choice; the table is named if it is not that of the last.
fn chosen(step: &Step, last: Table) -> String {
    let mut text = match step.omit {
        true => "without those".to_owned(),
        false => String::new(),
    };
    if step.table != last {
        text += &format!(" of {}", step.table.name());
    }
    match step.largest {
        None => {}
        Some(1) => text += " the largest",
        Some(n) => text += &format!(" the {} largest", output::count(n)),
    }
    if let Some(condition) = &step.condition {
        text += &format!(" where {condition}");
    }
    text.trim_start().to_owned()
}

/// What was chosen of another tile set.
fn selected(selection: &Selection, m: &Manifest) -> String {
    let table = selection.last.table;
    let (part, whole) = (table.total(m), selection.of.of(table));
    let mut text = format!(
        "{} of {}",
        output::count(part),
        things(whole, table.singular())
    );
    for step in selection.steps().filter(|step| step.chooses()) {
        text += &format!(", {}", chosen(step, table));
    }
    if let Some(by) = &selection.colour_by {
        text += &format!("; coloured by {}", by.column);
    }
    if !selection.painted.is_empty() {
        text += "; painted";
    }
    text
}

fn text(dir: &Path, m: &Manifest, levels: Option<&Levels>) -> String {
    let t = &m.totals;
    let Placement { spacing, unit, .. } = m.placement;
    let stated = from(m.source.provenance.spacing[0]);
    let mut rows = vec![(
        "tile set",
        format!(
            "{}: {}, {}",
            dir.display(),
            things(t.tiles, "tile"),
            output::bytes(t.bytes)
        ),
    )];
    rows.extend(origin(m));
    if !m.filters.is_empty() {
        rows.push(("filters", filters_text(&m.filters)));
    }
    rows.push(("dims", format!("{} voxels", m.grid.dims)));
    if let Some(region) = &m.region {
        rows.push(("region", region_text(region, m.grid.dims)));
    }
    rows.push((
        "spacing",
        format!("{} {unit} ({stated})", output::times(spacing)),
    ));
    if m.measured().unit != unit {
        rows.push(("tables", format!("lengths in {}", m.measured().unit)));
    }
    rows.push(("threshold", m.threshold.to_string()));
    if let Some(dust) = m.dust {
        let text = format!("objects and cells of fewer than {} voxels", dust.min_voxels);
        rows.push(("left out", text));
    }
    let caps = if m.cap {
        ", closed at the edge of the grid"
    } else {
        ""
    };
    rows.push((
        "surface",
        format!("{}{caps}", things(t.triangles, "triangle")),
    ));
    let parts = [
        things(t.objects, "object"),
        output::cells_of(t),
        things(t.surfaces, "surface"),
    ];
    rows.push(("parts", parts.join(", ")));
    rows.extend(m.cells.as_ref().map(|by| ("cells", by.to_string())));
    let form = [word(m.primitives), word(m.encoding), word(m.layout)];
    rows.push((
        "form",
        format!("{}, encoding {}, layout {}", form[0], form[1], form[2]),
    ));
    if let Some(levels) = levels {
        let counts = levels.levels.iter().map(|l| output::count(l.triangles));
        // a number has commas of its own
        let counts = counts.collect::<Vec<_>>().join("; ");
        rows.push(("levels", format!("of detail, with {counts} triangles")));
    }
    if let Some(selection) = &m.selection {
        rows.push(("selection", selected(selection, m)));
    }
    output::table(&rows) + &next(dir)
}

/// What can be done with it.
fn next(dir: &Path) -> String {
    let out = output::shell(dir);
    format!(
        "\n\
         Prove that it has no hole:  alvis verify {out}\n\
         List its cells:             alvis cells {out}\n\
         Sum them up:                alvis cells {out} --summary\n\
         Take a part, or colour it:  alvis select {out} DEST --where 'not touches_border'\n\
         Write one mesh:             alvis export {out} FILE.ply\n\
         For another program:        alvis repack {out} DEST --for web\n"
    )
}
