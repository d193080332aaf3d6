//! Bytes on disk and how they are read: maps, positioned reads, streams, chunks and pages.

pub(crate) mod blob;
pub(crate) mod byte_source;
#[cfg(any(feature = "hdf5", feature = "zarr"))]
pub(crate) mod chunked;
pub(crate) mod descriptor;
pub(crate) mod file;
mod mmap;
pub(crate) mod paged;
pub(crate) mod stamp;
mod stream;
pub(crate) mod text;
