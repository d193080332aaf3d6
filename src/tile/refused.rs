//! Tiles that cannot be written as asked.

use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::manifest::Encoding;
use crate::tile::{Refused, tile_path};

/// The error for a tile that cannot be written as asked.
pub fn refused(why: Refused, grid: [u32; 3], tiling: Tiling) -> Error {
    match why {
        Refused::TooLarge => too_large(grid),
        Refused::TooWide => too_wide(tiling.macrocube),
    }
}

/// The error for a tile beyond the size of a GLB.
pub fn too_large(grid: [u32; 3]) -> Error {
    Error::usage(
        "--macrocube",
        format!("more than 4 GiB in {}", tile_path(grid)),
        "tiles below 4 GiB, the limit of GLB files",
    )
    .with_hint("use smaller macrocubes")
}

/// The error for tiles beyond the reach of 16-bit positions.
pub fn too_wide(macrocube: [u32; 3]) -> Error {
    let [x, y, z] = macrocube;
    Error::usage(
        "--macrocube",
        format!("{x} x {y} x {z} cubes"),
        "at most 254 along each axis with --encoding quantized or meshopt, whose positions have 16 bits",
    )
    .with_hint("use smaller macrocubes, or --encoding float")
}

/// Refuses macrocubes that reach further than 16-bit positions: 255 cubes are 65,280 steps, and with
/// caps a tile reaches a voxel and a half further.
///
/// # Errors
/// [`Error::Usage`].
pub(crate) fn check_reach(encoding: Encoding, tiling: Tiling) -> Result<()> {
    const MOST: u32 = 254;
    let cubes = |a: usize| tiling.macrocube[a].min(tiling.dims.0[a] - 1);
    if encoding != Encoding::Float && (0..3).any(|a| cubes(a) > MOST) {
        return Err(too_wide(tiling.macrocube));
    }
    Ok(())
}
