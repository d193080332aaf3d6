//! What the system gives: files that appear whole, temporary and spilled ones, writing beside the work, memory
//! and its limit, wide vectors. Nothing here knows of volumes or surfaces.

pub(crate) mod atomic_file;
pub(crate) mod background_writer;
pub(crate) mod direct_io;
pub(crate) mod files;
pub(crate) mod huge_pages;
pub(crate) mod id_set;
pub(crate) mod locks;
pub(crate) mod memory_pool;
pub(crate) mod process_memory;
pub(crate) mod rounding;
pub(crate) mod simd;
pub(crate) mod sorted_spill;
pub(crate) mod spill_file;
pub(crate) mod state_codec;
pub(crate) mod temp_file;
pub(crate) mod unchecked;
pub(crate) mod write_out;
