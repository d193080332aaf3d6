//! Tiles that cannot be written as asked.

use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::manifest::Encoding;
use crate::tile::codec::{CODECS, Reach, TileCodec, codec};
use crate::tile::{Refused, tile_path};

/// The error for a tile that cannot be written as asked.
pub fn refused(why: Refused, grid: [u32; 3], tiling: Tiling) -> Error {
    match why {
        Refused::TooLarge => too_large(grid),
        Refused::TooWide(reach) => too_wide(reach, tiling.macrocube),
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

/// The error for tiles beyond the reach of an encoding.
fn too_wide(reach: Reach, macrocube: [u32; 3]) -> Error {
    let [x, y, z] = macrocube;
    let names = |reach: Option<Reach>| {
        let some = CODECS.iter().filter(|codec| codec.reach() == reach);
        let names: Vec<String> = some.map(|codec| option(*codec)).collect();
        names.join(" or ")
    };
    let Reach { cubes, bits } = reach;
    Error::usage(
        "--macrocube",
        format!("{x} x {y} x {z} cubes"),
        format!(
            "at most {cubes} along each axis with --encoding {}, whose positions have {bits} bits",
            names(Some(reach))
        ),
    )
    .with_hint(format!(
        "use smaller macrocubes, or --encoding {}",
        names(None)
    ))
}

/// The name of an encoding as an option.
fn option(codec: &dyn TileCodec) -> String {
    // as the index spells it
    format!("{:?}", codec.encoding()).to_lowercase()
}

/// Refuses macrocubes that reach further than positions do in an encoding.
///
/// # Errors
/// [`Error::Usage`].
pub(crate) fn check_reach(encoding: Encoding, tiling: Tiling) -> Result<()> {
    let cubes = |a: usize| tiling.macrocube[a].min(tiling.dims.0[a] - 1);
    match codec(encoding).reach() {
        Some(reach) if (0..3).any(|a| cubes(a) > reach.cubes) => {
            Err(too_wide(reach, tiling.macrocube))
        }
        _ => Ok(()),
    }
}
