//! One file or folder for each format: from the bytes of its header to where samples lie and what they mean.

pub(crate) mod amiramesh;
pub(crate) mod analyze;
pub(crate) mod archive;
pub(crate) mod bmp;
#[cfg(feature = "dicom")]
pub(crate) mod dicom;
pub(crate) mod folder;
pub(crate) mod foreign;
#[cfg(feature = "hdf5")]
pub(crate) mod hdf5;
pub(crate) mod metaimage;
pub(crate) mod mrc;
pub(crate) mod nifti;
pub(crate) mod npy;
pub(crate) mod nrrd;
mod optional;
pub(crate) mod png;
pub(crate) mod scanco;
pub(crate) mod sidecar;
mod skyscan;
pub(crate) mod tiff;
pub(crate) mod vti;
#[cfg(feature = "zarr")]
pub(crate) mod zarr;

#[cfg(not(feature = "dicom"))]
pub(crate) use optional::dicom;
#[cfg(not(feature = "hdf5"))]
pub(crate) use optional::hdf5;
#[cfg(not(feature = "zarr"))]
pub(crate) use optional::zarr;
