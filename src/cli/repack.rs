//! `alvis repack`: a tile set in another form.

use super::args::Common;
use super::form::FormArgs;
use super::lod::note_dropped;
use super::{Outcome, output};
use crate::error::{Error, Result};
use crate::manifest::{Form, Manifest};
use crate::transform::repack::{RepackOptions, RepackReport, repack};
use clap::{Args, ValueHint};
use std::path::PathBuf;

/// Write a tile set in another form, for another program, without the volume
///
/// Triangles, vertices, ids, measures and colours stay, and so do the tables. What is not asked for
/// stays as it is. Positions are exact in every form; normals lose at most 0.9 degrees when they are
/// first quantized, and nothing after that.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis repack OUT WEB --for web\n  \
    alvis repack WEB LISTS --for meshlab\n  \
    alvis repack OUT SMALL --encoding quantized")]
pub struct RepackArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// The directory to write
    #[arg(value_hint = ValueHint::DirPath)]
    dest: PathBuf,
    /// Replace a tile set that is in the directory
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    form: FormArgs,
    #[command(flatten)]
    common: Common,
}

impl RepackArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        if self.form.is_empty() {
            return Err(Error::usage(
                "repack",
                "nothing to do",
                "--for, --primitives, --encoding or --layout",
            ));
        }
        let manifest = Manifest::open(&self.out)?;
        let options = RepackOptions {
            form: self.form.form(Form::of(&manifest)),
            force: self.force,
        };
        let report = repack(&self.out, &self.dest, &options, &console)?;
        note_dropped(&self.out, &self.dest, &console)?;
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&summary(&report))?;
        }
        Ok(Outcome::Done)
    }
}

fn summary(report: &RepackReport) -> String {
    let per_triangle = report.bytes as f64 / report.triangles.max(1) as f64;
    output::table(&[
        (
            "tiles",
            format!(
                "{}, {}, before {}",
                output::count(report.tiles),
                output::bytes(report.bytes),
                output::bytes(report.bytes_before)
            ),
        ),
        (
            "triangles",
            format!(
                "{}, {per_triangle:.2} bytes each",
                output::count(report.triangles)
            ),
        ),
        ("took", output::took(report.seconds, report.peak_rss_bytes)),
    ])
}
