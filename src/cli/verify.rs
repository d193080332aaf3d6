//! `alvis verify`: the proof that a tile set has no hole.

use super::against::{Asked, open_against};
use super::args::{Common, InputOptions};
use super::input::{Input, check_read};
use super::progress::Console;
use super::{Outcome, labels, output};
use crate::error::{Error, Result};
use crate::manifest::{Manifest, PARTIAL};
use crate::progress::Progress;
use crate::tileset::{LevelsLeft, interrupted, levels_left};
use crate::verify::{self, Issue, LabelVolume, Report, Severity, VerifyOptions};
use crate::volume::{self, Opened, Stamp, Volume};
use clap::{Args, ValueHint};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Rebuild the surface from the tiles and prove that it has no hole
///
/// Exit status 0 if it has none, 1 if there are issues, 2 if the check itself could not be made.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis verify OUT\n  \
    alvis verify OUT --against scan.mhd\n  \
    alvis verify OUT --json --max-issues 10")]
pub struct VerifyArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// Also compare the surface with this volume, voxel by voxel
    #[arg(long, value_name = "INPUT", value_hint = ValueHint::FilePath)]
    pub against: Option<PathBuf>,
    /// Also compare cells with this volume of labels, which --labels of the conversion was given: voxel by voxel
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    labels: Option<PathBuf>,
    /// Issues to print; the rest are counted
    #[arg(
        long,
        value_name = "N",
        default_value = "1000",
        allow_negative_numbers = true
    )]
    max_issues: usize,
    #[command(flatten)]
    input: InputOptions,
    #[command(flatten)]
    pub common: Common,
}

impl VerifyArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let against = self.against.as_deref().map(Input::Path);
        let report = self.verify(against, &console)?;
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else {
            let verdict = self.common.talks().then(|| verdict(&report));
            output::print(&(issues(&report) + &verdict.unwrap_or_default()))?;
        }
        Ok(if report.ok {
            Outcome::Done
        } else {
            Outcome::Issues
        })
    }

    /// Verifies the tile set, and compares it with a volume if there is one.
    pub fn verify(&self, against: Option<Input>, console: &Console) -> Result<Report> {
        let against = match against {
            Some(input) => {
                let asked = Asked::of(&self.input, console);
                Some(open_against(&self.out, input, asked)?)
            }
            None => {
                self.input.refuse_without_volume("--against INPUT")?;
                if self.labels.is_some() {
                    let expected = "it together with --against INPUT, whose voxels it labels";
                    return Err(Error::usage("--labels", "it alone", expected));
                }
                None
            }
        };
        let once = match &against {
            Some(against) => copied(against.volume.as_ref(), &std::env::temp_dir())?,
            None => None,
        };
        let given = self.labels.as_deref().map(|path| self.labels(path));
        let (given, given_stamp) = given.transpose()?.unzip();
        let given_once = match &given {
            Some(given) => copied(given.volume.as_ref(), &std::env::temp_dir())?,
            None => None,
        };
        let options = VerifyOptions {
            against: once
                .as_deref()
                .or(against.as_ref().map(|a| a.volume.as_ref())),
            labels: given.as_ref().map(|given| LabelVolume {
                name: &given.name,
                volume: given_once.as_deref().unwrap_or(given.volume.as_ref()),
            }),
            source: against.as_ref().map(|a| &a.source),
            region: against.as_ref().and_then(|a| a.region.as_ref()),
            threads: self.common.threads.map_or(0, usize::from),
            max_issues: self.max_issues,
        };
        let report = verify::verify(&self.out, &options, console)?;
        if let Some(against) = &against
            && let Some(warning) = against.stamp.check()?
        {
            console.warn(&warning);
        }
        if let Some(stamp) = &given_stamp {
            check_read(stamp, console)?;
        }
        if let Some(warning) = unfinished(&self.out) {
            console.warn(&warning);
        }
        Ok(report)
    }
}

/// What lies beside a set and is not finished, and how to go on with it.
fn unfinished(out: &Path) -> Option<String> {
    let (name, typed) = (out.display(), output::shell(out));
    match levels_left(out) {
        Some(LevelsLeft::Begun) => Some(format!(
            "{name}: levels of detail of this set are not finished ({PARTIAL}): `alvis lod {typed} --resume`, with the \
             options that they were begun with, goes on with them"
        )),
        Some(LevelsLeft::MovingIn) => Some(format!(
            "{name}: levels of detail of this set are all made, and not all in place, so that they are not checked \
             ({PARTIAL}): `alvis lod {typed} --resume`, with the options that they were begun with, moves in the rest"
        )),
        None => interrupted(out).map(|kept| {
            format!(
                "{name}: beside this set lies a conversion that is not finished, {} of {} layers are done ({PARTIAL}): \
                 the same `alvis convert` with --resume goes on with it",
                kept.done, kept.of
            )
        }),
    }
}

impl VerifyArgs {
    /// The labels, of a volume as large as that of the set was after its filters.
    fn labels(&self, path: &Path) -> Result<(Opened, Stamp)> {
        let dims = Manifest::open(&self.out)?.filtered_dims()?;
        labels::open(path, dims)
    }
}

/// A copy in a temporary file that is read instead, where rows of macrocubes would decode the same again.
fn copied<'a>(volume: &'a dyn Volume, dir: &Path) -> Result<Option<Box<dyn Volume + 'a>>> {
    match volume.decoded_once(dir)? {
        None if !volume.random_access() => volume::spool(volume, dir).map(Some),
        once => Ok(once),
    }
}

/// The issues, a line each.
fn issues(report: &Report) -> String {
    let mut text: String = report.issues.iter().map(issue).collect();
    if report.issues_omitted > 0 {
        let _ = writeln!(
            text,
            "... and {} more",
            output::count(report.issues_omitted)
        );
    }
    text
}

fn issue(issue: &Issue) -> String {
    let severity = match issue.severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    };
    let place = match issue.voxel {
        Some([x, y, z]) => format!(" at voxel {x}, {y}, {z}"),
        None => String::new(),
    };
    format!(
        "{severity} {}: {}{place}: {}\n",
        issue.code.name(),
        issue.path,
        issue.message
    )
}

/// The result in one line.
pub fn verdict(report: &Report) -> String {
    let size = format!(
        "{}, {}, {}",
        output::things(report.tiles, "tile"),
        output::things(report.triangles, "triangle"),
        output::things(report.surfaces, "surface")
    );
    if report.ok {
        let scope = match (report.against, report.part) {
            (true, _) if report.labels => {
                "; the surface is that of the volume, the cells are those of the labels"
            }
            (true, _) => "; the surface is that of the volume",
            (false, true) => "; it is a part, so components may be missing",
            _ => "",
        };
        let without = if report.against {
            ""
        } else {
            " without --against"
        };
        let unproved: String = report
            .unproved
            .iter()
            .map(|what| format!("not proved{without}: {what}\n"))
            .collect();
        format!("ok: {size}, no hole{scope}\n{unproved}")
    } else {
        let issues = report.issues.len() as u64 + report.issues_omitted;
        format!("not ok: {} in {size}\n", output::things(issues, "issue"))
    }
}
