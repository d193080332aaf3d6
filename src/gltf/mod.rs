//! glTF as a file format: its container, JSON, buffer views and accessors, and the encodings of numbers in
//! them. What a tile holds, its pieces, cells and tables, is the matter of [`tile`](crate::tile).

pub(crate) mod accessors;
pub(crate) mod bin_writer;
pub(crate) mod buffer_views;
pub(crate) mod container;
pub(crate) mod quantize_normals;
pub(crate) mod read_json;

/// Targets of buffer views.
pub(crate) const ARRAY_BUFFER: u32 = 34962;
pub(crate) const ELEMENT_ARRAY_BUFFER: u32 = 34963;
