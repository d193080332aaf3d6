//! What all stages of a conversion know.

use crate::convert::ConvertOptions;
use crate::convert::cells::metric;
use crate::convert::given_labels::Labels;
use crate::convert::layers::Layers;
use crate::convert::mesh::tile_writer::TileWriter;
use crate::convert::plan::Plan;
use crate::error::Result;
use crate::grid::LATTICE;
use crate::manifest::{
    Dust, FORMAT, FORMAT_VERSION, Generator, GridInfo, Manifest, PartsBy, SPLIT_VERSION, Source,
    Tables, Totals,
};
use crate::progress::Progress;
use crate::tile::{TileHead, WidestNodes};
use crate::volume::{RegionVoxels, Volume, Watch};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What all stages of a conversion know.
#[derive(Clone, Copy)]
pub struct Conversion<'a> {
    /// The input.
    pub volume: &'a dyn Volume,
    /// Its part that becomes tiles.
    pub grid: &'a dyn Volume,
    /// The region of interest of that part, if there is one.
    pub region: Option<&'a RegionVoxels>,
    /// What was asked for.
    pub options: &'a ConvertOptions,
    /// How the grid is cut, and what each stage may take of the memory.
    pub plan: &'a Plan,
    /// The layers that are made here: all, or those of a part.
    pub made: Layers,
    /// Saw all samples that were read.
    pub watch: &'a Watch,
    /// Hears what happens.
    pub progress: &'a dyn Progress,
}

/// What a conversion made.
#[derive(Serialize, Deserialize)]
pub struct Made {
    /// The manifest's sums.
    pub totals: Totals,
    /// Bytes of all files.
    pub bytes: u64,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// The boot of the system until whose end this counts, if it is not known to be on the disk.
    #[serde(default)]
    pub boot: Option<Vec<u8>>,
}

impl Conversion<'_> {
    /// Layers of macrocubes.
    pub fn layers(&self) -> u32 {
        self.plan.tiling.tiles()[2]
    }

    /// Layers of all sweeps over the volume.
    pub fn swept_layers(&self) -> u64 {
        let sweeps = if self.options.min_voxels > 1 { 4 } else { 2 };
        sweeps * u64::from(self.layers())
    }

    /// Refuses inputs that were changed since they were opened.
    ///
    /// # Errors
    /// [`crate::Error::InputChanged`].
    pub fn check_inputs(&self) -> Result<()> {
        self.options.input.check()?;
        self.options.labels.as_ref().map_or(Ok(()), Labels::check)
    }

    /// Writes tiles below the directory `work`.
    pub fn tile_writer(&self, work: &Path) -> TileWriter {
        let matrix = self.grid.header().placement.gltf_matrix();
        let head = TileHead::new(matrix, self.options.form());
        TileWriter {
            dir: work.to_path_buf(),
            widest: WidestNodes::new(&head),
            head,
            tiling: self.plan.tiling,
        }
    }

    /// What the manifest will say of what was asked for, before anything is made.
    pub fn asked(&self) -> Manifest {
        let min_voxels = self.options.min_voxels;
        let dust = Dust {
            min_voxels,
            objects: 0,
            object_voxels: 0,
            cells: 0,
            cell_voxels: 0,
        };
        Manifest {
            dust: (min_voxels > 1).then_some(dust),
            ..self.manifest(Totals::default())
        }
    }

    /// What the manifest says of cells that are parts of components; of what was found, how many voxels are in none, and how
    /// many cells there are at each ratio.
    pub fn stated_cells(&self, unlabelled: u64, curve: &[[u64; 2]]) -> Option<PartsBy> {
        let options = self.options;
        if let Some(labels) = &options.labels {
            return Some(PartsBy::Labels {
                file: labels.file.clone(),
                checksum: labels.checksum.clone(),
                unlabelled: Some(unlabelled).filter(|&n| n > 0),
            });
        }
        let rule = options.split?;
        let metric = metric(self.grid.header().placement.spacing);
        Some(PartsBy::Split {
            version: SPLIT_VERSION,
            ratio_permille: rule.ratio_permille,
            h_256: rule.h_256,
            min_radius_256: rule.min_radius_256,
            weights: metric.weights(),
            unit: metric.unit(),
            reach: metric.reach(),
            curve: curve.to_vec(),
        })
    }

    /// What the manifest says, but for its layers and what was left out.
    pub fn manifest(&self, totals: Totals) -> Manifest {
        let source = self.volume.header();
        let (options, plan) = (self.options, self.plan);
        let (dims, dtype) = match &options.source_filtered {
            Some(before) => (before.dims, before.dtype),
            None => (source.dims, source.dtype),
        };
        let placement = self.grid.header().placement;
        Manifest {
            format: FORMAT.into(),
            format_version: FORMAT_VERSION,
            generator: Generator {
                name: "alvis".into(),
                version: env!("CARGO_PKG_VERSION").into(),
            },
            source: Source {
                name: options.source_name.clone(),
                format: source.format.into(),
                dims,
                dtype,
                values: options.source_values.clone(),
                endian: source.endian,
                offset: options.source_offset,
                crop: options.crop.clone(),
                part: options.source_part.clone(),
                provenance: options.provenance,
            },
            filters: options.filters(),
            region: options.region.as_ref().map(|r| r.stated.clone()),
            grid: GridInfo {
                dims: plan.tiling.dims,
                macrocube: options.macrocube,
                tiles: plan.tiling.tiles(),
            },
            placement,
            table_unit: options.table_unit,
            threshold: options.threshold,
            ambiguous: options.ambiguous,
            cap: options.cap,
            cells: self.stated_cells(0, &[]),
            dust: None,
            primitives: options.primitives,
            encoding: options.encoding,
            layout: options.layout,
            lattice: LATTICE,
            transform: placement.gltf_matrix(),
            totals,
            layers: Vec::new(),
            tables: Tables::named(options.parquet).with(options.has_parts(), options.walls),
            selection: None,
            lod: None,
            checksum: None,
        }
    }
}
