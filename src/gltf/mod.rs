//! glTF as a file format: its container, JSON, buffer views and accessors, and the encodings of numbers in
//! them. What a tile holds, its pieces, cells and tables, is the matter of [`tile`](crate::tile).

pub(crate) mod accessors;
pub(crate) mod bin_writer;
pub(crate) mod buffer_views;
pub(crate) mod container;
pub(crate) mod quantize_normals;
pub(crate) mod read_json;

pub(crate) use ::gltf::json::accessor::{BYTE, FLOAT, UNSIGNED_INT, UNSIGNED_SHORT};
pub(crate) use ::gltf::json::buffer::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
pub(crate) use ::gltf::json::mesh::{TRIANGLE_STRIP, TRIANGLES};
