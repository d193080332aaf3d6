//! `alvis info`: what a volume is, and what its surface would cost.

use super::args::{Common, InputOptions, input_help};
use super::convert::from;
use super::info_report::{Counted, Report, report};
use super::input::Input;
use super::parse::{self, CropArg};
use super::progress::Console;
use super::region::Roi;
use super::threshold::{self, TAKES, Threshold, threshold};
use super::{Outcome, chart, info_tiles, output};
use crate::convert::{ConvertOptions, predicted_memory};
use crate::error::{Error, Result};
use crate::grid::{Crop, Fill, Placement, filters_text};
use crate::progress::Progress;
use crate::volume::{
    Cropped, Filled, Header, Opened, Prediction, Statistics, ThresholdMethod, Watch, Watched,
    measured_voxels, predict, statistics,
};
use crate::words::{number, percent};
use clap::{Args, ValueHint};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Slices that a prediction reads at most.
const SLICES: u32 = 256;
/// A limit of memory that no machine reaches.
const UNLIMITED: u64 = 1 << 60;

/// Show what a volume holds, its histogram, Otsu's threshold and the surface to expect there
///
/// Of a tile set it shows what it was made from, how, and what can be done with it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis info scan.mhd\n  \
    alvis info scan.raw --dims 512,512,300 --dtype u16\n  \
    alvis info slices --threshold 120\n  \
    alvis info OUT")]
pub struct InfoArgs {
    /// The volume: a file, a folder of slices, a Zarr, or slices as in `s%04d.tif`; or a tile set
    #[arg(value_hint = ValueHint::FilePath, long_help = input_help())]
    pub input: PathBuf,
    /// Predict for this threshold instead of Otsu's: a value, or otsu, peaks, li, triangle, porosity=P%
    #[arg(long, value_name = TAKES, allow_hyphen_values = true, value_parser = threshold)]
    threshold: Option<Threshold>,
    /// Predict for this box of voxels only, as `alvis convert --crop` makes it; --roi cylinder is looked for in its slices.
    /// Histogram and thresholds are of the whole volume, as they are there
    #[arg(long, value_name = "X0:X1,Y0:Y1,Z0:Z1", value_parser = parse::crop)]
    crop: Option<CropArg>,
    #[command(flatten)]
    options: InputOptions,
    #[command(flatten)]
    pub common: Common,
}

/// A threshold that a method finds.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Candidate {
    threshold: f64,
    /// 0 to 1; of floats, and of whole numbers that differ by 65,536 or more, an estimate from bins.
    share_above: f64,
}

/// What methods find, in the order of the help; `None` of those that find nothing. `asked` is one more.
pub(super) fn candidates(
    found: &Statistics,
    asked: Option<Threshold>,
) -> Vec<(ThresholdMethod, Option<Candidate>)> {
    let more = match asked {
        Some(Threshold::Method(method @ ThresholdMethod::Porosity(_))) => Some(method),
        _ => None,
    };
    let candidate = |threshold| Candidate {
        threshold,
        share_above: found.share_above(threshold),
    };
    let methods = ThresholdMethod::PLAIN.into_iter().chain(more);
    methods
        .map(|m| (m, found.threshold(m).map(candidate)))
        .collect()
}

/// What of the volume counts.
pub(super) struct Part<R> {
    pub crop: Option<Crop>,
    pub region: Option<R>,
}

/// The surface to expect; absent if there is no threshold to predict for.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Predicted {
    threshold: f64,
    vertices: u64,
    triangles: u64,
    voxels_above: u64,
    /// Those that count.
    #[serde(skip)]
    voxels: u64,
    bytes: u64,
    memory_bytes: u64,
    sampled: bool,
}

/// What is known of a volume once it has been read.
pub struct Found {
    opened: Opened,
    statistics: Statistics,
    asked: Option<Threshold>,
    predicted: Option<Predicted>,
    crop: Option<Crop>,
    roi: Option<Roi>,
}

impl Found {
    /// What `--json` prints.
    pub fn report(self) -> Report {
        let part = Part {
            crop: self.crop,
            region: self.roi.as_ref().map(Counted::of),
        };
        let (found, predicted) = (self.statistics, self.predicted);
        report(&self.opened, found, self.asked, predicted, part)
    }

    fn text(self) -> String {
        let part = Part {
            crop: self.crop,
            region: self.roi.as_ref().map(Roi::text),
        };
        let (found, predicted) = (&self.statistics, self.predicted);
        text(&self.opened, found, self.asked, predicted, part)
    }
}

impl InfoArgs {
    pub fn run(self) -> Result<Outcome> {
        if self.is_of_tiles()? {
            info_tiles::print(&self.input, self.common.json)?;
            return Ok(Outcome::Done);
        }
        let console = self.common.start();
        let found = self.found(Input::Path(&self.input), &console)?;
        drop(console);
        match self.common.json {
            true => output::print_json(&found.report())?,
            false => output::print(&found.text())?,
        }
        Ok(Outcome::Done)
    }

    /// True if the input is a tile set; options of a volume are refused then.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn is_of_tiles(&self) -> Result<bool> {
        if !info_tiles::is_tile_set(&self.input) {
            return Ok(false);
        }
        self.options.refuse_without_volume("a volume")?;
        let given = [
            ("--threshold", self.threshold.is_some()),
            ("--crop", self.crop.is_some()),
        ];
        match given.into_iter().find(|(_, given)| *given) {
            Some((option, _)) => {
                let expected = "it together with a volume";
                Err(Error::usage(option, "it without a volume", expected))
            }
            None => Ok(true),
        }
    }

    /// Reads the volume.
    ///
    /// # Errors
    /// Those of opening and reading it; [`Error::Usage`] for options that do not fit it.
    pub fn found(&self, input: Input, console: &Console) -> Result<Found> {
        let path = input.path().to_path_buf();
        let (mut opened, stamp) = input.open(&self.options.options(), Path::new(""))?;
        opened.doubt_size()?;
        let mut opened = self.options.filters.apply(opened)?;
        let watch = Watch::new(opened.volume.header(), opened.scaled);
        let dims = opened.volume.header().dims;
        let crop = self.crop.as_ref().map(|c| c.resolve(dims)).transpose()?;
        let region = &self.options.region;
        let roi = region.find(
            (&*opened.volume, opened.provenance.frame),
            crop.as_ref(),
            UNLIMITED,
            console,
        )?;
        let doubts = roi.as_ref().map_or(&[][..], Roi::warnings);
        opened.warnings.extend_from_slice(doubts);
        let inside = roi.as_ref().map(|roi| &roi.voxels);
        let statistics = {
            let watched = Watched::new(Box::new(&*opened.volume), &watch);
            statistics(&watched, inside, console)?
        };
        opened.warnings.extend(watch.kind().map(|k| k.warning()));
        opened.warnings.extend(statistics.coarse());
        opened.warnings.extend(statistics.clipped());
        let threshold = match self.threshold {
            Some(Threshold::Value(t)) => Some(t),
            Some(Threshold::Method(method)) => {
                let value = threshold::of(&statistics, method, &path)?;
                let missed = threshold::missed(&statistics, method, value);
                opened.warnings.extend(missed);
                Some(value)
            }
            None => statistics.otsu,
        };
        let predicted = match threshold {
            Some(t) => Some(self.predict(&opened, roi.as_ref(), crop.as_ref(), t, console)?),
            None => None,
        };
        if predicted.is_some_and(|p| p.voxels == 0) {
            let text = "nothing in the crop was measured: it lies where the grid is filled up";
            opened.warnings.push(text.to_owned());
        }
        if let Some(warning) = stamp.check()? {
            console.warn(&warning);
        }
        Ok(Found {
            opened,
            statistics,
            asked: self.threshold,
            predicted,
            crop,
            roi,
        })
    }
}

impl InfoArgs {
    /// The surface to expect at a threshold, of a part of the volume and of a region only there.
    fn predict(
        &self,
        opened: &Opened,
        roi: Option<&Roi>,
        crop: Option<&Crop>,
        threshold: f64,
        progress: &dyn Progress,
    ) -> Result<Predicted> {
        let mut options = ConvertOptions {
            memory: UNLIMITED,
            threads: self.common.threads.map_or(0, usize::from),
            crop: crop.cloned(),
            source_filtered: opened.filtered.clone(),
            ..ConvertOptions::default()
        };
        let volume = &*opened.volume;
        let Some(roi) = roi else {
            let part = Cropped::part(Box::new(volume), crop)?;
            let surface = predict(&*part, threshold, SLICES, progress)?;
            let memory = predicted_memory(volume, &options)?;
            let voxels = measured_voxels(&*part);
            return Ok(Predicted::new(threshold, surface, voxels, memory));
        };
        let region = roi
            .clone()
            .at_threshold(volume, threshold, crop, progress)?;
        let stated = region.stated.clone();
        let filled = Filled::new(Box::new(volume), roi.voxels.clone(), stated.fill_value)?;
        let part = Cropped::part(Box::new(filled), crop)?;
        let mut surface = predict(&*part, threshold, SLICES, progress)?;
        if stated.fill == Fill::Material {
            let outside = stated.outside(part.header().dims);
            surface.voxels_above = surface.voxels_above.saturating_sub(outside);
        }
        options.region = Some(region);
        let memory = predicted_memory(volume, &options)?;
        Ok(Predicted::new(threshold, surface, stated.voxels, memory))
    }
}

/// A rough size of the tiles: 24 bytes for each vertex, of which one in twenty is written twice,
/// and 1.4 indices of two bytes for each triangle in strips.
pub(super) fn tile_bytes(prediction: &Prediction) -> u64 {
    (prediction.vertices as f64 * 25.2 + prediction.triangles as f64 * 2.8) as u64
}

impl Predicted {
    fn new(threshold: f64, surface: Prediction, voxels: u64, memory_bytes: u64) -> Self {
        Predicted {
            threshold,
            vertices: surface.vertices,
            triangles: surface.triangles,
            voxels_above: surface.voxels_above,
            voxels,
            bytes: tile_bytes(&surface),
            memory_bytes,
            sampled: surface.sampled,
        }
    }
}

/// `u16, big endian`.
pub fn sample_text(header: &Header) -> String {
    if header.dtype.bytes() == 1 {
        header.dtype.to_string()
    } else {
        format!("{}, {} endian", header.dtype, header.endian)
    }
}

/// Spacing and unit, and where they came from.
pub fn spacing_text(placement: &Placement, opened: &Opened) -> String {
    let Placement { spacing, unit, .. } = placement;
    let (axes, u) = (opened.provenance.spacing, opened.provenance.unit);
    let s = axes[0];
    let source = if axes != [s; 3] {
        let each = ["x", "y", "z"].into_iter().zip(axes);
        let each: Vec<_> = each.map(|(a, s)| format!("{a} {}", from(s))).collect();
        format!("{}; unit {}", each.join(", "), from(u))
    } else if s == u {
        from(s).to_string()
    } else {
        format!("{}; unit {}", from(s), from(u))
    };
    format!("{} {unit} ({source})", output::times(*spacing))
}

/// The filters that a volume has been through, and what it was before if that differs.
fn filters_row(opened: &Opened) -> Option<(&'static str, String)> {
    let before = opened.filtered.as_ref()?;
    let header = opened.volume.header();
    let mut text = filters_text(&before.filters);
    if before.dims != header.dims || before.dtype != header.dtype {
        text += &format!("; before: {} voxels, {}", before.dims, before.dtype);
    }
    Some(("filters", text))
}

/// What else is to be known of a volume, as rows: how values are made, filters, notes and warnings.
pub fn remarks(opened: &Opened) -> Vec<(&'static str, String)> {
    let row = |name: &'static str| move |text: &String| (name, text.clone());
    let values = opened.values.iter().map(row("values"));
    let notes = opened.notes.iter().map(row("note"));
    let warnings = opened.warnings.iter().map(row("warning"));
    let filters = filters_row(opened).into_iter();
    values.chain(filters).chain(notes).chain(warnings).collect()
}

fn text(
    opened: &Opened,
    found: &Statistics,
    asked: Option<Threshold>,
    predicted: Option<Predicted>,
    part: Part<String>,
) -> String {
    let header = opened.volume.header();
    let place = &header.placement;
    let mut rows = vec![
        ("file", format!("{}, {}", opened.name, header.format)),
        (
            "dims",
            format!(
                "{} = {} voxels, {}",
                header.dims,
                output::count(header.dims.voxels()),
                output::bytes(header.dims.voxels() * header.dtype.bytes() as u64)
            ),
        ),
        ("type", sample_text(header)),
        ("spacing", spacing_text(place, opened)),
    ];
    if place.origin != Placement::default().origin {
        rows.push(("origin", place.origin.map(|v| v.to_string()).join(", ")));
    }
    if place.directions != Placement::default().directions {
        let axis = |a: [f64; 3]| format!("({})", a.map(|v| v.to_string()).join(", "));
        rows.push(("axes", place.directions.map(axis).join(" ")));
    }
    rows.extend(remarks(opened));
    rows.extend(part.crop.map(|crop| ("crop", crop.to_string())));
    rows.extend(part.region.map(|text| ("region", text)));
    if let Some([min, max]) = found.range {
        rows.push(("range", format!("{} to {}", number(min, 6), number(max, 6))));
    }
    let strange = found.nan + found.negative_infinite + found.positive_infinite;
    if strange > 0 {
        let infinite = found.negative_infinite + found.positive_infinite;
        let (nan, infinite) = (output::count(found.nan), output::count(infinite));
        rows.push(("not finite", format!("{nan} NaN, {infinite} infinite")));
    }
    let candidates = candidates(found, asked);
    rows.push(("threshold", threshold_text(predicted, asked)));
    if let Some([low, high]) = found.peaks() {
        let peaks = format!("{} and {}", number(low, 6), number(high, 6));
        rows.push(("peaks", peaks));
    }
    let width = output::width();
    let histogram = match (found.range, found.columns(chart::columns(width))) {
        (Some(_), Some((bars, edges))) => {
            let marks = marks(predicted, asked, &candidates, edges, found.is_exact());
            let bars = chart::draw(&bars, edges, &marks, width);
            format!("histogram, voxels on a log scale\n{bars}")
        }
        _ => String::new(),
    };
    let surface = predicted.map_or_else(String::new, expected);
    output::table(&rows) + &histogram + &surface
}

/// The threshold that the surface is predicted for, and how it was found.
fn threshold_text(predicted: Option<Predicted>, asked: Option<Threshold>) -> String {
    match predicted {
        Some(p) => format!("{}{}", number(p.threshold, 6), how(asked)),
        None => format!("none: {}", ThresholdMethod::Otsu.why_none()),
    }
}

/// The method that finds the threshold that is predicted for; `None` if that was given.
fn method(asked: Option<Threshold>) -> Option<ThresholdMethod> {
    match asked {
        None => Some(ThresholdMethod::Otsu),
        Some(Threshold::Method(method)) => Some(method),
        Some(Threshold::Value(_)) => None,
    }
}

/// How a threshold was found, behind its value; nothing if it was given.
fn how(asked: Option<Threshold>) -> String {
    method(asked).map_or_else(String::new, |method| format!(" {}", method.how()))
}

/// The threshold on the histogram's axis, and those that other methods find, each with the share of voxels above.
fn marks(
    predicted: Option<Predicted>,
    asked: Option<Threshold>,
    candidates: &[(ThresholdMethod, Option<Candidate>)],
    edges: [f64; 2],
    exact: bool,
) -> Vec<chart::Mark> {
    let main = predicted.map(|p| chart::Mark {
        sign: '▲',
        share: chart::place(edges, p.threshold),
        text: format!(
            "threshold {}{}, {} above",
            number(p.threshold, 6),
            how(asked),
            share_above(p)
        ),
    });
    let others = candidates
        .iter()
        .filter(|(other, _)| method(asked) != Some(*other));
    // shares of what is counted in bins are estimates
    let about = if exact { "" } else { "about " };
    let others = others.filter_map(|(method, found)| {
        let found = (*found)?;
        let name = method.to_string();
        Some(chart::Mark {
            sign: name.chars().next()?,
            share: chart::place(edges, found.threshold),
            text: format!(
                "{name}: {}, {about}{} above",
                number(found.threshold, 6),
                percent(found.share_above)
            ),
        })
    });
    main.into_iter().chain(others).collect()
}

/// The share of the voxels that count, for people.
fn share_above(p: Predicted) -> String {
    percent(p.voxels_above as f64 / p.voxels.max(1) as f64)
}

fn expected(p: Predicted) -> String {
    let share = share_above(p);
    let basis = if p.sampled {
        " (from a sample of the slices)"
    } else {
        ""
    };
    format!("at threshold {}{basis}\n", number(p.threshold, 6))
        + &output::table(&[
            ("  above", format!("{share} of the voxels")),
            (
                "  triangles",
                format!("about {}", output::count(p.triangles)),
            ),
            ("  tiles", format!("about {}", output::bytes(p.bytes))),
            (
                "  memory",
                format!("about {}", output::bytes(p.memory_bytes)),
            ),
        ])
}
