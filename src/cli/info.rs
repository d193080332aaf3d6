//! `alvis info`: what a volume is, and what its surface would cost.

use super::args::{Common, InputOptions, input_help, open_stamped};
use super::convert::from;
use super::region::Roi;
use super::threshold::{self, TAKES, Threshold, threshold};
use super::{Outcome, chart, info_tiles, output};
use crate::convert::{ConvertOptions, predicted_memory};
use crate::error::{Error, Result};
use crate::grid::{Dims, Fill, Filter, Placement, Shape, Unit, filters_text};
use crate::progress::Progress;
use crate::volume::{
    Dtype, Endian, Filled, Header, Opened, Prediction, Statistics, ThresholdMethod, Volume, Watch,
    Watched, predict, statistics,
};
use crate::words::number;
use clap::{Args, ValueHint};
use serde::Serialize;
use std::collections::BTreeMap;
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
    input: PathBuf,
    /// Predict for this threshold instead of Otsu's: a value, or otsu, peaks, li, triangle, porosity=P%
    #[arg(long, value_name = TAKES, allow_hyphen_values = true, value_parser = threshold)]
    threshold: Option<Threshold>,
    #[command(flatten)]
    options: InputOptions,
    #[command(flatten)]
    common: Common,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    format: &'static str,
    name: String,
    dims: Dims,
    dtype: Dtype,
    endian: Endian,
    spacing: [f64; 3],
    unit: Unit,
    origin: [f64; 3],
    directions: [[f64; 3]; 3],
    provenance: crate::grid::Provenance,
    values: Option<String>,
    filters: Vec<Filter>,
    #[serde(skip_serializing_if = "Option::is_none")]
    region: Option<Counted>,
    notes: Vec<String>,
    warnings: Vec<String>,
    min: Option<f64>,
    max: Option<f64>,
    nan: u64,
    infinite: u64,
    otsu_threshold: Option<f64>,
    thresholds: BTreeMap<String, Option<Candidate>>,
    peaks: Option<[f64; 2]>,
    histogram: Vec<u64>,
    predicted: Option<Predicted>,
}

/// A region of interest, and how much of the volume is inside.
#[derive(Debug, Serialize)]
struct Counted {
    #[serde(flatten)]
    shape: Shape,
    fill: Fill,
    voxels: u64,
    /// 0 to 1.
    share: f64,
}

impl Counted {
    fn of(roi: &Roi) -> Self {
        Counted {
            shape: roi.shape.clone(),
            fill: roi.fill,
            voxels: roi.count,
            share: roi.share(),
        }
    }
}

/// A threshold that a method finds.
#[derive(Debug, Clone, Copy, Serialize)]
struct Candidate {
    threshold: f64,
    /// 0 to 1.
    share_above: f64,
}

/// What methods find, in the order of the help; `None` of those that find nothing. `asked` is one more.
fn candidates(
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

/// The surface to expect; absent if there is no threshold to predict for.
#[derive(Debug, Clone, Copy, Serialize)]
struct Predicted {
    threshold: f64,
    vertices: u64,
    triangles: u64,
    voxels_above: u64,
    bytes: u64,
    memory_bytes: u64,
    sampled: bool,
}

impl InfoArgs {
    pub fn run(self) -> Result<Outcome> {
        if info_tiles::is_tile_set(&self.input) {
            self.options.refuse_without_volume("a volume")?;
            if self.threshold.is_some() {
                let expected = "it together with a volume";
                return Err(Error::usage("--threshold", "it without a volume", expected));
            }
            info_tiles::print(&self.input, self.common.json)?;
            return Ok(Outcome::Done);
        }
        let console = self.common.start();
        let (mut opened, stamp) =
            open_stamped(&self.input, &self.options.options(), Path::new(""))?;
        opened.doubt_size()?;
        let mut opened = self.options.filters.apply(opened)?;
        let watch = Watch::new(opened.volume.header(), opened.scaled);
        let roi = self.options.region.find(&*opened.volume, &console)?;
        let inside = roi.as_ref().map(|roi| &roi.voxels);
        let watched = Watched::new(Box::new(&*opened.volume), &watch);
        let found = statistics(&watched, inside, &console)?;
        opened.warnings.extend(watch.kind().map(|k| k.warning()));
        opened.warnings.extend(found.coarse());
        let volume = &*opened.volume;
        let threshold = match self.threshold {
            Some(Threshold::Value(t)) => Some(t),
            Some(Threshold::Method(method)) => {
                let value = threshold::of(&found, method, &self.input)?;
                opened
                    .warnings
                    .extend(threshold::missed(&found, method, value));
                Some(value)
            }
            None => found.otsu,
        };
        let predicted = match threshold {
            Some(t) => Some(self.predict(volume, roi.as_ref(), t, &console)?),
            None => None,
        };
        if let Some(warning) = stamp.check()? {
            console.warn(&warning);
        }
        drop(console);
        if self.common.json {
            let region = roi.as_ref().map(Counted::of);
            let report = report(&opened, found, self.threshold, predicted, region);
            output::print_json(&report)?;
        } else {
            let region = roi.as_ref().map(Roi::text);
            output::print(&text(&opened, &found, self.threshold, predicted, region))?;
        }
        Ok(Outcome::Done)
    }
}

impl InfoArgs {
    /// The surface to expect at a threshold, of a region of the volume only there.
    fn predict(
        &self,
        volume: &dyn Volume,
        roi: Option<&Roi>,
        threshold: f64,
        progress: &dyn Progress,
    ) -> Result<Predicted> {
        let mut options = ConvertOptions {
            memory: UNLIMITED,
            threads: self.common.threads.map_or(0, usize::from),
            ..ConvertOptions::default()
        };
        let Some(roi) = roi else {
            let surface = predict(volume, threshold, SLICES, progress)?;
            let memory = predicted_memory(volume, &options)?;
            return Ok(Predicted::new(threshold, surface, memory));
        };
        let region = roi
            .clone()
            .at_threshold(volume, threshold, None, progress)?;
        let (stated, voxels) = (region.stated.clone(), region.voxels.clone());
        let filled = Filled::new(Box::new(volume), voxels, stated.fill_value)?;
        let mut surface = predict(&filled, threshold, SLICES, progress)?;
        if stated.fill == Fill::Material {
            let outside = stated.outside(volume.header().dims);
            surface.voxels_above = surface.voxels_above.saturating_sub(outside);
        }
        options.region = Some(region);
        let memory = predicted_memory(volume, &options)?;
        Ok(Predicted::new(threshold, surface, memory))
    }
}

/// A rough size of the tiles: 24 bytes for each vertex, of which one in twenty is written twice,
/// and 1.4 indices of two bytes for each triangle in strips.
fn tile_bytes(prediction: &Prediction) -> u64 {
    (prediction.vertices as f64 * 25.2 + prediction.triangles as f64 * 2.8) as u64
}

impl Predicted {
    fn new(threshold: f64, surface: Prediction, memory_bytes: u64) -> Self {
        Predicted {
            threshold,
            vertices: surface.vertices,
            triangles: surface.triangles,
            voxels_above: surface.voxels_above,
            bytes: tile_bytes(&surface),
            memory_bytes,
            sampled: surface.sampled,
        }
    }
}

fn report(
    opened: &Opened,
    found: Statistics,
    asked: Option<Threshold>,
    predicted: Option<Predicted>,
    region: Option<Counted>,
) -> Report {
    let header = opened.volume.header();
    Report {
        format: header.format,
        name: opened.name.clone(),
        dims: header.dims,
        dtype: header.dtype,
        endian: header.endian,
        spacing: header.placement.spacing,
        unit: header.placement.unit,
        origin: header.placement.origin,
        directions: header.placement.directions,
        provenance: opened.provenance,
        values: opened.values.clone(),
        filters: opened
            .filtered
            .as_ref()
            .map_or_else(Vec::new, |f| f.filters.clone()),
        region,
        notes: opened.notes.clone(),
        warnings: opened.warnings.clone(),
        min: found.range.map(|r| r[0]),
        max: found.range.map(|r| r[1]),
        nan: found.nan,
        infinite: found.negative_infinite + found.positive_infinite,
        otsu_threshold: found.otsu,
        thresholds: candidates(&found, asked)
            .into_iter()
            .map(|(method, found)| (method.to_string(), found))
            .collect(),
        peaks: found.peaks(),
        histogram: found.histogram,
        predicted,
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
    region: Option<String>,
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
    rows.extend(region.map(|text| ("region", text)));
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
            let marks = marks(found, predicted, asked, &candidates, edges);
            let bars = chart::draw(&bars, edges, &marks, width);
            format!("histogram, voxels on a log scale\n{bars}")
        }
        _ => String::new(),
    };
    let surface = predicted.map_or_else(String::new, |p| expected(found, p));
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
    found: &Statistics,
    predicted: Option<Predicted>,
    asked: Option<Threshold>,
    candidates: &[(ThresholdMethod, Option<Candidate>)],
    edges: [f64; 2],
) -> Vec<chart::Mark> {
    let main = predicted.map(|p| chart::Mark {
        sign: '▲',
        share: chart::place(edges, p.threshold),
        text: format!(
            "threshold {}{}, {:.1} % above",
            number(p.threshold, 6),
            how(asked),
            share_above(found, p)
        ),
    });
    let others = candidates
        .iter()
        .filter(|(other, _)| method(asked) != Some(*other));
    let others = others.filter_map(|(method, found)| {
        let found = (*found)?;
        let name = method.to_string();
        Some(chart::Mark {
            sign: name.chars().next()?,
            share: chart::place(edges, found.threshold),
            text: format!(
                "{name}: {}, {:.1} % above",
                number(found.threshold, 6),
                100.0 * found.share_above
            ),
        })
    });
    main.into_iter().chain(others).collect()
}

/// Percent of the voxels that count.
fn share_above(found: &Statistics, p: Predicted) -> f64 {
    100.0 * p.voxels_above as f64 / found.voxels as f64
}

fn expected(found: &Statistics, p: Predicted) -> String {
    let share = share_above(found, p);
    let basis = if p.sampled {
        " (from a sample of the slices)"
    } else {
        ""
    };
    format!("at threshold {}{basis}\n", number(p.threshold, 6))
        + &output::table(&[
            ("  above", format!("{share:.1} % of the voxels")),
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
