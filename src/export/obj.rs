//! Wavefront OBJ: text. Vertices and normals have the same numbers, from 1; the triangles of a cell are
//! in the group of its name, `cell_17`, caps in `cap_object_3`. A group comes once for each tile with a
//! part of it, since the file is written tile by tile.

use super::format::{Coded, Counts, Writer};
use super::front::Numbers;
use super::sheet::Sheet;
use super::space::Space;
use crate::error::Result;
use crate::grid::Unit;
use std::io::Write;

/// Writes OBJ.
pub(super) struct Obj {
    pub space: Space,
    pub unit: Unit,
}

impl Obj {
    fn vertex(&self, point: [i32; 3], normal: [f32; 3], out: &mut Vec<u8>) -> std::io::Result<()> {
        let p = self.space.position(point);
        if self.space.single {
            let p = p.as_vec3();
            writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
        } else {
            writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
        }
        let [x, y, z] = self.space.normal(normal);
        writeln!(out, "vn {x:.4} {y:.4} {z:.4}")
    }
}

impl Writer for Obj {
    fn head(&self, _counts: &Counts) -> Vec<u8> {
        let version = env!("CARGO_PKG_VERSION");
        format!("# alvis {version}\n# unit {}\n", self.unit).into_bytes()
    }

    fn encode(&self, sheet: &Sheet, numbers: &Numbers) -> Coded {
        let [vertex, face] = self.sizes().map(|n| n as usize);
        // enough from the start: text that outgrows its buffer would be copied
        let mut coded = Coded {
            vertices: Vec::with_capacity(sheet.points.len() * vertex),
            faces: Vec::with_capacity(sheet.triangles.len() * face),
        };
        let new = (0..sheet.points.len()).filter(|&i| numbers.all[i] >= numbers.first);
        let write = || -> std::io::Result<()> {
            for i in new {
                self.vertex(sheet.points[i], sheet.normals[i], &mut coded.vertices)?;
            }
            for (piece, _, triangles) in sheet.parts().filter(|(_, _, t)| !t.is_empty()) {
                match piece.cell {
                    0 => writeln!(coded.faces, "g cap_object_{}", piece.object)?,
                    cell => writeln!(coded.faces, "g cell_{cell}")?,
                }
                for &t in triangles {
                    let corners = self.space.turned(t);
                    let [a, b, c] = corners.map(|i| numbers.all[i as usize] + 1);
                    writeln!(coded.faces, "f {a}//{a} {b}//{b} {c}//{c}")?;
                }
            }
            Ok(())
        };
        write().expect("memory takes what is written");
        coded
    }

    fn check(&self, _vertices: u64, _triangles: u64) -> Result<()> {
        Ok(())
    }

    fn sizes(&self) -> [u64; 2] {
        [if self.space.single { 72 } else { 100 }, 72]
    }

    fn apart(&self) -> bool {
        false
    }
}
