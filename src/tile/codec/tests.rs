//! An encoding that exists here alone: all that writes and reads tiles takes it.

use super::*;
use crate::gltf::{ARRAY_BUFFER, SHORT};
use crate::grid::{LATTICE, coordinate};
use crate::manifest::{Form, Layout, Primitives};
use crate::strip::append_strip;
use crate::tile::contents::{Contents, name};
use crate::tile::encoded::{FloatBody, encode};
use crate::tile::pieces::{Piece, pieces};
use crate::tile::read::Tile;
use crate::tile::{PieceIds, TileHead, tile_file};

/// Positions are steps in 16 bits with a sign, from the middle of the macrocube, normals floats, and vertices have all
/// their bits turned round.
#[derive(Debug)]
struct Turned;

const MIDDLE: i32 = 32;
const REACH: Reach = Reach {
    cubes: 120,
    bits: 16,
};

fn turned(bytes: &[u8]) -> Vec<u8> {
    bytes.iter().map(|b| !b).collect()
}

impl TileCodec for Turned {
    fn encoding(&self) -> Encoding {
        // the index has no name for it
        Encoding::default()
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["TEST_turned"]
    }

    fn reach(&self) -> Option<Reach> {
        Some(REACH)
    }

    fn vertices(&self) -> VertexFormat {
        VertexFormat {
            position: Element {
                component: SHORT,
                shape: "VEC3",
                normalized: false,
                stride: 8,
            },
            normal: Element::FLOAT3,
            steps: true,
            rounded: false,
        }
    }

    fn base(&self, body: &Body, low: [u32; 3]) -> Result<[i32; 3], Refused> {
        let base = low.map(|v| v as i32 + MIDDLE);
        let is_far = |v: [i32; 3]| {
            let step = |a: usize| v[a] - base[a] * LATTICE as i32;
            (0..3).any(|a| i16::try_from(step(a)).is_err())
        };
        match body.bounds().into_iter().any(is_far) {
            true => Err(Refused::TooWide(REACH)),
            false => Ok(base),
        }
    }

    fn encode_positions<'a>(&self, floats: &'a [[u8; 12]], base: [i32; 3]) -> Cow<'a, [u8]> {
        let of = |e: &[u8; 12]| {
            let position: [f32; 3] = bytemuck::cast(*e);
            let step = |a: usize| (position[a] * LATTICE as f32) as i32 - base[a] * LATTICE as i32;
            let steps = [0, 1, 2].map(|a| (step(a) as i16).to_le_bytes());
            [steps[0], steps[1], steps[2], [7, 7]]
        };
        Cow::Owned(floats.iter().flat_map(of).flatten().collect())
    }

    fn encode_normals<'a>(&self, floats: &'a [[u8; 12]]) -> Cow<'a, [u8]> {
        Cow::Borrowed(floats.as_flattened())
    }

    fn decode_positions(&self, bytes: &[u8], base: [f32; 3], out: &mut [[f32; 3]]) {
        for (out, e) in out.iter_mut().zip(bytes.as_chunks::<8>().0) {
            let step = |a: usize| f32::from(i16::from_le_bytes([e[2 * a], e[2 * a + 1]]));
            *out = std::array::from_fn(|a| base[a] + step(a) / LATTICE as f32);
        }
    }

    fn decode_normals(&self, bytes: &[u8], out: &mut [[f32; 3]]) {
        for (out, e) in out.iter_mut().zip(bytes.as_chunks::<12>().0) {
            *out = bytemuck::cast(*e);
        }
    }

    fn has_odd_filler(&self, positions: &[u8], _: &[u8]) -> [bool; 2] {
        let odd = |e: &[u8; 8]| e[6..] != [7, 7];
        [positions.as_chunks().0.iter().any(odd), false]
    }

    fn put_vertices(&self, bin: &mut Bin, data: &[u8], _: usize) {
        bin.plain(&turned(data));
    }

    fn decompress(&self, doc: &Document, bin: &[u8]) -> Result<Vec<Option<Vec<u8>>>, ReadError> {
        let vertices = doc.buffer_views.iter().map(|v| {
            let bytes = bin.get(v.byte_offset as usize..)?;
            let bytes = bytes.get(..v.byte_length as usize)?;
            (v.target == Some(ARRAY_BUFFER)).then(|| turned(bytes))
        });
        Ok(vertices.collect())
    }
}

/// A piece of some triangles with all corners their own, on the lattice of a macrocube of 64 cubes.
fn piece(cell: u64, triangles: u32, kind: Primitives) -> Piece {
    let vertices = 0..3 * triangles;
    let step = |i: u32, a: u32| (i * 7919 + a * 104_729 + cell as u32 * 31) % (64 * LATTICE);
    let corners: Vec<[u32; 3]> = (0..triangles)
        .map(|t| [0, 1, 2].map(|c| 3 * t + c))
        .collect();
    let mut indices = Vec::new();
    for triangle in &corners {
        match kind {
            Primitives::Strips => append_strip(&mut indices, triangle, 0),
            Primitives::Triangles => indices.extend(triangle),
        }
    }
    Piece {
        ids: PieceIds {
            cell,
            object: 1,
            surface: cell,
            triangles: triangles.into(),
        },
        name: name(cell, 1, false),
        colour: None,
        positions: (vertices.clone())
            .map(|i| [0, 1, 2].map(|a| coordinate(step(i, a) as i32)))
            .collect(),
        normals: vertices
            .map(|i| {
                if i % 2 == 0 {
                    [0.6, 0.0, -0.8]
                } else {
                    [0.0, 1.0, 0.0]
                }
            })
            .collect(),
        indices,
    }
}

fn contents(kind: Primitives) -> Contents {
    let pieces = vec![piece(1, 20, kind), piece(2, 1, kind), piece(9, 77, kind)];
    Contents::of_pieces(&Turned, pieces)
}

#[test]
fn a_codec_of_its_own_file_is_written_and_read() {
    let primitives = [Primitives::Strips, Primitives::Triangles];
    let layouts = [Layout::Nodes, Layout::Merged];
    let forms = primitives.into_iter().flat_map(|p| layouts.map(|l| (p, l)));
    for (primitives, layout) in forms {
        let form = Form {
            primitives,
            layout,
            ..Form::default()
        };
        let contents = contents(primitives);
        let (body, bytes) = contents.body().unwrap();
        let (body, floats) = (&body, &bytes[..]);
        let floats = FloatBody {
            body,
            bytes: floats,
        };
        let head = TileHead {
            codec: &Turned,
            ..TileHead::new(contents.matrix, form)
        };
        let file = tile_file(&head, [0; 3], floats, &contents.nodes).unwrap();
        let file = file.into_bytes();

        let tile = Tile::read_as(&file, &[CODECS[0], &Turned, CODECS[1]]).unwrap();
        assert_eq!(tile.is_merged(), layout == Layout::Merged);
        let unusual = tile.unusual();
        assert!(unusual.is_empty(), "{unusual:?}");
        let read = pieces(&tile, primitives).unwrap();
        assert_eq!(read.len(), contents.pieces.len());
        for (read, written) in read.iter().zip(&contents.pieces) {
            assert_eq!(read.ids, written.ids);
            assert_eq!(read.positions, written.positions);
            assert_eq!(read.normals, written.normals);
            assert_eq!(read.list(primitives), written.list(primitives));
        }
        let error = Tile::read(&file).unwrap_err();
        assert_eq!(error.place, "/extensionsRequired", "{error}");

        let far = encode(&head, [100; 3], floats, None).unwrap_err();
        assert_eq!(far, Refused::TooWide(REACH));
    }
}

#[test]
fn every_encoding_has_its_codec() {
    for codec in CODECS {
        assert_eq!(super::codec(codec.encoding()).encoding(), codec.encoding());
        let same = |other: &&&dyn TileCodec| other.extensions() == codec.extensions();
        assert_eq!(CODECS.iter().filter(same).count(), 1, "{codec:?}");
        // positions are read with what they are written with
        let floats = [[0u8; 12]; 3];
        let format = codec.vertices();
        let lengths = [
            codec.encode_positions(&floats, [0; 3]).len(),
            codec.encode_normals(&floats).len(),
        ];
        let strides = [format.position, format.normal].map(|e| 3 * e.stride as usize);
        assert_eq!(lengths, strides, "{codec:?}");
    }
}
