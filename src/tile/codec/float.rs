//! `float`: 32-bit floats, plain glTF 2.0.

use super::{TileCodec, VertexFormat};
use crate::gltf::accessors::Element;
use crate::manifest::Encoding;
use crate::sys::simd::dispatch;
use std::borrow::Cow;

/// Floats as they are.
#[derive(Debug)]
pub struct Float;

impl TileCodec for Float {
    fn encoding(&self) -> Encoding {
        Encoding::Float
    }

    fn keeps_floats(&self) -> bool {
        true
    }

    fn vertices(&self) -> VertexFormat {
        VertexFormat {
            position: Element::FLOAT3,
            normal: Element::FLOAT3,
            steps: false,
            rounded: false,
        }
    }

    fn encode_positions<'a>(&self, floats: &'a [[u8; 12]], _: [i32; 3]) -> Cow<'a, [u8]> {
        Cow::Borrowed(floats.as_flattened())
    }

    fn encode_normals<'a>(&self, floats: &'a [[u8; 12]]) -> Cow<'a, [u8]> {
        Cow::Borrowed(floats.as_flattened())
    }

    fn decode_positions(&self, bytes: &[u8], _: [f32; 3], out: &mut [[f32; 3]]) {
        decode(bytes, out);
    }

    fn decode_normals(&self, bytes: &[u8], out: &mut [[f32; 3]]) {
        decode(bytes, out);
    }

    fn has_odd_filler(&self, positions: &[u8], _: &[u8]) -> [bool; 2] {
        // two numbers are one where positions are 0
        let (floats, _) = positions.as_chunks();
        [dispatch!(any_minus_zero(floats)), false]
    }
}

/// Three little-endian floats.
pub(super) fn float3(e: &[u8; 12]) -> [f32; 3] {
    let at = |i: usize| f32::from_le_bytes([e[i], e[i + 1], e[i + 2], e[i + 3]]);
    [at(0), at(4), at(8)]
}

fn decode(bytes: &[u8], out: &mut [[f32; 3]]) {
    for (out, e) in out.iter_mut().zip(bytes.as_chunks().0) {
        *out = float3(e);
    }
}

/// True if one of some floats is 0 with a minus.
#[inline(always)]
pub fn any_minus_zero(floats: &[[u8; 4]]) -> bool {
    let odd = |any, e: &[u8; 4]| any | (u32::from_le_bytes(*e) == 1 << 31);
    floats.iter().fold(false, odd)
}
