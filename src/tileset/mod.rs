//! A directory of tiles, read and written as a whole.

mod levels_left;
mod lock;
mod lookup;
mod output_dir;
mod reader;
mod refused;
mod writer;

pub(crate) use levels_left::{LEVELS_MOVING, LEVELS_STATE, LOD};
pub use levels_left::{LevelsLeft, levels_left};
pub(crate) use lock::Lock;
pub(crate) use lookup::TileLookup;
pub(crate) use output_dir::{Output, PARTS, PLAN, outward, remove_if, tidy};
pub use output_dir::{check_output, interrupted};
pub(crate) use output_dir::{is_moved_in, make_directories, take_lock};
pub(crate) use reader::Stated;
pub use reader::TileSet;
pub(crate) use refused::{refuse_bucket, refuse_same};
pub(crate) use writer::{TilesetWriter, layer_directory, with_euler_characteristic, write_tile};
