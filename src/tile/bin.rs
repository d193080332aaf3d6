//! A BIN chunk in the making with its buffer views, plain or compressed.

use super::document::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use crate::manifest::Primitives;
use serde_json::{Value, json};

/// The BIN chunk and the views into it.
#[derive(Default)]
pub(super) struct Bin {
    pub bytes: Vec<u8>,
    pub views: Vec<Value>,
    /// True to compress vertices and indices (EXT_meshopt_compression).
    compress: bool,
    /// Bytes that compressed views decode to.
    decoded: u64,
}

impl Bin {
    /// An empty chunk.
    pub fn new(compress: bool) -> Self {
        Bin {
            compress,
            ..Bin::default()
        }
    }

    /// Adds a view that is never compressed, on a multiple of 8 bytes as EXT_structural_metadata
    /// asks for; returns its number.
    pub fn plain(&mut self, data: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        let start = self.bytes.len();
        self.bytes.extend_from_slice(data);
        let mut view = json!({"buffer": 0, "byteOffset": start, "byteLength": data.len()});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds a view of vertex data, N bytes to a vertex; `filter` is what a compressed view has to
    /// be decoded with.
    pub fn vertices<const N: usize>(&mut self, data: &[[u8; N]], filter: Option<&str>) -> usize {
        if !self.compress {
            let view = self.plain(data.as_flattened(), Some(ARRAY_BUFFER));
            self.views[view]["byteStride"] = N.into();
            return view;
        }
        // the extension has version 0 of the codec, which knows no levels
        let stream = meshopt::encode_vertex_buffer_level(data, 0, Some(0)).expect("cannot fail");
        let view = self.compressed(&stream, [data.len(), N], "ATTRIBUTES", ARRAY_BUFFER);
        self.views[view]["byteStride"] = N.into();
        if let Some(filter) = filter {
            self.views[view]["extensions"][EXTENSION]["filter"] = filter.into();
        }
        view
    }

    /// Adds a view of indices in 16 or 32 bits, all below `vertices`.
    pub fn indices(
        &mut self,
        indices: &[u32],
        wide: bool,
        kind: Primitives,
        vertices: u32,
    ) -> usize {
        let size = if wide { 4 } else { 2 };
        if !self.compress {
            let mut data = Vec::with_capacity(size * indices.len());
            if wide {
                data.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
            } else {
                data.extend(indices.iter().flat_map(|&i| (i as u16).to_le_bytes()));
            }
            return self.plain(&data, Some(ELEMENT_ARRAY_BUFFER));
        }
        let (stream, mode) = match kind {
            Primitives::Strips => (
                meshopt::encode_index_sequence(indices, vertices as usize),
                "INDICES",
            ),
            Primitives::Triangles => (
                meshopt::encode_index_buffer(indices, vertices as usize),
                "TRIANGLES",
            ),
        };
        let stream = stream.expect("cannot fail");
        self.compressed(&stream, [indices.len(), size], mode, ELEMENT_ARRAY_BUFFER)
    }

    fn compressed(
        &mut self,
        stream: &[u8],
        [count, stride]: [usize; 2],
        mode: &str,
        target: u32,
    ) -> usize {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(stream);
        let length = (count * stride) as u64;
        self.views.push(json!({
            "buffer": 1, "byteOffset": self.decoded, "byteLength": length, "target": target,
            "extensions": {EXTENSION: {
                "buffer": 0, "byteOffset": start, "byteLength": stream.len(),
                "byteStride": stride, "count": count, "mode": mode
            }}
        }));
        self.decoded += length.next_multiple_of(4);
        self.views.len() - 1
    }

    /// Pads the chunk to its end and returns the list of buffers: the chunk, and for compressed views
    /// the one that they would be in.
    pub fn finish(&mut self) -> Vec<Value> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut buffers = vec![json!({"byteLength": self.bytes.len()})];
        if self.decoded > 0 {
            buffers.push(json!({
                "byteLength": self.decoded, "extensions": {EXTENSION: {"fallback": true}}
            }));
        }
        buffers
    }
}

/// Name of the extension.
const EXTENSION: &str = "EXT_meshopt_compression";
