//! What was converted, and how.

use super::super::Report;
use super::pairs;
use crate::grid::filters_text;
use crate::words::{count, exact, things};
use maud::{Markup, html};
use serde::Serialize;

/// A value as the index has it.
fn word(value: impl Serialize) -> String {
    let json = serde_json::to_value(value).unwrap_or_default();
    json.as_str().map_or_else(|| json.to_string(), String::from)
}

fn times(values: [f64; 3]) -> String {
    values.map(exact).join(" × ")
}

/// The input, its settings and the tile set.
pub fn section(report: &Report) -> Markup {
    let mut rows = input(report);
    rows.extend(surface(report));
    html! { h2 { "Input and settings" } (pairs(&rows)) }
}

fn dims(d: [u32; 3]) -> String {
    d.map(|n| n.to_string()).join(" × ")
}

/// What was read, and what was done to it before the threshold.
fn input(report: &Report) -> Vec<(&'static str, String)> {
    let s = &report.settings;
    let source = &s.source;
    let samples = [
        format!("{} voxels", dims(source.dims.0)),
        source.dtype.to_string(),
        source.format.clone(),
    ];
    let mut rows = vec![
        ("input", source.name.clone()),
        ("samples", samples.join(", ")),
    ];
    rows.extend(source.values.clone().map(|values| ("values", values)));
    if !s.filters.is_empty() {
        rows.push(("filters", filters_text(&s.filters)));
    }
    rows.extend(source.crop.as_ref().map(|crop| ("crop", crop.to_string())));
    if let Some(region) = &s.region {
        let share = 100.0 * region.voxels as f64 / s.grid.dims.voxels() as f64;
        let text = format!("{region}, {share:.1} % of the grid inside");
        rows.push(("region", text));
    }
    rows.push(("grid", format!("{} voxels", dims(s.grid.dims.0))));
    let place = &s.placement;
    let from = word(source.provenance.spacing[0]);
    let text = format!("{} {} (from: {from})", times(place.spacing), place.unit);
    rows.push(("voxel", text));
    rows
}

/// How the surface was made, and what it is.
fn surface(report: &Report) -> Vec<(&'static str, String)> {
    let s = &report.settings;
    let mut rows = vec![
        ("threshold", exact(s.threshold)),
        ("ambiguous faces", word(s.ambiguous)),
    ];
    if s.cap {
        rows.push(("surface", "closed at the faces of the grid".to_owned()));
    }
    rows.extend(s.cells.as_ref().map(|by| ("cells", by.to_string())));
    if let Some(dust) = s.dust {
        let text = format!(
            "objects and cells of fewer than {} voxels left out: {} with {}, {} with {}",
            dust.min_voxels,
            things(dust.objects, "object"),
            things(dust.object_voxels, "voxel"),
            things(dust.cells, "cell"),
            things(dust.cell_voxels, "voxel")
        );
        rows.push(("dust", text));
    }
    if s.selection.is_some() {
        let text = "chosen from, or painted of, another set; its index says how";
        rows.push(("selection", text.to_owned()));
    }
    if report.totals.voxels_nan > 0 {
        let text = format!(
            "{}, taken for air",
            things(report.totals.voxels_nan, "voxel")
        );
        rows.push(("no number", text));
    }
    rows.push(("triangles", count(report.totals.triangles)));
    let checksum = s.index_checksum.as_deref().unwrap_or("none");
    let text = format!("checksum {checksum}, which covers all files of the set");
    rows.push(("index", text));
    rows
}
