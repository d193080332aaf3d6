//! Bytes on disk and how they are read: maps, positioned reads, streams, chunks and pages.

#[cfg(feature = "s3")]
mod ahead;
pub(crate) mod blob;
#[cfg(feature = "s3")]
pub(crate) mod blocked;
mod byte_rle;
pub(crate) mod byte_source;
pub(crate) mod chunk_cache;
#[cfg(any(feature = "hdf5", feature = "s3", feature = "zarr"))]
pub(crate) mod chunked;
pub(crate) mod data;
pub(crate) mod decoded_once;
pub(crate) mod file;
pub(crate) mod half;
mod mmap;
pub(crate) mod paged;
mod stream;
pub(crate) mod text;
pub(crate) mod word;
