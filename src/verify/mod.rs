//! The verifier: rebuilds the whole surface from the tiles and proves that it has no hole.
//!
//! It is independent of the conversion: it knows glTF, the lattice, the manifest and the laws, and
//! shares no code with labelling, meshing or the making of strips.
//!
//! # What it proves
//! By the tiles alone:
//! 1. The index is sound, its paths stay inside the directory, and every file is there, of the stated
//!    size and checksum, and no other file is there.
//! 2. Each tile is a GLB laid out as [`crate::tile`] says, with the pieces, counts, box and ids of its
//!    entry. Its vertices lie on the lattice, strictly inside a lattice edge, one per edge; normals
//!    have unit length; triangles have an area and lie in one cube.
//! 3. The surface has no hole: every directed edge occurs once, and its reverse once in the same tile
//!    or in the tile across the plane; what is left lies on the volume's faces, and with caps nothing
//!    is left. Everything is compared as integers in units of voxel / 256.
//! 4. Surfaces are the connected components: each carries one surface, cell and object, no two share
//!    a (cell, object) pair, ids are 1 to n, and surfaces + 1 = objects + cells.
//! 5. The manifest's sums and the tables' measures are those of the rebuilt surface: areas and volumes of
//!    its triangles; boxes, numbers of voxels and their moments from the ends of runs, which are its
//!    vertices; Euler characteristics from the surfaces and the curves on the volume's faces; the rest by
//!    the formulas. Ids rise with the first voxel. Tiles carry the measures of the table.
//!
//! 6. Files hold nothing else: JSON has the members of its schema and no other, each once; all that a tile
//!    has is used; tables have their columns and numbers as they are written; a part has the cells that its
//!    condition keeps, in the colours that it states.
//!
//! 7. Levels of detail are as closed as the tiles, nothing is seen through between two of them, and their tree says
//!    what they are: see the module for levels.
//!
//! 8. A table of walls is that of the lines between vertices, within bounds that normals leave; cells have the neighbours
//!    and the thickness that follow from it: see the module for walls.
//!
//! Where cells are parts of components, components take the place of cells in these; see the module for parts.
//!
//! By the tiles alone, normals are proven to be of length 1 and no more, and the threshold not at all; and
//! a set that was made for another volume, with numbers to match, is sound. With the volume it proves in
//! addition:
//! 9. Every lattice edge with a sign change has exactly one vertex, at the place that its two samples
//!    give it, no other has one, and each cube has the triangles that its eight bits ask for. Triangles
//!    face from above to below at every vertex, so the bits that the mesh implies are the volume's. What
//!    was left out as dust are the components below the size, as many as stated, and no other.
//! 10. Normals are those of the volume's gradient, up to the rounding of tiles that store them in 8 bits.
//! 11. Areas and thicknesses of walls are those of its samples, up to what gradients in 32 bits leave.
//! 12. With the labels that cells were made by: each voxel below counts for the cell of its label, triangles begin at voxels
//!     of their cell, and no other cell has a row; openings are those between voxels of different labels; see the module
//!     for labels. Cells that were split are split again, and the same holds of these and of the curve.
//! 13. The source that the manifest states has the volume's format, size, type and byte order.
//!
//! # Memory
//! Tiles are streamed. What is kept: the open edges on the planes of one layer of macrocubes, the
//! surfaces that reach them, for each thread a tile, some that were read ahead with their entries in the index,
//! and the open edges of those that wait for the ones before them. Finished surfaces are sorted on disk.
//! With the volume, a row of macrocubes along x is in memory as well, with a voxel on each side. Of a set
//! whose dust was left out, two slices of the volume are labelled before: see the module for dust.

mod against;
mod ahead;
mod bodies;
mod closed;
mod code;
mod components;
mod contacts;
mod dust;
mod edges;
mod extras;
mod facets;
mod files;
mod first;
mod foreign;
mod geometry;
mod gradient;
mod index;
mod inside;
mod labels;
mod laws;
mod layout;
mod ledger;
mod levels;
mod marks;
mod openings;
mod paint;
mod parquet;
mod parts;
mod piece;
mod places;
mod region_edge;
mod report;
mod rim;
mod run;
mod seen;
mod selection;
mod slices;
mod source;
mod spill;
mod split;
mod sweep;
mod table_files;
mod tables;
mod tile;
mod voxels;
mod walls;

pub use code::Code;
pub use labels::LabelVolume;
pub use report::{Issue, Report, Severity};
pub use source::SourceVolume;

use crate::error::{Error, Result};
use crate::grid::Shape;
use crate::manifest::{Manifest, PartsBy};
use crate::progress::Progress;
use crate::volume::{RegionVoxels, Volume};
use labels::CellLabels;
use laws::Found;
use report::Issues;
use run::{Original, Run};
use std::path::Path;
use std::time::Instant;
use tile::Context;

/// Options of [`verify`].
#[derive(Clone, Copy)]
pub struct VerifyOptions<'a> {
    /// The volume that the tiles were made from, with its region filled and cropped as the manifest says.
    pub against: Option<&'a dyn Volume>,
    /// The labels that cells were made by, to be held against tiles and tables; with a volume alone.
    pub labels: Option<LabelVolume<'a>>,
    /// The voxels of its region of interest, cropped as it is; needed if the region is a mask.
    pub region: Option<&'a RegionVoxels>,
    /// The header of that volume before it is cropped, to be compared with the source that the manifest states.
    pub source: Option<&'a SourceVolume>,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
    /// Findings to keep; the report says how many were left out.
    pub max_issues: usize,
}

impl Default for VerifyOptions<'_> {
    fn default() -> Self {
        VerifyOptions {
            against: None,
            labels: None,
            region: None,
            source: None,
            threads: 0,
            max_issues: 1000,
        }
    }
}

/// Verifies the tile set in the directory `dir`. The report is the same for any number of threads,
/// but for its time and memory.
///
/// # Errors
/// [`Error::Io`] if there is no readable `index.json`, or the system refuses to list a directory, to
/// read the volume or to write temporary files; [`Error::Interrupted`] on request. Everything that
/// is wrong with the tile set itself is an issue in the report. [`Error::Usage`] if a part of a tile
/// set is to be compared with a volume, which has more surfaces, or if there are labels of a set that was made without, or
/// without a volume.
pub fn verify(dir: &Path, options: &VerifyOptions, progress: &dyn Progress) -> Result<Report> {
    let start = Instant::now();
    let root = match crate::store::is_remote(dir) {
        true => Ok(dir.to_path_buf()),
        false => dir.canonicalize(),
    };
    let root = root.map_err(|e| Error::io(dir, "open the tile set", e))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(crate::sys::simd::threads(options.threads))
        .build()
        .map_err(|e| Error::usage("--threads", options.threads.to_string(), e.to_string()))?;
    let mut issues = Issues::new(options.max_issues);
    let mut found = Found::default();
    if let Some(manifest) = index::manifest(&root, &mut issues)? {
        if options.against.is_some() && manifest.is_part() {
            return Err(Error::usage(
                "--against",
                "a part of a tile set, whose cells were selected",
                "the whole that it was selected from",
            ));
        }
        if options.labels.is_some() && options.against.is_none() {
            let expected = "them together with --against, whose voxels they are of";
            return Err(Error::usage("--labels", "labels alone", expected));
        }
        if let (Some(source), Some(volume)) = (options.source, options.against) {
            source::check(&manifest, source, &volume.header().placement, &mut issues);
        }
        foreign::foreign_files(&root, &manifest, &mut issues)?;
        if options.against.is_none() {
            found.unproved = unproved(&manifest);
        }
        let labelled = options.labels.is_some();
        let against = options.against.is_some();
        let cells = unproved_cells(&manifest, against, labelled);
        let walls = unproved_walls(&manifest, against, cells.is_none());
        found.unproved.extend(cells.into_iter().chain(walls));
        found.part = manifest.is_part();
        let cx = Context::new(&root, &manifest, options.region, options.max_issues);
        cx.edge.check(&manifest, &mut issues)?;
        let mut original = Original::new(options.against, &cx, progress, &mut issues)?;
        if let Some(original) = &mut original {
            original.labels = match options.labels {
                Some(labels) => CellLabels::find(labels, &manifest, progress, &mut issues)?,
                None => original.split_again(&cx, &pool, progress, &mut issues)?,
            };
        }
        let mut sweep = Run::new(&cx, &pool, progress).tiles(original, &mut found, &mut issues)?;
        found.counts.edges += sweep.matched;
        let walls = sweep.walls.take();
        laws::check(sweep.ledger, &cx, &pool, &mut found, &mut issues)?;
        // of voxels that are of other cells than said nothing more is
        if let Some(contacts) = found.contacts.take().filter(|_| !issues.any_error()) {
            contacts.check(&cx, &mut issues)?;
        }
        walls::check(walls, &cx, &mut issues)?;
        parquet::check(&cx, &mut issues);
        levels::check(&root, &manifest, progress, &mut issues)?;
    }
    Ok(report(found, issues, options, start))
}

/// What of an index only the volume can prove, besides the surface itself.
fn unproved(manifest: &Manifest) -> Vec<String> {
    let mask = manifest.region.as_ref().and_then(|r| match &r.shape {
        Shape::Mask { file, .. } => Some(format!(
            "which voxels the mask {file} holds, how many these are, and which cells and objects its edge cuts"
        )),
        Shape::Cylinder(_) => None,
    });
    let dust = manifest.dust.as_ref().map(|dust| {
        format!(
            "how many parts of fewer than {} voxels were left out",
            dust.min_voxels
        )
    });
    mask.into_iter().chain(dust).collect()
}

/// What of cells that are parts of components is not proved; `labelled` if the labels are there.
fn unproved_cells(manifest: &Manifest, against: bool, labelled: bool) -> Option<String> {
    const CELLS: &str = "which voxels each cell has, and where cells touch";
    let gapes = match manifest.may_gape() {
        true => {
            "; nor, of a part, what its tables say, and that the surface ends only where cells that were left out touched: verify the whole"
        }
        false => "",
    };
    match manifest.cells.as_ref()? {
        PartsBy::Labels { .. } if labelled => None,
        PartsBy::Labels { file, .. } => {
            Some(format!("that the labels of {file} say {CELLS}{gapes}"))
        }
        PartsBy::Split { .. } if against => None,
        PartsBy::Split { .. } => Some(format!("that the rule of necks says {CELLS}{gapes}")),
    }
}

/// What of walls is not proved; `cells_known` if it is known of each voxel which cell it is of.
fn unproved_walls(manifest: &Manifest, against: bool, cells_known: bool) -> Vec<String> {
    let known = manifest.tables.walls.is_some() && !manifest.may_gape();
    let all = [
        (
            manifest.is_part(),
            "of a part, more of walls than that its tables agree: verify the whole",
        ),
        (
            !manifest.is_part() && !against,
            "areas and thicknesses of walls, more closely than normals tell how slanted they are",
        ),
        (
            manifest.cells.is_some() && !cells_known,
            "of which cells walls are that end at voxels at which no triangle begins",
        ),
    ];
    let unproved = all.into_iter().filter(|(is, _)| known && *is);
    unproved.map(|(_, what)| what.to_owned()).collect()
}

fn report(found: Found, issues: Issues, options: &VerifyOptions, start: Instant) -> Report {
    let c = found.counts;
    Report {
        ok: !issues.any_error(),
        against: options.against.is_some(),
        labels: options.labels.is_some(),
        part: found.part,
        unproved: found.unproved,
        tiles: found.tiles,
        triangles: c.triangles,
        cap_triangles: c.cap_triangles,
        vertices: c.vertices,
        tile_vertices: c.tile_vertices,
        border_edges: c.border_edges,
        surfaces: found.ids[0],
        cells: found.ids[1],
        objects: found.ids[2],
        components: found.parts.map(|parts| parts.components),
        euler_characteristic: found.euler,
        volume6: c.volume6,
        bytes: c.bytes,
        issues_omitted: issues.omitted,
        issues: issues.list,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: report::peak_rss_bytes(),
    }
}
