//! `alvis preview`: a slice of a volume as a picture.

use super::args::{Common, InputOptions};
use super::chosen::ChosenArgs;
use super::input::{Input, check_read};
use super::progress::Console;
use super::region::Roi;
use super::threshold::{self, TAKES, Threshold, threshold};
use super::{Outcome, labels, output};
use crate::error::{Error, Result};
use crate::grid::Fill;
use crate::manifest::Manifest;
use crate::preview::{Axis, LabelVolume, PreviewOptions, PreviewReport, preview};
use crate::progress::Progress;
use crate::transform::select::Map;
use crate::volume::{Opened, RegionVoxels, Volume, fill_value};
use clap::{Args, ValueEnum, ValueHint};
use std::path::{Path, PathBuf};

/// An axis, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum AxisArg {
    X,
    Y,
    Z,
}

impl From<AxisArg> for Axis {
    fn from(axis: AxisArg) -> Self {
        match axis {
            AxisArg::X => Axis::X,
            AxisArg::Y => Axis::Y,
            AxisArg::Z => Axis::Z,
        }
    }
}

/// Slices side by side at most: more would be too small to see anything.
const PANELS: usize = 8;

/// Draw a slice of a volume as PNG, with the threshold's contour and the cells in colour
///
/// Grey values run from the 0.5th to the 99.5th percentile of the slice. A slice across z has x to
/// the right and y down; across y, x to the right and z down; across x, y to the right and z down. Voxels
/// have their true proportion. A caption, a scale bar and legends stand around the slice. Cells that
/// the volume's faces cut are hatched where a measure gives the colours: theirs are of a part. With --objects the objects
/// are in colour instead, with --surfaces the outlines of surfaces.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis preview scan.mhd slice.png --threshold otsu\n  \
    alvis preview scan.mhd slice.png --threshold otsu,peaks,140\n  \
    alvis preview scan.mhd slice.png --tiles OUT --colour-by equivalent_diameter\n  \
    alvis preview scan.mhd slice.png --tiles OUT --where 'volume > 3' --axis x --at 40\n  \
    alvis preview scan.mhd slice.png --tiles OUT --objects --largest 1")]
pub struct PreviewArgs {
    /// The volume: a file, a folder of slices, a Zarr, or slices as in `s%04d.tif`
    #[arg(value_hint = ValueHint::FilePath)]
    input: PathBuf,
    /// The picture to write
    #[arg(value_name = "PNG", value_hint = ValueHint::FilePath)]
    png: PathBuf,
    /// The axis that the slice lies across
    #[arg(long, value_name = "AXIS", default_value = "z")]
    axis: AxisArg,
    /// Its voxel along that axis; with --tiles of a crop, counted from the crop [default: the middle]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    at: Option<u32>,
    /// Draw the contour of this threshold, of several separated by commas side by side [default: that of the tiles,
    /// if given]
    #[arg(long, value_name = TAKES, allow_hyphen_values = true, value_delimiter = ',', value_parser = threshold)]
    threshold: Vec<Threshold>,
    /// Colour the cells of this tile set of the volume
    #[arg(long, value_name = "OUT", value_hint = ValueHint::DirPath)]
    tiles: Option<PathBuf>,
    /// The labels that the cells of the tile set were made by: they tell the cell of each voxel, tiles that of walls alone
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, requires = "tiles")]
    labels: Option<PathBuf>,
    /// Colour them by a column or an expression [default: as the tiles are painted, or by id]
    #[arg(
        long,
        alias = "color-by",
        value_name = "COLUMN",
        requires = "tiles",
        allow_hyphen_values = true
    )]
    colour_by: Option<String>,
    /// Colour map: viridis, magma, plasma, inferno, cividis or turbo
    #[arg(long, value_name = "NAME", default_value = "viridis", value_parser = super::select::map, requires = "colour_by")]
    map: Map,
    /// Values of the map's first and last colour [default: those of the cells]
    #[arg(long, value_name = "A:B", allow_hyphen_values = true, value_parser = super::select::range, requires = "colour_by")]
    range: Option<[f64; 2]>,
    #[command(flatten)]
    chosen: ChosenArgs,
    /// Samples that are black and white
    #[arg(long, value_name = "A:B", allow_hyphen_values = true, value_parser = super::select::range)]
    window: Option<[f64; 2]>,
    /// Pixels per voxel along the axis of smaller spacing [default: as many as fit 1024]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=64))]
    scale: Option<u32>,
    /// The slice alone, without caption, scale bar and legends
    #[arg(long)]
    plain: bool,
    /// Replace the picture if it exists
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    options: InputOptions,
    #[command(flatten)]
    common: Common,
}

/// The samples outside of a region at some thresholds; beyond all samples where a conversion would have none.
fn fills(
    volume: &dyn Volume,
    inside: &RegionVoxels,
    thresholds: &[f64],
    fill: Fill,
    progress: &dyn Progress,
) -> Result<Vec<f64>> {
    let one = |&t: &f64| match fill_value(volume, inside, t, fill, progress) {
        Err(Error::Usage { .. }) => Ok(match fill {
            Fill::Material => f64::INFINITY,
            Fill::Air => f64::NEG_INFINITY,
        }),
        found => found,
    };
    thresholds.iter().map(one).collect()
}

impl PreviewArgs {
    /// Refuses what needs no reading.
    fn check(&self) -> Result<()> {
        if let (Some(option), None) = (self.chosen.given(), &self.tiles) {
            let expected = "it together with --tiles OUT, whose tables are chosen from";
            return Err(Error::usage(option, "it alone", expected));
        }
        let ending = self.png.extension();
        if ending.is_none_or(|e| !e.eq_ignore_ascii_case("png")) {
            let found = self.png.display().to_string();
            return Err(Error::usage("PNG", found, "a name that ends in .png"));
        }
        if self.threshold.len() > PANELS {
            let found = format!("{} of them", self.threshold.len());
            let expected = format!("at most {PANELS}, side by side");
            return Err(Error::usage("--threshold", found, expected));
        }
        if !self.force && self.png.symlink_metadata().is_ok_and(|m| !m.is_dir()) {
            return Err(Error::FileExists {
                path: self.png.clone(),
            });
        }
        Ok(())
    }

    /// The region of interest, and what is outside of it where no tiles say that.
    fn region(
        &self,
        manifest: Option<&Manifest>,
        opened: &Opened,
        console: &Console,
    ) -> Result<(Option<RegionVoxels>, Option<Fill>)> {
        let (asked, volume) = (&self.options.region, &*opened.volume);
        if let Some(manifest) = manifest {
            let region = asked.find_as(manifest, volume, "--tiles", console)?;
            return Ok((region, None));
        }
        let roi = asked.find((volume, opened.provenance.frame), None, u64::MAX, console)?;
        let warnings = roi.as_ref().map_or(&[][..], Roi::warnings);
        warnings.iter().for_each(|w| console.warn(w));
        Ok(roi.map(|roi| (roi.voxels, roi.fill)).unzip())
    }

    /// What finds each threshold; empty for those that are given.
    fn names(&self) -> Vec<String> {
        let name = |threshold: &Threshold| match threshold {
            Threshold::Value(_) => String::new(),
            Threshold::Method(method) => method.to_string(),
        };
        self.threshold.iter().map(name).collect()
    }

    pub fn run(self) -> Result<Outcome> {
        let console = self.common.start();
        self.check()?;
        let manifest = self.tiles.as_deref().map(Manifest::open).transpose()?;
        let (opened, input) =
            Input::Path(&self.input).open(&self.options.options(), Path::new(""))?;
        let opened = match &manifest {
            Some(manifest) => self.options.filters.apply_as(manifest, opened, "--tiles")?,
            None => self.options.filters.apply(opened)?,
        };
        let volume = &*opened.volume;
        let (region, fill) = self.region(manifest.as_ref(), &opened, &console)?;
        let inside = region.as_ref();
        let thresholds = threshold::all(&self.threshold, volume, inside, &self.input, &console)?;
        let fills = match (inside, fill) {
            (Some(inside), Some(fill)) => fills(volume, inside, &thresholds, fill, &console)?,
            _ => Vec::new(),
        };
        let labels = match &self.labels {
            Some(path) => Some(labels::open(path, volume.header().dims)?),
            None => None,
        };
        let (labels, labels_stamp) = labels.unzip();
        let options = PreviewOptions {
            labels: labels.map(|labels| LabelVolume(labels.volume.into())),
            names: self.names(),
            fills,
            axis: self.axis.into(),
            at: self.at,
            thresholds,
            tiles: self.tiles,
            colour_by: self.colour_by,
            map: self.map,
            range: self.range,
            chosen: self.chosen.chosen(),
            window: self.window,
            scale: self.scale,
            plain: self.plain,
            phases_only: false,
            region,
            input,
        };
        let report = preview(&*opened.volume, &self.png, &options)?;
        if let Some(stamp) = &labels_stamp {
            check_read(stamp, &console)?;
        }
        report.warnings.iter().for_each(|w| console.warn(w));
        drop(console);
        if self.common.json {
            output::print_json(&report)?;
        } else if self.common.talks() {
            output::print(&told(&self.png, &report))?;
        }
        Ok(Outcome::Done)
    }
}

/// A picture for people.
fn told(png: &Path, report: &PreviewReport) -> String {
    let counts = [
        (report.cells, "cell"),
        (report.objects, "object"),
        (report.surfaces, "surface"),
    ];
    let count = counts.into_iter().find_map(|(n, name)| Some((n?, name)));
    let count = count.map_or(String::new(), |(n, name)| {
        format!(", {}", output::things(n, name))
    });
    format!(
        "{}: slice {} across {}, {} x {} pixels{count}\n",
        png.display(),
        report.at,
        ["x", "y", "z"][report.axis as usize],
        report.size[0],
        report.size[1],
    )
}
