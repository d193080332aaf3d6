//! `alvis export`: one mesh of a tile set.

use super::args::Common;
use super::chosen::ChosenArgs;
use super::{Outcome, output, parse};
use crate::error::Result;
use crate::export::{ExportOptions, ExportReport, Simplify, export};
use crate::words::rounded;
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// Write a tile set, or some of its cells or objects, as one mesh: GLB, PLY, STL or OBJ
///
/// Vertices on the planes between tiles are joined, so the mesh is closed wherever the surface is.
/// Memory does not grow with the surface. Coordinates are in the unit of the tile set with Z up; in GLB
/// a node turns voxels into metres with Y up, as in the tiles. PLY has the ids of cell and object for
/// each triangle, OBJ a group for each cell (`cell_17`; it comes once for each tile with a part of it),
/// GLB the cell of each vertex.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis export OUT surface.ply\n  \
    alvis export OUT pores.stl --where 'not touches_border and volume > 0.1'\n  \
    alvis export OUT bone.stl --objects --largest 1\n  \
    alvis export OUT small.glb --simplify 0.2\n  \
    alvis export OUT small.obj --simplify 0.5vx")]
pub struct ExportArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// The file to write; its name ends in .glb, .ply, .stl or .obj
    #[arg(value_hint = ValueHint::FilePath)]
    file: PathBuf,
    #[command(flatten)]
    chosen: ChosenArgs,
    /// Fewer triangles: a share of them to keep, as in 0.1, or the largest error, as in 0.5vx (voxels)
    /// or 20um. The mesh stays without holes: what lies at a border of tiles is kept
    #[arg(long, value_name = "RATIO|ERROR", allow_hyphen_values = true)]
    simplify: Option<Simplify>,
    /// Limit of resident memory; 2g is 2 * 10^9 bytes, 2GiB is 2 * 2^30
    #[arg(long, value_name = "SIZE", default_value = "1GiB", value_parser = parse::bytes)]
    memory: u64,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    common: Common,
}

impl ExportArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let options = ExportOptions {
            chosen: self.chosen.chosen(),
            simplify: self.simplify,
            memory: self.memory,
            force: self.force,
        };
        let report = export(&self.out, &self.file, &options, &console)?;
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&summary(&self.file.display().to_string(), &report))?;
        }
        Ok(Outcome::Done)
    }
}

fn summary(file: &str, report: &ExportReport) -> String {
    let mut triangles = output::count(report.triangles);
    if let Some(before) = report.triangles_before {
        let share = 100.0 * report.triangles as f64 / before.max(1) as f64;
        triangles += &format!(" of {}, {share:.1} %", output::count(before));
    }
    let mut rows = vec![
        ("file", format!("{file}, {}", output::bytes(report.bytes))),
        ("triangles", triangles),
    ];
    if let Some(vertices) = report.vertices {
        rows.push(("vertices", output::count(vertices)));
    }
    if let Some(error) = report.error {
        rows.push((
            "error",
            format!("about {} {} at most", rounded(error, 4), report.unit),
        ));
    }
    rows.push(("took", output::took(report.seconds, report.peak_rss_bytes)));
    output::table(&rows)
}
