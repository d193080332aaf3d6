//! `alvis lod`: levels of detail over a tile set.

use super::args::Common;
use super::progress::Console;
use super::{Outcome, output, parse};
use crate::error::{Error, Result};
use crate::lod::{LodOptions, LodReport, lod};
use crate::manifest::Manifest;
use crate::sys::process_memory::keep_large_buffers;
use clap::{Args, ValueHint};
use std::path::{Path, PathBuf};

/// Add levels of detail to a tile set, for viewers that cannot show all triangles
///
/// Each node of a level stands for 2 x 2 x 2 of the level below, down to one root. The tiles stay as they are. Nodes of
/// a level meet edge by edge; between levels fins close what could be seen through. tileset.json has the same tree for
/// viewers of 3D Tiles 1.1. A set made with --split or --labels gets no levels: they would gape where cells touch.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis lod OUT\n  \
    alvis lod OUT --ratio 1/4 --force\n  \
    alvis lod OUT --levels 3 --memory 512MiB")]
pub struct LodArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// Share of the triangles that a level keeps of the one below, at most 1/2: 1/8, 0.2 or 20%
    ///
    /// Top levels of small sets keep more, often over half: a node may keep up to 1000.
    #[arg(long, value_name = "SHARE", default_value = "1/8", allow_hyphen_values = true, value_parser = share)]
    ratio: f64,
    /// The most levels, the tiles counted: 2 to 32 [default: as many as lead to one root]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=32))]
    levels: Option<u32>,
    /// Pixels that an error may have on the screen in viewers of 3D Tiles with their usual settings, 0.001 to 1000
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pixel_error: f64,
    /// Most memory to use
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = parse::bytes)]
    memory: u64,
    /// Go on with levels that were interrupted while they were made, also in place of finished ones
    ///
    /// --ratio has to be as it was; --levels and --pixel-error may change. If there are none to go on with they are begun,
    /// unless these levels are there and finished: then nothing is done.
    #[arg(long)]
    resume: bool,
    /// Replace levels that are there, or begin anew those that were interrupted
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    common: Common,
}

/// Reads a share: a quotient, a number or a percentage.
fn share(text: &str) -> Result<f64, String> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let value = match (text.split_once('/'), text.strip_suffix('%')) {
        (Some((a, b)), _) => number(a).zip(number(b)).map(|(a, b)| a / b),
        (None, Some(percent)) => number(percent).map(|p| p / 100.0),
        (None, None) => number(text),
    };
    let value = value.filter(|v| *v > 0.0 && *v <= 0.5);
    value
        .ok_or_else(|| "expected a share above 0 and at most 1/2, as in 1/8, 0.2 or 20%".to_owned())
}

/// Makes levels of detail in this process, which may be stopped.
///
/// # Errors
/// Those of [`lod`].
pub fn make(out: &Path, options: &LodOptions, console: &Console) -> Result<LodReport> {
    console.listen();
    keep_large_buffers();
    lod(out, options, console).inspect_err(|e| {
        if matches!(e, Error::Interrupted) {
            console.note(&format!(
                "no level of detail was begun yet, so nothing of them is kept; the tiles are there and whole: \
                 `alvis lod {}` adds levels",
                output::shell(out)
            ));
        }
    })
}

impl LodArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let options = LodOptions {
            ratio: self.ratio,
            levels: self.levels,
            pixel_error: self.pixel_error,
            memory: self.memory,
            threads: self.common.threads.map_or(0, usize::from),
            resume: self.resume,
            force: self.force,
        };
        let report = make(&self.out, &options, &console)?;
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&summary(&report))?;
        }
        Ok(Outcome::Done)
    }
}

/// Says of a set made of another one, in `dest`, that it has none of the levels of that.
///
/// # Errors
/// Those of [`Manifest::open`].
pub fn note_dropped(from: &Path, dest: &Path, console: &Console) -> Result<()> {
    if Manifest::open(from)?.lod.is_some() {
        let dest = output::shell_word(dest.as_os_str());
        console.note(&format!(
            "levels of detail are not kept: `alvis lod {dest}` makes them"
        ));
    }
    Ok(())
}

/// What was made, or is there, for people.
pub fn summary(report: &LodReport) -> String {
    let mut rows = Vec::new();
    let names: Vec<String> = (1..report.levels).map(|l| format!("level {l}")).collect();
    let of = output::things(report.cells_by_level[0], "cell");
    for (l, name) in (1..).zip(&names) {
        rows.push((
            name.as_str(),
            format!(
                "{}, {} of {of}, 99.9 % within {:.2} voxels",
                output::things(report.triangles_by_level[l], "triangle"),
                output::count(report.cells_by_level[l]),
                report.error_by_level[l]
            ),
        ));
    }
    let nodes = output::things(report.nodes, "node");
    let title = match report.bytes_written {
        0 => "there",
        _ => "written",
    };
    rows.push((title, format!("{nodes}, {}", output::bytes(report.bytes))));
    rows.push(("took", output::took(report.seconds, report.peak_rss_bytes)));
    output::table(&rows)
}
