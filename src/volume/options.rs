//! What a user says of an input, and what opening it gives.

use super::{Dtype, Endian, Volume};
use crate::error::{Error, Result};
use crate::grid::{Filtered, Part, Provenance, Unit};
use std::path::PathBuf;

/// How uncompressed files are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Io {
    /// A memory map. The file must not be changed or cut while it is read, or the process may die;
    /// its pages count as resident memory until they are released.
    Mmap,
    /// Positioned reads: at least as fast, safe for files on network drives or that others may
    /// change, and nothing but the buffers counts as memory.
    #[default]
    Read,
}

/// What a file without a header does not say of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Headerless {
    /// Size in voxels, x first.
    pub dims: [u64; 3],
    /// Sample type.
    pub dtype: Dtype,
    /// Byte order.
    pub endian: Endian,
    /// Bytes before the first sample; 0 if the samples are all there is.
    pub offset: u64,
    /// True if nobody has said that it has no header: then it is none of those that are known.
    pub supposed: bool,
}

impl OpenOptions {
    /// The same, with what these options do not ask for as `part` has it.
    pub fn or_part(mut self, part: &Part) -> OpenOptions {
        self.series = self.series.or_else(|| part.series.clone());
        self.resample |= part.resample;
        self.dataset = self.dataset.or_else(|| part.dataset.clone());
        self.level = self.level.or(part.level);
        self.channel = self.channel.or(part.channel);
        self.time = self.time.or(part.time);
        self
    }

    /// An option that says something of a file, or how it is read, if one is given.
    pub(crate) fn of_files(&self) -> Option<&'static str> {
        let given = [
            ("--dims", self.dims.is_some()),
            ("--dtype", self.dtype.is_some()),
            ("--endian", self.endian.is_some()),
            ("--offset", self.offset.is_some()),
            ("--io", self.io != Io::default()),
        ];
        let choices = Choice::ALL.map(|choice| (choice.option(), choice.is_given(self)));
        let mut all = given.into_iter().chain(choices);
        all.find_map(|(option, given)| given.then_some(option))
    }

    /// What these ask for of an input that may hold several volumes.
    pub(super) fn part(&self) -> Part {
        Part {
            series: self.series.clone(),
            resample: self.resample,
            dataset: self.dataset.clone(),
            level: self.level,
            channel: self.channel,
            time: self.time,
        }
    }

    /// The same for an input that has no header.
    pub fn of_headerless(&self) -> OpenOptions {
        let mut options = self.clone();
        if let Some(raw) = self.headerless {
            options.dims = options.dims.or(Some(raw.dims));
            options.dtype = options.dtype.or(Some(raw.dtype));
            options.endian = options.endian.or(Some(raw.endian));
            // 0 is not passed on: it would allow any bytes after the samples
            options.offset = options.offset.or(Some(raw.offset).filter(|&n| n > 0));
        }
        options
    }
}

/// What the user says of the input.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Size in voxels, x first; needed for headerless raw files.
    pub dims: Option<[u64; 3]>,
    /// Sample type; needed for headerless raw files.
    pub dtype: Option<Dtype>,
    /// Byte order; little where neither the file nor the option says.
    pub endian: Option<Endian>,
    /// Bytes before the first sample of a headerless raw file. If given, even as 0, bytes behind the
    /// samples are ignored; otherwise the file's length must be exact.
    pub offset: Option<u64>,
    /// What an input without a header is, where the options above do not say.
    pub headerless: Option<Headerless>,
    /// Overrides the spacing of the file. Needs `unit` where the file states none.
    pub spacing: Option<[f64; 3]>,
    /// The unit of `spacing`. Without that, what the file states is converted to it; where the file states a
    /// spacing without a unit, this is its unit.
    pub unit: Option<Unit>,
    /// How uncompressed files are read.
    pub io: Io,
    /// Which of several series: its number, description or UID (DICOM), its number from 0 on or its name (TIFF,
    /// OME-TIFF).
    pub series: Option<String>,
    /// True if slices that do not make a regular grid, or axes that are not at right angles, are to be interpolated
    /// to one (DICOM, and formats that state axes).
    pub resample: bool,
    /// Which array of a file or group of several (HDF5, Zarr, VTK image data), by its path or name.
    pub dataset: Option<String>,
    /// Which level of a pyramid, 0 the finest (OME-Zarr); the finest if absent.
    pub level: Option<u32>,
    /// Which of several channels, from 0 on.
    pub channel: Option<u32>,
    /// Which of several times, from 0 on.
    pub time: Option<u32>,
}

/// An opened volume and what the manifest says of its source.
pub struct Opened {
    /// The samples.
    pub volume: Box<dyn Volume>,
    /// The filters that they went through, and what the volume was before; absent if there are none.
    pub filtered: Option<Filtered>,
    /// Where spacing, unit and origin came from.
    pub provenance: Provenance,
    /// The file's name without its directory.
    pub name: String,
    /// Bytes before the first sample of a headerless raw file; 0 for files with a header.
    pub offset: u64,
    /// What was asked for of an input that may hold several volumes.
    pub part: Part,
    /// Files that the samples lie in, where these are others than the one that was opened, or of a
    /// folder those that were taken; may be empty if what was opened says it all.
    pub files: Vec<PathBuf>,
    /// How the values follow from what the file stores, where it states a scale or samples that stand for nothing.
    pub values: Option<String>,
    /// They are other numbers than the stored ones: measured values, and no labels.
    pub scaled: bool,
    /// What a user should know of the input that its header does not show.
    pub notes: Vec<String>,
    /// What may make numbers wrong unless the user does something about it.
    pub warnings: Vec<String>,
}

impl std::str::FromStr for Io {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "mmap" => Ok(Io::Mmap),
            "read" => Ok(Io::Read),
            _ => Err(Error::usage("--io", text, "mmap or read")),
        }
    }
}

impl std::fmt::Debug for Opened {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Opened")
            .field("header", self.volume.header())
            .field("filtered", &self.filtered)
            .field("provenance", &self.provenance)
            .field("name", &self.name)
            .field("offset", &self.offset)
            .field("notes", &self.notes)
            .field("warnings", &self.warnings)
            .finish()
    }
}

/// An option that chooses a part of an input that may hold several volumes, or how it is read, and that not every
/// format takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Choice {
    Series,
    Resample,
    Dataset,
    Level,
    Channel,
    Time,
}

impl Choice {
    /// All, in the order of the help.
    pub(crate) const ALL: [Choice; 6] = [
        Choice::Series,
        Choice::Resample,
        Choice::Dataset,
        Choice::Level,
        Choice::Channel,
        Choice::Time,
    ];

    /// As a user types it.
    pub(crate) fn option(self) -> &'static str {
        match self {
            Choice::Series => "--series",
            Choice::Resample => "--resample",
            Choice::Dataset => "--dataset",
            Choice::Level => "--level",
            Choice::Channel => "--channel",
            Choice::Time => "--time",
        }
    }

    /// True if the option is given.
    pub(crate) fn is_given(self, options: &OpenOptions) -> bool {
        match self {
            Choice::Series => options.series.is_some(),
            Choice::Resample => options.resample,
            Choice::Dataset => options.dataset.is_some(),
            Choice::Level => options.level.is_some(),
            Choice::Channel => options.channel.is_some(),
            Choice::Time => options.time.is_some(),
        }
    }
}
