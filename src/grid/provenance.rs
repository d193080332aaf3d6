//! Which volume of an input was read, and where its size and place came from.

use serde::{Deserialize, Serialize};

/// What was asked for of an input that may hold several volumes; absent what was not.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Part {
    /// The series of a DICOM folder (its number, description or UID), of a TIFF or OME-TIFF (its number or name).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<String>,
    /// True if slices that do not make a regular grid were interpolated to one (DICOM).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub resample: bool,
    /// The array, by its path (HDF5, Zarr).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dataset: Option<String>,
    /// The level of a pyramid, 0 the finest (OME-Zarr).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<u32>,
    /// The channel, from 0 on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<u32>,
    /// The time, from 0 on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<u32>,
}

/// Where a value came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Nothing was stated; the default was taken.
    #[default]
    Default,
    /// The file states it.
    File,
    /// An option overrides the file.
    Option,
    /// The file states it for other axes alone, and this one is taken to be like them.
    Assumed,
}

/// Which way the world's axes run, where a file states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Frame {
    /// Not stated.
    #[default]
    Unstated,
    /// To a patient's right, front and head.
    Ras,
    /// To the left, back and head.
    Lps,
}

/// Where the placement's parts came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Provenance {
    /// Of `spacing`, for each axis.
    pub spacing: [Origin; 3],
    /// Of `unit`.
    pub unit: Origin,
    /// Of `origin` and `directions`.
    pub origin: Origin,
    /// The world that they are in; no index tells it.
    #[serde(skip)]
    pub frame: Frame,
}
