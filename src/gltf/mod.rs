//! glTF as a file format: its container, JSON, buffer views and accessors. What a tile holds, its pieces, cells and
//! tables, and how its numbers are encoded, is the matter of [`tile`](crate::tile).

pub(crate) mod accessors;
pub(crate) mod bin_writer;
pub(crate) mod buffer_views;
pub(crate) mod container;
pub(crate) mod read_json;

pub(crate) use ::gltf::json::accessor::{
    BYTE, FLOAT, SHORT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT,
};
pub(crate) use ::gltf::json::buffer::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
pub(crate) use ::gltf::json::mesh::{TRIANGLE_STRIP, TRIANGLES};
