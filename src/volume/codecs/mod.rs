//! Compression that no crate reads as alvis needs it.

#[cfg(any(feature = "hdf5", feature = "zarr"))]
pub(crate) mod blosc;
pub(crate) mod zstd;
