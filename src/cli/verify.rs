//! `alvis verify`: the proof that a tile set has no hole.

use super::args::{Common, InputOptions, open_stamped};
use super::{Outcome, output};
use crate::error::{Error, Result};
use crate::grid::Origin;
use crate::manifest::{Manifest, PARTIAL};
use crate::progress::Progress;
use crate::verify::{self, Issue, Report, Severity, SourceVolume, VerifyOptions};
use crate::volume::{self, Cropped, Filled, Headerless, RegionVoxels, Stamp, Volume};
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
    against: Option<PathBuf>,
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
    common: Common,
}

impl VerifyArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        let against = match &self.against {
            Some(path) => Some(open_against(&self.out, path, &self.input, &console)?),
            None => {
                self.input.refuse_without_volume("--against INPUT")?;
                None
            }
        };
        let once = match &against {
            Some(against) => copied(against.volume.as_ref(), &std::env::temp_dir())?,
            None => None,
        };
        let options = VerifyOptions {
            against: once
                .as_deref()
                .or(against.as_ref().map(|a| a.volume.as_ref())),
            source: against.as_ref().map(|a| &a.source),
            region: against.as_ref().and_then(|a| a.region.as_ref()),
            threads: self.common.threads.map_or(0, usize::from),
            max_issues: self.max_issues,
        };
        let report = verify::verify(&self.out, &options, &console)?;
        if let Some(against) = &against
            && let Some(warning) = against.stamp.check()?
        {
            console.warn(&warning);
        }
        if self.out.join(PARTIAL).is_dir() {
            console.warn(&format!(
                "{}: beside this set lies a conversion that is not finished ({PARTIAL}): the same `alvis convert` \
                 with --resume goes on with it",
                self.out.display()
            ));
        }
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&text(&report))?;
        }
        Ok(if report.ok {
            Outcome::Done
        } else {
            Outcome::Issues
        })
    }
}

/// A copy in a temporary file that is read instead, where rows of macrocubes would decode the same again.
fn copied<'a>(volume: &'a dyn Volume, dir: &Path) -> Result<Option<Box<dyn Volume + 'a>>> {
    match volume.decoded_once(dir)? {
        None if !volume.random_access() => volume::spool(volume, dir).map(Some),
        once => Ok(once),
    }
}

/// The volume that a tile set is compared with, what it says of itself as a whole, and what shows a change to it.
struct Against {
    volume: Box<dyn Volume>,
    /// The voxels of its region of interest, cut as it is.
    region: Option<RegionVoxels>,
    source: SourceVolume,
    stamp: Stamp,
}

/// Opens the volume that a tile set is compared with, filtered and cut as the manifest says. What a raw file does not say is taken
/// from the manifest unless the options say it, as is what was asked for of a file of the name that was converted.
/// Such a file is raw even if it begins as one with a header does.
fn open_against(
    directory: &Path,
    path: &Path,
    input: &InputOptions,
    progress: &dyn Progress,
) -> Result<Against> {
    // an index that cannot be read is for the verifier to report
    let manifest = Manifest::open(directory).ok();
    let Some(manifest) = manifest else {
        let (opened, stamp) = open_stamped(path, &input.options(), directory)?;
        let opened = input.filters.apply(opened)?;
        let source = SourceVolume::of(&opened);
        let volume = opened.volume;
        return Ok(Against {
            volume,
            region: None,
            source,
            stamp,
        });
    };
    let source = &manifest.source;
    let mut options = input.options();
    let same_name = volume::file_name(path) == source.name;
    if same_name {
        options = options.or_part(&source.part);
        // what the file does not state had to be said to open it
        if source.provenance.spacing.contains(&Origin::Option) && options.spacing.is_none() {
            options.spacing = Some(unfiltered_spacing(&manifest));
            options.unit = options.unit.or(Some(manifest.placement.unit));
        }
    }
    if source.format == "raw" {
        options.headerless = Some(Headerless {
            dims: source.dims.0.map(u64::from),
            dtype: source.dtype,
            endian: source.endian,
            offset: source.offset,
        });
        if same_name {
            options = options.of_headerless();
        }
    }
    let (opened, stamp) = open_stamped(path, &options, directory)?;
    let opened = input.filters.apply_as(&manifest, opened, "--against")?;
    let whole = SourceVolume::of(&opened);
    let asked = &input.region;
    let region = asked.find_as(&manifest, &*opened.volume, "--against", progress)?;
    let volume = match (&region, &manifest.region) {
        (Some(voxels), Some(stated)) => {
            let filled = Filled::new(opened.volume, voxels.clone(), stated.fill_value)?;
            Box::new(filled) as Box<dyn Volume>
        }
        _ => opened.volume,
    };
    let dims = volume.header().dims;
    let volume = match &source.crop {
        None => Ok(volume),
        Some(crop) if crop.dims_in(dims).is_err() => Err(Error::usage(
            "--against",
            format!("{} of {dims} voxels", path.display()),
            format!(
                "a volume of {}, of which the tiles cover a part",
                manifest.filtered_dims()?
            ),
        )),
        Some(crop) => Ok(Box::new(Cropped::new(volume, crop)?) as Box<dyn Volume>),
    };
    let volume = volume?;
    let region = match (region, &source.crop) {
        (Some(region), Some(crop)) => Some(region.cropped(crop)?),
        (region, _) => region,
    };
    Ok(Against {
        volume,
        region,
        source: whole,
        stamp,
    })
}

/// The size of a voxel before the filters of a tile set.
fn unfiltered_spacing(manifest: &Manifest) -> [f64; 3] {
    let factors = manifest.filters.iter().map(|filter| filter.factor());
    let factor: f64 = factors.map(f64::from).product();
    manifest.placement.spacing.map(|size| size / factor)
}

fn text(report: &Report) -> String {
    let mut text: String = report.issues.iter().map(issue).collect();
    if report.issues_omitted > 0 {
        let _ = writeln!(
            text,
            "... and {} more",
            output::count(report.issues_omitted)
        );
    }
    text + &verdict(report)
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
            (true, _) => "; the surface is that of the volume",
            (false, true) => "; it is a part, so components may be missing",
            _ => "",
        };
        format!("ok: {size}, no hole{scope}\n")
    } else {
        let issues = report.issues.len() as u64 + report.issues_omitted;
        format!("not ok: {} in {size}\n", output::things(issues, "issue"))
    }
}
