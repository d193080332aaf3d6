//! What `alvis info --json` prints of a volume.

use super::info::{Candidate, Part, Predicted, candidates};
use super::region::Roi;
use super::threshold::Threshold;
use crate::grid::{Dims, Fill, Filter, Shape, Unit};
use crate::volume::{Dtype, Endian, Opened, Statistics};
use serde::Serialize;
use std::collections::BTreeMap;

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub struct Report {
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
    crop: Option<String>,
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
pub struct Counted {
    #[serde(flatten)]
    shape: Shape,
    fill: Fill,
    voxels: u64,
    /// 0 to 1.
    share: f64,
    #[serde(flatten)]
    found: Option<Found>,
}

/// What is known of a region that was found in the scan.
#[derive(Debug, Serialize)]
struct Found {
    /// The slices that show the sample, half-open.
    slices: [u32; 2],
    /// Of its axis, in degrees.
    tilt: f64,
    /// Other regions that might be meant, as `--roi` takes them.
    others: Vec<String>,
}

impl Counted {
    /// Of one that was given, or found.
    pub fn of(roi: &Roi) -> Self {
        let found = roi.found.as_ref().map(|found| Found {
            slices: [found.slices.start, found.slices.end],
            tilt: found.tilt,
            others: found.others.iter().map(ToString::to_string).collect(),
        });
        Counted {
            shape: roi.shape.clone(),
            fill: roi.fill,
            voxels: roi.count,
            share: roi.share(),
            found,
        }
    }
}

/// All that is known of a volume.
pub fn report(
    opened: &Opened,
    found: Statistics,
    asked: Option<Threshold>,
    predicted: Option<Predicted>,
    part: Part<Counted>,
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
        crop: part.crop.map(|crop| crop.to_string()),
        region: part.region,
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
