//! `alvis report`: a page for the lab book.

use super::against::{Asked, open_whole};
use super::args::{Common, InputOptions};
use super::cells::OutsideArg;
use super::input::Input;
use super::{Outcome, output};
use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::manifest::Manifest;
use crate::progress::Progress;
use crate::report::{ReportOptions, SourceVolume, check_file, report, write_page};
use clap::{Args, ValueHint};
use std::path::{Path, PathBuf};

/// Write a report of a tile set for the lab book: one page of HTML, without anything from elsewhere
///
/// It has a picture, settings and versions, porosity, distributions of cell sizes by number and by volume, form,
/// porosity by slices and of boxes, anisotropy, outliers, necks and walls where the set has them, and what to cite for each
/// number. --json prints the same numbers. The tiles are read once; the scan is not needed, but --against draws its grey
/// values. The same tile set gives the same bytes.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis report OUT report.html\n  \
    alvis report OUT report.html --against scan.mhd\n  \
    alvis report OUT report.html --outside border-cell --force\n  \
    alvis report OUT --json")]
pub struct ReportArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// The page to write; its name ends in .html. May be left out with --json
    #[arg(value_hint = ValueHint::FilePath, required_unless_present = "json")]
    file: Option<PathBuf>,
    /// Draw the grey values of this volume, of which the tiles were made
    #[arg(long, value_name = "INPUT", value_hint = ValueHint::FilePath, requires = "file")]
    against: Option<PathBuf>,
    /// Which cells are air around the sample, not pores: left out of all numbers
    #[arg(long, value_name = "RULE")]
    outside: Option<OutsideArg>,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    input: InputOptions,
    #[command(flatten)]
    common: Common,
}

impl ReportArgs {
    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        self.check()?;
        let manifest = Manifest::open(&self.out)?;
        let opened = match &self.against {
            Some(path) => {
                let asked = Asked::of(&self.input, &console);
                let opened = open_whole(&self.out, Input::Path(path), &manifest, &asked)?;
                check_size(path, opened.0.volume.header().dims, &manifest)?;
                Some(opened)
            }
            None => {
                self.input.refuse_without_volume("--against INPUT")?;
                None
            }
        };
        let source = match &opened {
            Some((opened, stamp)) => {
                let volume = &*opened.volume;
                let region = &self.input.region;
                let region = region.find_as(&manifest, volume, "--against", &console)?;
                Some(SourceVolume {
                    volume,
                    region,
                    stamp: stamp.clone(),
                })
            }
            None => None,
        };
        let options = ReportOptions {
            outside: self.outside.map_or_else(Default::default, Into::into),
            source,
            picture: self.file.is_some(),
        };
        let made = report(&self.out, &options, &console)?;
        made.warnings.iter().for_each(|w| console.warn(w));
        if let Some(file) = &self.file {
            write_page(&made, file, self.force)?;
        }
        drop(console);
        if self.common.json {
            output::print_json(&made)?;
        } else if let (true, Some(file)) = (self.common.talks(), &self.file) {
            output::print(&format!("{}: a page for any browser\n", file.display()))?;
        }
        Ok(Outcome::Done)
    }

    /// Refuses what needs no reading.
    fn check(&self) -> Result<()> {
        let Some(file) = &self.file else {
            return Ok(());
        };
        let ending = file.extension();
        if ending.is_none_or(|e| !e.eq_ignore_ascii_case("html") && !e.eq_ignore_ascii_case("htm"))
        {
            let found = file.display().to_string();
            return Err(Error::usage("FILE", found, "a name that ends in .html"));
        }
        check_file(file, self.force)
    }
}

/// Refuses a volume that has another size than that of the tile set, both after filters.
fn check_size(path: &Path, found: Dims, manifest: &Manifest) -> Result<()> {
    let expected = manifest.filtered_dims()?;
    if found == expected {
        return Ok(());
    }
    let after = match manifest.filters.is_empty() {
        true => "",
        false => " after filters",
    };
    let found = format!("{} of {found} voxels{after}", path.display());
    let expected = format!("the volume of {expected} that the tiles were made from");
    Err(Error::usage("--against", found, expected))
}
