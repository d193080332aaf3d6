//! The parts of a BIN chunk: their data, and the buffer views that say where they lie. How parts are compressed, if
//! they are, is the matter of who adds them.

use crate::gltf::accessors::Element;
use crate::gltf::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use crate::manifest::Primitives;
use serde_json::{Value, json};

/// A part of the chunk.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Section {
    /// Vertex data.
    Vertices {
        count: usize,
        stride: usize,
        /// They are normals.
        normals: bool,
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
            Section::Indices { count, wide, .. } => count * Element::index(wide).stride as usize,
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

/// Indices of primitives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct IndexList<'a> {
    /// The indices, all below `vertices`.
    pub indices: &'a [u32],
    /// They are stored in 32 bits.
    pub wide: bool,
    pub kind: Primitives,
    pub vertices: u32,
}

/// The data of a chunk in the making.
#[derive(Default)]
pub(crate) struct Bin {
    pub bytes: Vec<u8>,
    /// Bytes of each part that was compressed, in order.
    pub lengths: Vec<u32>,
}

impl Bin {
    /// Adds a part that is not compressed.
    pub fn plain(&mut self, data: &[u8]) {
        self.bytes.resize(start_of_plain(self.bytes.len()), 0);
        self.bytes.extend_from_slice(data);
    }

    /// Adds indices that are not compressed.
    pub fn plain_indices(&mut self, list: &IndexList) {
        self.plain(&[]);
        let all = list.indices.iter();
        if list.wide {
            self.bytes.extend(all.flat_map(|i| i.to_le_bytes()));
        } else {
            self.bytes
                .extend(all.flat_map(|&i| (i as u16).to_le_bytes()));
        }
    }

    /// Adds what a part is compressed to.
    pub fn compressed(&mut self, stream: &[u8]) {
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
    /// Bytes of the second buffer, in which views of compressed parts lie.
    pub fallback: u64,
}

impl Views {
    /// Adds a part that is in the chunk as it is. Returns the number of its view.
    pub fn plain(&mut self, part: Section) -> usize {
        let (start, bytes) = (start_of_plain(self.end), part.bytes());
        self.end = start + bytes;
        let view = json!({"buffer": 0, "byteOffset": start, "byteLength": bytes});
        self.add(part, view)
    }

    /// Adds a part whose bytes lie where `view` says. Returns the number of its view.
    pub fn add(&mut self, part: Section, mut view: Value) -> usize {
        if let Some(target) = part.target() {
            view["target"] = target.into();
        }
        if let Section::Vertices { stride, .. } = part {
            view["byteStride"] = stride.into();
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// The chunk as a buffer.
    pub fn chunk(&self) -> Value {
        json!({"byteLength": self.end.next_multiple_of(4)})
    }
}
