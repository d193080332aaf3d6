//! What files state of sizes, units, axes and scales, and what alvis makes of it.

#[cfg_attr(not(any(feature = "hdf5", feature = "zarr")), allow(dead_code))]
pub(crate) mod axis;
pub(crate) mod cf;
mod fits;
pub(crate) mod place;
pub(crate) mod size;
pub(crate) mod warning;
#[cfg_attr(not(any(feature = "hdf5", feature = "zarr")), allow(dead_code))]
pub(crate) mod written;
