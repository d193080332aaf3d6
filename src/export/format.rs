//! What the file formats have in common.

use super::choice::whole;
use super::front::Numbers;
use super::sheet::Sheet;
use super::{glb, obj, ply, space::Space, stl};
use crate::error::{Error, Result};
use crate::manifest::Manifest;
use serde::Serialize;
use std::path::Path;

/// A file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Binary glTF 2.0.
    Glb,
    /// Stanford's polygon file format, binary little endian.
    Ply,
    /// Stereolithography, binary.
    Stl,
    /// Wavefront, text.
    Obj,
}

impl Format {
    /// The format by the end of a file's name.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is none of these.
    pub fn of(path: &Path) -> Result<Format> {
        let end = path.extension().unwrap_or_default().to_ascii_lowercase();
        match end.to_str() {
            Some("glb") => Ok(Format::Glb),
            Some("ply") => Ok(Format::Ply),
            Some("stl") => Ok(Format::Stl),
            Some("obj") => Ok(Format::Obj),
            _ => Err(Error::usage(
                "FILE",
                path.display().to_string(),
                "a name that ends in .glb, .ply, .stl or .obj",
            )),
        }
    }

    /// The writer of this format, for ids of cells up to `largest_cell`.
    pub(super) fn writer(self, manifest: &Manifest, largest_cell: u64) -> Box<dyn Writer> {
        let space = Space::new(&manifest.placement, manifest.grid.dims);
        let unit = manifest.placement.unit;
        let objects = whole(manifest).objects;
        match self {
            Format::Glb => Box::new(glb::Glb::new(manifest, largest_cell)),
            Format::Ply => Box::new(ply::Ply {
                space,
                unit,
                largest_id: largest_cell.max(objects),
            }),
            Format::Stl => Box::new(stl::Stl { space, unit }),
            Format::Obj => Box::new(obj::Obj { space, unit }),
        }
    }
}

/// What a head states.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub vertices: u64,
    pub triangles: u64,
    /// Smallest and largest coordinates in lattice steps.
    pub bounds: [[i32; 3]; 2],
}

/// A tile as it stands in the file.
#[derive(Debug, Default)]
pub(super) struct Coded {
    pub vertices: Vec<u8>,
    pub faces: Vec<u8>,
}

/// Writes a format.
pub(super) trait Writer: Sync {
    /// The bytes before the first vertex; as many for all counts within the limits.
    fn head(&self, counts: &Counts) -> Vec<u8>;

    /// A tile's vertices that are new with it, and its triangles.
    fn encode(&self, sheet: &Sheet, numbers: &Numbers) -> Coded;

    /// The most vertices and triangles for which the format has room.
    ///
    /// # Errors
    /// [`Error::Usage`] that says what else to do if these are more.
    fn check(&self, vertices: u64, triangles: u64) -> Result<()>;

    /// Bytes of a vertex and of a triangle; the largest where they differ.
    fn sizes(&self) -> [u64; 2];

    /// True if all vertices come before the first triangle.
    fn apart(&self) -> bool;

    /// True if triangles name their vertices by numbers.
    fn sewn(&self) -> bool {
        true
    }

    /// What the user should know, if anything.
    fn warning(&self) -> Option<String> {
        None
    }
}

/// The refusal of a file that would be too large.
pub(super) fn too_large(found: String, expected: String) -> Error {
    Error::usage("FILE", found, expected).with_hint(
        "choose cells with --where, simplify with --simplify, or write a .ply, which may be larger",
    )
}

/// Adds the little-endian bytes of floats.
pub(super) fn push_floats(out: &mut Vec<u8>, values: [f32; 3]) {
    out.extend(values.map(f32::to_le_bytes).as_flattened());
}
