//! What stands for the readers of formats that this build leaves out.
#![allow(dead_code)] // each build uses those that it lacks

use crate::error::{Error, Result};
use crate::volume::formats::folder::unread::Unread;
use crate::volume::io::blob::Blob;
use crate::volume::io::descriptor::VolumeDescriptor;
use crate::volume::open::OpenOptions;
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

    /// True if a file begins as DICOM does.
    pub(crate) fn is_dicom(head: &[u8]) -> bool {
        head.get(128..132) == Some(b"DICM")
    }

    /// True for the list of its files that a disc holds.
    pub(crate) fn is_index(path: &Path) -> bool {
        path.file_name()
            .is_some_and(|name| name.eq_ignore_ascii_case("DICOMDIR"))
    }

    /// Refuses it.
    pub(crate) fn parse(path: &Path, _: Vec<Blob>, _: &OpenOptions) -> Result<VolumeDescriptor> {
        Err(absent(path, "DICOM", "dicom"))
    }

    /// Refuses it.
    pub(crate) fn parse_folder(
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

    /// True if a file begins as HDF5 does.
    pub(crate) fn is_hdf5(_: &Path, head: &[u8]) -> bool {
        head.starts_with(b"\x89HDF\r\n\x1a\n")
    }

    /// Refuses it.
    pub(crate) fn parse(path: &Path, _: &OpenOptions) -> Result<VolumeDescriptor> {
        Err(absent(path, "HDF5", "hdf5"))
    }
}

/// Zarr.
pub(crate) mod zarr {
    use super::*;

    /// True for a folder that holds an array or group.
    pub(crate) fn is_zarr(path: &Path) -> bool {
        [".zarray", ".zgroup", "zarr.json"]
            .iter()
            .any(|name| path.join(name).is_file())
    }

    /// Refuses it.
    pub(crate) fn parse(path: &Path, _: &OpenOptions) -> Result<VolumeDescriptor> {
        Err(absent(path, "Zarr", "zarr"))
    }
}
