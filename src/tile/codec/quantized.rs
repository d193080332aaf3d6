//! `quantized` (KHR_mesh_quantization): positions are lattice steps in 16 bits, normals have 8 bits.

use super::float::float3;
use super::octahedral::{Kind, quantize};
use super::{Reach, TileCodec, VertexFormat};
use crate::gltf::accessors::Element;
use crate::gltf::{BYTE, UNSIGNED_SHORT};
use crate::grid::LATTICE;
use crate::manifest::Encoding;
use crate::tile::body::Body;
use crate::tile::store::Refused;
use std::borrow::Cow;

/// What the extension is named.
pub(super) const EXTENSION: &str = "KHR_mesh_quantization";

/// 255 cubes are 65,280 steps, and with caps a tile reaches a voxel and a half further.
pub(super) const REACH: Reach = Reach {
    cubes: 254,
    bits: u16::BITS,
};

/// 16 bits for positions, 8 for normals.
#[derive(Debug)]
pub struct Quantized;

impl TileCodec for Quantized {
    fn encoding(&self) -> Encoding {
        Encoding::Quantized
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[EXTENSION]
    }

    fn reach(&self) -> Option<Reach> {
        Some(REACH)
    }

    fn vertices(&self) -> VertexFormat {
        VertexFormat {
            position: Element {
                component: UNSIGNED_SHORT,
                shape: "VEC3",
                normalized: false,
                stride: 8,
            },
            normal: Element {
                component: BYTE,
                shape: "VEC3",
                normalized: true,
                stride: 4,
            },
            steps: true,
            rounded: true,
        }
    }

    /// The macrocube's corner, a voxel lower along axes where caps lie outside of it.
    fn base(&self, body: &Body, low: [u32; 3]) -> Result<[i32; 3], Refused> {
        let [min, max] = body.bounds();
        let corner = |a: usize| {
            let low = low[a] as i32;
            if min[a] < low * LATTICE as i32 {
                low - 1
            } else {
                low
            }
        };
        let base: [i32; 3] = std::array::from_fn(corner);
        let fits = |a: usize| {
            let corner = base[a] * LATTICE as i32;
            min[a] >= corner && max[a] - corner <= i32::from(u16::MAX)
        };
        match (0..3).all(fits) {
            true => Ok(base),
            false => Err(Refused::TooWide(REACH)),
        }
    }

    fn encode_positions<'a>(&self, floats: &'a [[u8; 12]], base: [i32; 3]) -> Cow<'a, [u8]> {
        Cow::Owned(encode(floats, base, 0))
    }

    fn encode_normals<'a>(&self, floats: &'a [[u8; 12]]) -> Cow<'a, [u8]> {
        Cow::Owned(quantize(floats, Kind::Vector).into_flattened())
    }

    fn decode_positions(&self, bytes: &[u8], base: [f32; 3], out: &mut [[f32; 3]]) {
        decode(bytes, base, 0, out);
    }

    fn decode_normals(&self, bytes: &[u8], out: &mut [[f32; 3]]) {
        for (out, e) in out.iter_mut().zip(bytes.as_chunks::<4>().0) {
            // glTF 2.0, section 3.11: max(c / 127, -1)
            *out = std::array::from_fn(|a| (f32::from(e[a] as i8) / 127.0).max(-1.0));
        }
    }

    fn has_odd_filler(&self, positions: &[u8], normals: &[u8]) -> [bool; 2] {
        let (positions, normals) = (positions.as_chunks::<8>().0, normals.as_chunks::<4>().0);
        [
            positions.iter().fold(0, |any, e| any | e[6] | e[7]) != 0,
            normals.iter().fold(0, |any, e| any | e[3]) != 0,
        ]
    }
}

/// Positions as 16 bits each of 2^`shift` lattice steps from a corner in voxels.
pub(super) fn encode(floats: &[[u8; 12]], base: [i32; 3], shift: u32) -> Vec<u8> {
    let corner = base.map(|b| b * LATTICE as i32);
    let steps = floats.iter().map(|e| {
        let position = float3(e);
        let step = |a: usize| {
            let steps = (position[a] * LATTICE as f32) as i32 - corner[a];
            (steps >> shift) as u16
        };
        bytemuck::cast([step(0), step(1), step(2), 0].map(u16::to_le_bytes))
    });
    steps.collect::<Vec<[u8; 8]>>().into_flattened()
}

/// The positions that [`encode`] has stored. Exact in `f32`.
pub(super) fn decode(bytes: &[u8], base: [f32; 3], shift: u32, out: &mut [[f32; 3]]) {
    let step = (1 << shift) as f32 / LATTICE as f32;
    for (out, e) in out.iter_mut().zip(bytes.as_chunks::<8>().0) {
        let steps = |a: usize| u16::from_le_bytes([e[2 * a], e[2 * a + 1]]);
        *out = std::array::from_fn(|a| base[a] + f32::from(steps(a)) * step);
    }
}
