//! What accessors describe: elements of attributes, and the indices of a primitive.

use crate::gltf::buffer_views::Bytes;
use crate::gltf::{BYTE, FLOAT, SHORT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT};

/// What the elements of an accessor are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Element {
    /// glTF's number of the component type.
    pub component: u32,
    /// glTF's `type`: the number of components.
    pub shape: &'static str,
    /// True if integers stand for 0 to 1, or -1 to 1.
    pub normalized: bool,
    /// Bytes from one element to the next.
    pub stride: u64,
}

impl Element {
    /// A float.
    pub const FLOAT: Element = Element::tight(FLOAT, "SCALAR", 4);
    /// Three floats.
    pub const FLOAT3: Element = Element::tight(FLOAT, "VEC3", 12);
    /// An index in 16 bits.
    pub const NARROW_INDEX: Element = Element::tight(UNSIGNED_SHORT, "SCALAR", 2);
    /// An index in 32 bits.
    pub const WIDE_INDEX: Element = Element::tight(UNSIGNED_INT, "SCALAR", 4);
    /// A linear colour, 16 bits each.
    pub const COLOUR: Element = Element {
        normalized: true,
        ..Element::tight(UNSIGNED_SHORT, "VEC4", 8)
    };

    const fn tight(component: u32, shape: &'static str, stride: u64) -> Self {
        Element {
            component,
            shape,
            normalized: false,
            stride,
        }
    }

    /// An index into vertices.
    pub const fn index(wide: bool) -> Self {
        if wide {
            Element::WIDE_INDEX
        } else {
            Element::NARROW_INDEX
        }
    }

    /// Bytes of a component.
    pub fn component_bytes(&self) -> u64 {
        match self.component {
            BYTE | UNSIGNED_BYTE => 1,
            SHORT | UNSIGNED_SHORT => 2,
            _ => 4,
        }
    }

    /// True if an element fills its stride, so that a view need not state it.
    pub fn fills_stride(&self) -> bool {
        let components = match self.shape {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        components * self.component_bytes() == self.stride
    }
}

/// The indices of a primitive, little-endian of 16 or 32 bits.
#[derive(Debug, Clone)]
pub struct Indices<'a> {
    pub(crate) bytes: Bytes<'a>,
    pub(crate) wide: bool,
}

impl Indices<'_> {
    /// Number of indices.
    pub fn len(&self) -> usize {
        self.bytes.get().len() / if self.wide { 4 } else { 2 }
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True for 32-bit indices.
    pub fn is_wide(&self) -> bool {
        self.wide
    }

    /// Replaces the contents of `out` by the indices.
    pub fn read_into(&self, out: &mut Vec<u32>) {
        out.clear();
        if self.wide {
            let all = self.bytes.chunks::<4>();
            out.extend(all.iter().map(|&b| u32::from_le_bytes(b)));
        } else {
            let all = self.bytes.chunks::<2>();
            out.extend(all.iter().map(|&b| u32::from(u16::from_le_bytes(b))));
        }
    }
}
