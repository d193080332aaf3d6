//! What a conversion is asked for, and what it reports.

use crate::convert::given_labels::Labels;
use crate::error::{Error, Result};
use crate::grid::{
    Ambiguous, Crop, Fill, Filter, Filtered, Part, Placement, Provenance, Region, Shape, Unit,
};
use crate::manifest::{Encoding, Form, Layout, Primitives, Totals};
use crate::split::NeckRule;
use crate::volume::{RegionVoxels, Stamp};
use serde::Serialize;

/// The options of [`crate::convert::convert`].
#[derive(Debug, Clone)]
pub struct ConvertOptions {
    /// The iso value T: a voxel v is above iff v >= T. Finite.
    pub threshold: f64,
    /// Cubes per macrocube and axis; at least 1.
    pub macrocube: [u32; 3],
    /// Limit of peak resident memory in bytes.
    pub memory: u64,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
    /// Which voxels an ambiguous face joins.
    pub ambiguous: Ambiguous,
    /// Close the surface half a voxel outside the volume's faces.
    pub cap: bool,
    /// Leave out objects and cells of fewer voxels, filled with the other phase; 0 or 1 for none.
    pub min_voxels: u64,
    /// The part of the volume to convert.
    pub crop: Option<Crop>,
    /// Strips or triangle lists.
    pub primitives: Primitives,
    /// How tiles store numbers. Other than floats, macrocubes have at most 254 cubes along each axis.
    pub encoding: Encoding,
    /// Which tiles have one mesh for all their pieces.
    pub layout: Layout,
    /// Unit of lengths in tables and in the measures that tiles carry; that of the volume if absent. The volume must
    /// be in a unit of length then.
    pub table_unit: Option<Unit>,
    /// Write the tables as Parquet, too.
    pub parquet: bool,
    /// Keep the samples beside the surface on the disk of the output, and do not read them from the volume again.
    pub keep_samples: bool,
    /// Replace a tile set that is in the output directory.
    pub force: bool,
    /// Go on with a conversion into the output directory that was interrupted, if there is one: it
    /// must have had the same input and options, but for `memory`, `threads` and `force`. If the
    /// directory holds the tile set that is asked for, whole and younger than the input, nothing is done; what was begun
    /// in place of it goes on if `force` is set, and is removed if not.
    /// Without this an interrupted conversion is begun anew if `force` is set, and refused if not.
    pub resume: bool,
    /// What tells the input from any other, such as its size and the time of its last change, see
    /// [`crate::volume::stamp`]. It does not go into the output: `resume` compares it with what an interrupted
    /// conversion kept, and takes no tile set for whole that is older than the input.
    pub input: Stamp,
    /// The input's name for the manifest, without its directory.
    pub source_name: String,
    /// Bytes before the first sample of a raw file, for the manifest.
    pub source_offset: u64,
    /// What was asked for of an input that may hold several volumes, for the manifest.
    pub source_part: Part,
    /// How the values follow from what the file stores, for the manifest.
    pub source_values: Option<String>,
    /// They are other numbers than the stored ones.
    pub source_scaled: bool,
    /// The filters that the volume has been through, and what it was before, for the manifest; absent if none.
    pub source_filtered: Option<Filtered>,
    /// The cells of all voxels of the volume before the crop, where they are not to be the components; see
    /// [`PartsBy::Labels`](crate::manifest::PartsBy::Labels).
    pub labels: Option<Labels>,
    /// Split components of voxels below into cells at their necks by this rule; not with labels.
    pub split: Option<NeckRule>,
    /// Find the walls between cells: their area and thickness, and the neighbours of each cell.
    pub walls: bool,
    /// The region of interest; all of the volume if absent.
    pub region: Option<RegionOfInterest>,
    /// Where spacing, unit and origin came from, for the manifest.
    pub provenance: Provenance,
}

/// The region of interest of a conversion.
#[derive(Debug, Clone)]
pub struct RegionOfInterest {
    /// As the manifest states it: its count of voxels is of what is left after the crop.
    pub stated: Region,
    /// Its voxels in the volume before the crop.
    pub voxels: RegionVoxels,
}

impl RegionOfInterest {
    /// Of a conversion of this part of a volume.
    ///
    /// # Errors
    /// Those of [`RegionVoxels::cropped`]; [`Error::Usage`] if the crop holds no voxel of it.
    pub fn new(
        shape: Shape,
        voxels: RegionVoxels,
        crop: Option<&Crop>,
        fill: Fill,
        fill_value: f64,
    ) -> Result<Self> {
        let count = voxels.cropped(crop)?.count()?;
        if count == 0 {
            let found = format!("{shape}, of which nothing lies in the crop");
            return Err(Error::usage("--roi", found, "a region that meets the crop"));
        }
        let stated = Region {
            shape,
            fill,
            fill_value,
            voxels: count,
        };
        Ok(RegionOfInterest { stated, voxels })
    }
}

impl ConvertOptions {
    /// The filters that the volume has been through.
    pub(crate) fn filters(&self) -> Vec<Filter> {
        let filtered = self.source_filtered.as_ref();
        filtered.map_or_else(Vec::new, |f| f.filters.clone())
    }

    /// True if cells are parts of components.
    pub(crate) fn has_parts(&self) -> bool {
        self.labels.is_some() || self.split.is_some()
    }

    /// The placement of a volume in the unit of tables and measures.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if the volume is in no unit of length and they are to be, or the other way round.
    pub fn measured(&self, place: &Placement) -> Result<Placement> {
        place.in_unit(self.table_unit.unwrap_or(place.unit))
    }

    /// Refuses what no volume in this place can be converted with.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub(crate) fn check(&self, place: &Placement) -> Result<()> {
        self.measured(place)?;
        if !self.threshold.is_finite() {
            return Err(Error::usage(
                "--threshold",
                self.threshold.to_string(),
                "a finite number",
            ));
        }
        if self.labels.is_some() && self.split.is_some() {
            return Err(Error::usage(
                "--split",
                "it together with --labels",
                "one of them: cells are those of the labels, or split at necks",
            ));
        }
        if let Some(rule) = &self.split {
            rule.check()?;
        }
        if self.macrocube.contains(&0) {
            return Err(Error::usage(
                "--macrocube",
                format!("{:?}", self.macrocube),
                "at least 1 cube along each axis",
            ));
        }
        Ok(())
    }

    /// Primitives, encoding and layout.
    pub fn form(&self) -> Form {
        Form {
            primitives: self.primitives,
            encoding: self.encoding,
            layout: self.layout,
        }
    }
}

impl Default for ConvertOptions {
    fn default() -> Self {
        ConvertOptions {
            threshold: 0.0,
            macrocube: [64; 3],
            memory: 1 << 30,
            threads: 0,
            ambiguous: Ambiguous::Separate,
            cap: false,
            min_voxels: 0,
            crop: None,
            primitives: Primitives::Strips,
            encoding: Encoding::default(),
            layout: Layout::Auto,
            table_unit: None,
            parquet: false,
            keep_samples: false,
            force: false,
            resume: false,
            input: Stamp::default(),
            source_name: String::new(),
            source_offset: 0,
            source_part: Part::default(),
            source_values: None,
            source_scaled: false,
            source_filtered: None,
            labels: None,
            split: None,
            walls: false,
            region: None,
            provenance: Provenance::default(),
        }
    }
}

/// What a conversion made; the command prints it with `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConvertReport {
    /// The manifest's sums.
    #[serde(flatten)]
    pub totals: Totals,
    /// Voxels of at least this are above.
    pub threshold: f64,
    /// What was done to the samples before they were compared with the threshold; absent if nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<Filter>,
    /// The region of interest; absent if that is all of the grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// Bytes written below the output directory, index and tables included.
    pub bytes_written: u64,
    /// Wall time.
    pub seconds: f64,
    /// Largest resident set of the process so far, in bytes.
    pub peak_rss_bytes: u64,
    /// Layers that were swept before, in a conversion that was resumed; those of each of the three
    /// sweeps if `min_voxels` is above 1.
    pub resumed_layers: u64,
    /// Layers of the index that were done before, in a conversion that was resumed.
    pub resumed_index_layers: u32,
    /// Things the user should know, such as a threshold outside the data's range.
    pub warnings: Vec<String>,
}
