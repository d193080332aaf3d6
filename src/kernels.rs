//! The hot kernels one by one, for benchmarks: not part of the library's interface.
//!
//! A volume of bytes in memory is cut as a conversion cuts it; each function runs one kernel over all
//! of it on the calling thread.

use crate::error::Result;
use crate::grid::{Ambiguous, Placement, Tiling};
use crate::labels::{Bits, Labels, Runs, Span, Voxels, label_runs, sum_voxels};
use crate::manifest::Primitives;
use crate::measure::AreaScale;
use crate::strip::Stripifier;
use crate::surface::{
    BandView, Edges, MeshSettings, PieceIndex, TileBox, TileMesh, TileMesher, VertexAssignment,
    assign_vertices,
};
use crate::tile::Body;
use crate::volume::Volume;

/// The strip kernel, on triangles whose neighbours are known.
pub mod strip {
    pub use crate::strip::{NONE, STRIDE, Stripifier, Triangle};
}

/// A band of macrocubes.
#[derive(Default)]
struct Band {
    voxels: Voxels<u8>,
    bits: Bits,
    runs: Runs,
    labels: Labels,
}

/// A volume of bytes and what the kernels make of it.
pub struct Kernels {
    tiling: Tiling,
    threshold: u8,
    bands: Vec<Band>,
    mesher: TileMesher,
    meshes: Vec<TileMesh>,
    stripifier: Stripifier,
}

impl Kernels {
    /// Reads the volume and cuts it to macrocubes of 64 x 64 x 64. A voxel is above if it reaches
    /// `threshold`; all faces of the rule `separate`.
    ///
    /// # Errors
    /// Those of [`Volume::read_box`].
    pub fn new(volume: &dyn Volume, threshold: u8) -> Result<Self> {
        let tiling = Tiling {
            dims: volume.header().dims,
            macrocube: [64; 3],
        };
        let [_, ty, tz] = tiling.tiles();
        let mut bands = Vec::new();
        for (z, y) in (0..tz).flat_map(|z| (0..ty).map(move |y| (z, y))) {
            let (y, z) = (tiling.cubes(1, y), tiling.cubes(2, z));
            let span = Span {
                nx: tiling.dims.0[0],
                y: y.start..y.end + 1,
                z: z.start..z.end + 1,
            };
            let mut band = Band::default();
            band.voxels
                .load(volume, span.with_neighbours(tiling.dims))?;
            band.bits.span = span;
            bands.push(band);
        }
        let mut kernels = Kernels {
            tiling,
            threshold,
            bands,
            mesher: TileMesher::default(),
            meshes: Vec::new(),
            stripifier: Stripifier::default(),
        };
        kernels.classify();
        kernels.label();
        kernels.mesh();
        Ok(kernels)
    }

    /// Voxels of the volume.
    pub fn voxels(&self) -> u64 {
        self.tiling.dims.voxels()
    }

    /// Triangles of the surface.
    pub fn triangles(&self) -> u64 {
        self.meshes.iter().map(TileMesh::triangle_count).sum()
    }

    /// Samples to bits.
    #[inline(never)]
    pub fn classify(&mut self) {
        for band in &mut self.bands {
            let span = band.bits.span.clone();
            band.bits.classify(&band.voxels, span, Some(self.threshold));
        }
    }

    /// Bits to runs, objects and cells of each band with the sums of their voxels; returns their number.
    #[inline(never)]
    pub fn label(&mut self) -> usize {
        let mut components = 0;
        for band in &mut self.bands {
            band.runs.number(&band.bits);
            let rule = Ambiguous::Separate;
            let old = std::mem::take(&mut band.labels.of_run);
            let (of_run, count) = label_runs(&band.bits, &band.runs, rule, old);
            let (dims, place) = (self.tiling.dims, Placement::default());
            band.labels = sum_voxels(&band.bits, of_run, count, dims, &place);
            components += count;
        }
        components
    }

    /// Crossed edges to surfaces; returns the number of pieces.
    #[inline(never)]
    pub fn surfaces(&mut self) -> usize {
        let (mut edges, mut index) = (Edges::default(), PieceIndex::default());
        let (mut pieces, mut sheets) = (Vec::new(), VertexAssignment::default());
        let mut count = 0;
        for (view, tile) in tiles(&self.bands, self.tiling) {
            edges.find(view.bits, &tile);
            assign_vertices(&view, &tile, &edges, &mut index, &mut pieces, &mut sheets);
            count += pieces.len();
        }
        count
    }

    /// Bits and samples to vertices, normals and triangles, grouped by surface.
    #[inline(never)]
    pub fn mesh(&mut self) {
        let settings = MeshSettings {
            threshold: f64::from(self.threshold) - 0.5,
            rule: Ambiguous::Separate,
            cap: false,
            area: AreaScale::new([1.0; 3]),
        };
        let count = self.tiling.tiles().iter().product::<u32>() as usize;
        self.meshes.resize_with(count, TileMesh::default);
        for ((view, tile), mesh) in tiles(&self.bands, self.tiling).zip(&mut self.meshes) {
            let made = self.mesher.mesh(&view, &tile, &settings, mesh);
            made.expect("no piece is split");
        }
    }

    /// Triangles to strips; returns the number of index entries.
    #[inline(never)]
    pub fn strips(&mut self) -> usize {
        let (mut entries, mut strip) = (0, Vec::new());
        for TileMesh {
            pieces, triangles, ..
        } in &mut self.meshes
        {
            for piece in pieces {
                strip.clear();
                self.stripifier
                    .stripify(&mut triangles[piece.faces()], &mut strip);
                entries += strip.len();
            }
        }
        entries
    }

    /// Meshes to the bytes of tiles; returns their number.
    #[inline(never)]
    pub fn bodies(&mut self, primitives: Primitives) -> u64 {
        let mut bytes = 0;
        for mesh in &mut self.meshes {
            bytes += Body::write(mesh, primitives, &mut self.stripifier).bytes;
        }
        bytes
    }
}

/// All tiles with their bands.
fn tiles(bands: &[Band], tiling: Tiling) -> impl Iterator<Item = (BandView<'_, u8>, TileBox)> {
    let [tx, ty, _] = tiling.tiles();
    bands.iter().enumerate().flat_map(move |(i, band)| {
        (0..tx).map(move |x| {
            let view = BandView {
                voxels: &band.voxels,
                bits: &band.bits,
                runs: &band.runs,
                class_of_run: &band.labels.of_run,
                cells: None,
            };
            let grid = [x, i as u32 % ty, i as u32 / ty];
            (view, TileBox::of(tiling, grid))
        })
    })
}
