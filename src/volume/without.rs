//! What stands for the readers of formats that this build leaves out.
#![allow(dead_code)] // each build uses those that it lacks

use super::blob::Blob;
use super::layout::Recipe;
use super::open::OpenOptions;
use crate::error::{Error, Result};
use std::path::Path;

fn absent(path: &Path, name: &str, feature: &str) -> Error {
    Error::unsupported(
        path,
        format!("the {name} format in this build"),
        format!("build alvis with the feature `{feature}`"),
    )
}

/// DICOM.
pub(super) mod dicom {
    use super::*;

    /// True if a file begins as DICOM does.
    pub(in super::super) fn is_dicom(head: &[u8]) -> bool {
        head.get(128..132) == Some(b"DICM")
    }

    /// Refuses it.
    pub(in super::super) fn parse(path: &Path, _: Vec<Blob>, _: &OpenOptions) -> Result<Recipe> {
        Err(absent(path, "DICOM", "dicom"))
    }
}
