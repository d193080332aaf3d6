//! The parts of a BIN chunk: their data, plain or compressed, and the buffer views that say where they lie.

use crate::gltf::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use crate::manifest::Primitives;
use serde_json::{Value, json};

/// A part of the chunk.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Section {
    /// Vertex data, and the filter that compressed ones have to be decoded with.
    Vertices {
        count: usize,
        stride: usize,
        filter: Option<&'static str>,
    },
    /// Indices in 16 or 32 bits.
    Indices {
        count: usize,
        wide: bool,
        kind: Primitives,
    },
    /// So many bytes of a table's column, which is never compressed.
    Column(usize),
}

impl Section {
    /// Its bytes before it is compressed.
    pub fn bytes(&self) -> usize {
        match *self {
            Section::Vertices { count, stride, .. } => count * stride,
            Section::Indices { count, wide, .. } => count * if wide { 4 } else { 2 },
            Section::Column(bytes) => bytes,
        }
    }

    fn target(&self) -> Option<u32> {
        match self {
            Section::Vertices { .. } => Some(ARRAY_BUFFER),
            Section::Indices { .. } => Some(ELEMENT_ARRAY_BUFFER),
            Section::Column(_) => None,
        }
    }
}

/// Where a part that is not compressed begins behind what has so many bytes, on a multiple of 8 bytes as
/// EXT_structural_metadata asks for.
fn start_of_plain(end: usize) -> usize {
    end.next_multiple_of(8)
}

/// The data of a chunk in the making.
#[derive(Default)]
pub(crate) struct Bin {
    pub bytes: Vec<u8>,
    /// Bytes of each part that was compressed, in order.
    pub lengths: Vec<u32>,
    /// True to compress vertices and indices (EXT_meshopt_compression).
    compress: bool,
}

impl Bin {
    /// An empty chunk.
    pub fn new(compress: bool) -> Self {
        Bin {
            compress,
            ..Bin::default()
        }
    }

    /// Adds a part that is not compressed.
    pub fn plain(&mut self, data: &[u8]) {
        self.bytes.resize(start_of_plain(self.bytes.len()), 0);
        self.bytes.extend_from_slice(data);
    }

    /// Adds vertex data, N bytes to a vertex.
    pub fn vertices<const N: usize>(&mut self, data: &[[u8; N]]) {
        if !self.compress {
            return self.plain(data.as_flattened());
        }
        // the extension has version 0 of the codec, which knows no levels
        let stream = meshopt::encode_vertex_buffer_level(data, 0, Some(0)).expect("cannot fail");
        self.compressed(&stream);
    }

    /// Adds indices in 16 or 32 bits, all below `vertices`.
    pub fn indices(&mut self, indices: &[u32], wide: bool, kind: Primitives, vertices: u32) {
        if self.compress {
            let stream = match kind {
                Primitives::Strips => meshopt::encode_index_sequence(indices, vertices as usize),
                Primitives::Triangles => meshopt::encode_index_buffer(indices, vertices as usize),
            };
            return self.compressed(&stream.expect("cannot fail"));
        }
        self.plain(&[]);
        let all = indices.iter();
        if wide {
            self.bytes.extend(all.flat_map(|i| i.to_le_bytes()));
        } else {
            self.bytes
                .extend(all.flat_map(|&i| (i as u16).to_le_bytes()));
        }
    }

    fn compressed(&mut self, stream: &[u8]) {
        self.bytes.extend_from_slice(stream);
        self.lengths.push(stream.len() as u32);
    }

    /// Pads the chunk to a multiple of so many bytes.
    pub fn pad(&mut self, step: usize) {
        self.bytes
            .resize(self.bytes.len().next_multiple_of(step), 0);
    }
}

/// The buffer views of a chunk's parts.
#[derive(Default)]
pub(crate) struct Views {
    pub views: Vec<Value>,
    /// Bytes of the chunk up to the end of its last part.
    pub end: usize,
    /// Bytes that compressed parts decode to.
    decoded: u64,
}

impl Views {
    /// Adds a part that is in the chunk as it is, or compressed to so many bytes. Returns the number of its view.
    pub fn add(&mut self, part: Section, compressed: Option<u32>) -> usize {
        let mut view = match compressed {
            None => self.plain(part.bytes()),
            Some(bytes) => self.compressed(part, bytes as usize),
        };
        if let Some(target) = part.target() {
            view["target"] = target.into();
        }
        if let Section::Vertices { stride, .. } = part {
            view["byteStride"] = stride.into();
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn plain(&mut self, bytes: usize) -> Value {
        let start = start_of_plain(self.end);
        self.end = start + bytes;
        json!({"buffer": 0, "byteOffset": start, "byteLength": bytes})
    }

    fn compressed(&mut self, part: Section, bytes: usize) -> Value {
        let (count, stride, mode, filter) = match part {
            Section::Vertices {
                count,
                stride,
                filter,
            } => (count, stride, "ATTRIBUTES", filter),
            Section::Indices { count, wide, kind } => {
                let mode = match kind {
                    Primitives::Strips => "INDICES",
                    Primitives::Triangles => "TRIANGLES",
                };
                (count, if wide { 4 } else { 2 }, mode, None)
            }
            Section::Column(_) => unreachable!("columns are never compressed"),
        };
        let mut stream = json!({
            "buffer": 0, "byteOffset": self.end, "byteLength": bytes,
            "byteStride": stride, "count": count, "mode": mode
        });
        if let Some(filter) = filter {
            stream["filter"] = filter.into();
        }
        let length = part.bytes() as u64;
        let view = json!({
            "buffer": 1, "byteOffset": self.decoded, "byteLength": length,
            "extensions": {EXTENSION: stream}
        });
        self.end += bytes;
        self.decoded += length.next_multiple_of(4);
        view
    }

    /// The list of buffers: the chunk, and for compressed views the one that they would be in.
    pub fn buffers(&self) -> Vec<Value> {
        let mut buffers = vec![json!({"byteLength": self.end.next_multiple_of(4)})];
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
