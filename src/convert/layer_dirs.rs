//! A directory for each layer of macrocubes that has a tile.

use crate::convert::finalize::shards::Layers;
use crate::error::{Error, Result};
use crate::sys::files::remove_if_there;
use std::path::Path;

/// Path of the directory of a layer's tiles.
pub fn layer_directory(z: u32) -> String {
    format!("tiles/z{z:04}")
}

/// Makes the directories of layers to sweep, empty.
pub fn make_layer_directories(work: &Path, layers: std::ops::Range<u32>) -> Result<()> {
    for z in layers {
        let dir = work.join(layer_directory(z));
        remove_if_there(&dir)?;
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
    }
    Ok(())
}

/// A layer without surface has no tile, hence no directory.
pub fn remove_empty_layer_directories(work: &Path, count: u32, layers: &mut Layers) -> Result<()> {
    let remove = |layers: std::ops::Range<u32>| {
        let mut dirs = layers.map(|z| work.join(layer_directory(z)));
        dirs.try_for_each(|dir| remove_if_there(&dir))
    };
    let mut next = 0;
    layers.for_each(|layer| {
        remove(next..layer.z)?;
        next = layer.z + 1;
        Ok(())
    })?;
    remove(next..count)
}
