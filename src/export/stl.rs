//! STL, binary: 80 bytes of text, the number of triangles, then 50 bytes for each: its normal, its
//! corners, and two bytes that are 0 (3D Systems, *StereoLithography Interface Specification*, 1989).
//! Triangles share nothing, so nothing is sewn.

use super::format::{Coded, Counts, Writer, push_floats, too_large};
use super::front::Numbers;
use super::sheet::Sheet;
use super::space::Space;
use crate::error::Result;
use crate::grid::Unit;

/// Bytes of the text.
const TEXT: usize = 80;
/// Bytes of a triangle.
const FACE: usize = 50;

/// Writes STL.
pub(super) struct Stl {
    pub space: Space,
    pub unit: Unit,
}

impl Writer for Stl {
    fn head(&self, counts: &Counts) -> Vec<u8> {
        // readers take a file that begins with "solid" for text
        let text = format!(
            "binary STL, unit {}, alvis {}",
            self.unit,
            env!("CARGO_PKG_VERSION")
        );
        let mut head = text.into_bytes();
        head.resize(TEXT, b' ');
        head.extend((counts.triangles as u32).to_le_bytes());
        head
    }

    fn encode(&self, sheet: &Sheet, _numbers: &Numbers) -> Coded {
        let mut faces = Vec::with_capacity(sheet.triangles.len() * FACE);
        for &t in &sheet.triangles {
            let [a, b, c] = self.space.corners(sheet, t);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            for v in [normal, a, b, c] {
                push_floats(&mut faces, v.as_vec3().into());
            }
            faces.extend([0, 0]);
        }
        Coded {
            vertices: Vec::new(),
            faces,
        }
    }

    fn check(&self, _vertices: u64, triangles: u64) -> Result<()> {
        const MOST: u64 = u32::MAX as u64;
        if triangles <= MOST {
            return Ok(());
        }
        let found = format!("{triangles} triangles");
        Err(too_large(found, format!("at most {MOST} in an STL file")))
    }

    fn sizes(&self) -> [u64; 2] {
        [0, FACE as u64]
    }

    fn apart(&self) -> bool {
        false
    }

    fn sewn(&self) -> bool {
        false
    }

    fn warning(&self) -> Option<String> {
        (!self.space.single).then(|| {
            "STL has floats of 32 bits, which are too coarse for coordinates so large: triangles may \
             fold; a .ply or .obj is exact"
                .to_string()
        })
    }
}
