//! PLY, binary little endian (Turk, *The PLY Polygon File Format*, 1994).
//!
//! A vertex has position (float, or double where floats cannot tell lattice points apart) and normal
//! (float); a face has its three vertices, and the ids of its cell (0 for a cap) and object.

use super::format::{Coded, Counts, Writer, push_floats};
use super::front::Numbers;
use super::sheet::Sheet;
use super::space::Space;
use crate::error::{Error, Result};
use crate::grid::Unit;
use std::fmt::Write;

/// Bytes of a face: a count, three vertices, two ids.
const FACE: usize = 21;
/// Largest number of an int.
const MOST: u64 = i32::MAX as u64;
/// Digits of the largest count.
const DIGITS: usize = 10;

/// Writes PLY.
pub(super) struct Ply {
    pub space: Space,
    pub unit: Unit,
    /// The largest id of a cell or object.
    pub largest_id: u64,
}

impl Writer for Ply {
    fn head(&self, counts: &Counts) -> Vec<u8> {
        let Counts {
            vertices,
            triangles,
            ..
        } = counts;
        // spaces in a comment make up for short counts
        let digits = vertices.to_string().len() + triangles.to_string().len();
        let fill = " ".repeat((2 * DIGITS).saturating_sub(digits));
        let mut text = format!(
            "ply\nformat binary_little_endian 1.0\ncomment alvis {}{fill}\ncomment unit {}\n\
             comment cell and object are ids, cell 0 is a cap\nelement vertex {vertices}\n",
            env!("CARGO_PKG_VERSION"),
            self.unit,
        );
        let kind = if self.space.single { "float" } else { "double" };
        for name in ["x", "y", "z"] {
            let _ = writeln!(text, "property {kind} {name}");
        }
        let id = match self.largest_id > MOST {
            true => "uint",
            false => "int",
        };
        let _ = write!(
            text,
            "property float nx\nproperty float ny\nproperty float nz\nelement face {triangles}\n\
             property list uchar int vertex_indices\nproperty {id} cell\nproperty {id} object\n\
             end_header\n"
        );
        text.into_bytes()
    }

    fn encode(&self, sheet: &Sheet, numbers: &Numbers) -> Coded {
        let mut coded = Coded {
            vertices: Vec::with_capacity(sheet.points.len() * self.sizes()[0] as usize),
            faces: Vec::with_capacity(sheet.triangles.len() * FACE),
        };
        let new = (0..sheet.points.len()).filter(|&i| numbers.all[i] >= numbers.first);
        for i in new {
            let p = self.space.position(sheet.points[i]);
            if self.space.single {
                push_floats(&mut coded.vertices, p.as_vec3().into());
            } else {
                let bytes = p.to_array().map(f64::to_le_bytes);
                coded.vertices.extend(bytes.as_flattened());
            }
            push_floats(&mut coded.vertices, self.space.normal(sheet.normals[i]));
        }
        for (piece, _, triangles) in sheet.parts() {
            let ids = [piece.cell, piece.object].map(|id| (id as u32).to_le_bytes());
            for &t in triangles {
                let corners = self.space.turned(t).map(|i| numbers.all[i as usize] as u32);
                coded.faces.push(3);
                coded
                    .faces
                    .extend(corners.map(u32::to_le_bytes).as_flattened());
                coded.faces.extend(ids.as_flattened());
            }
        }
        coded
    }

    fn check(&self, vertices: u64, triangles: u64) -> Result<()> {
        let ids_fit = self.largest_id <= u64::from(u32::MAX);
        if vertices.max(triangles) <= MOST && ids_fit {
            return Ok(());
        }
        let found = format!(
            "{vertices} vertices, {triangles} triangles and ids up to {}",
            self.largest_id
        );
        let expected = format!(
            "numbers up to {MOST}, and ids up to {}, in a PLY file",
            u32::MAX
        );
        Err(Error::usage("FILE", found, expected)
            .with_hint("choose cells with --where, simplify with --simplify, or write an .obj"))
    }

    fn sizes(&self) -> [u64; 2] {
        [if self.space.single { 24 } else { 36 }, FACE as u64]
    }

    fn apart(&self) -> bool {
        true
    }
}
