//! Formats that a build may leave out: what is known of them in every build. Where one is left out, its files are
//! recognised all the same, and refused by name.

use crate::error::{Error, Result};
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::format::{Format, Input, Slices, Unread};
use crate::volume::io::blob::Blob;
use crate::volume::options::{Choice, OpenOptions};
use std::path::Path;

fn absent(path: &Path, name: &str, feature: &str) -> Error {
    Error::unsupported(
        path,
        format!("the {name} format in this build"),
        format!("build alvis with the feature `{feature}`"),
    )
}

/// DICOM.
pub(crate) mod dicom {
    use super::*;

    pub(crate) const FORMAT: Format = Format {
        name: "dicom",
        title: "DICOM",
        extensions: &["dcm"],
        takes: &[Choice::Series, Choice::Resample],
        starts: |head| head.get(128..132) == Some(b"DICM"),
        parse: Some(refuse),
        slices: Some(Slices {
            parse: refuse_slices,
            is_single: |_| Ok(false),
            placed: true,
        }),
        ..Format::BASE
    };

    fn refuse(input: &Input, _: &OpenOptions) -> Result<VolumeDescriptor> {
        Err(absent(input.path, "DICOM", "dicom"))
    }

    fn refuse_slices(
        path: &Path,
        _: Vec<Blob>,
        _: Vec<Unread>,
        _: &OpenOptions,
    ) -> Result<VolumeDescriptor> {
        Err(absent(path, "DICOM", "dicom"))
    }
}

/// HDF5.
pub(crate) mod hdf5 {
    use super::*;

    /// What a file begins with.
    pub(crate) const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

    pub(crate) const FORMAT: Format = Format {
        name: "hdf5",
        title: "HDF5",
        extensions: &["h5", "hdf5", "nxs", "nc", "mnc", "ims"],
        takes: &[
            Choice::Resample,
            Choice::Dataset,
            Choice::Level,
            Choice::Channel,
            Choice::Time,
        ],
        starts: |head| head.starts_with(&SIGNATURE),
        parse: Some(refuse),
        ..Format::BASE
    };

    fn refuse(input: &Input, _: &OpenOptions) -> Result<VolumeDescriptor> {
        Err(absent(input.path, "HDF5", "hdf5"))
    }
}

/// Zarr.
pub(crate) mod zarr {
    use super::*;

    pub(crate) const FORMAT: Format = Format {
        name: "zarr",
        title: "Zarr",
        extensions: &["zarr"],
        takes: &[
            Choice::Resample,
            Choice::Dataset,
            Choice::Level,
            Choice::Channel,
            Choice::Time,
        ],
        looks: Some(|path, _| {
            [".zarray", ".zgroup", "zarr.json"]
                .iter()
                .any(|name| crate::store::is_file(&path.join(name)))
        }),
        folder: true,
        in_buckets: true,
        parse: Some(refuse),
        ..Format::BASE
    };

    fn refuse(input: &Input, _: &OpenOptions) -> Result<VolumeDescriptor> {
        Err(absent(input.path, "Zarr", "zarr"))
    }
}
