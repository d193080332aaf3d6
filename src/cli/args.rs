//! Groups of options that several commands share.

use super::filters::FilterArgs;
use super::parse;
use super::progress::Console;
use super::region::RegionArgs;
use crate::error::{Error, Result};
use crate::grid::Unit;
use crate::volume::{self, Dtype, Endian, Io, OpenOptions};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};

/// Options of every command that works.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "General")]
pub struct Common {
    /// Print one JSON object on stdout, and nothing else there
    #[arg(long)]
    pub json: bool,
    /// Say nothing unless something goes wrong: no progress, no summary
    #[arg(short, long)]
    pub quiet: bool,
    /// Worker threads, of which four per core are used at most, or 16 [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

impl Common {
    /// Sets up the worker threads and returns where progress is shown.
    pub fn start(&self) -> Console<'static> {
        self.set_threads();
        Console::new(self.quiet)
    }

    /// How many worker threads there are to be; 0 for one per core.
    pub fn worker_threads(&self) -> usize {
        self.threads
            .map_or(0, |n| crate::sys::simd::threads(usize::from(n)))
    }

    /// Sets up the worker threads.
    fn set_threads(&self) {
        if self.threads.is_some() {
            // fails only if workers run already, in a program that runs several commands: the
            // result is the same with any number of them
            let _ = rayon::ThreadPoolBuilder::new()
                .num_threads(self.worker_threads())
                .build_global();
        }
    }

    /// True if a summary for people is wanted on stdout.
    pub fn talks(&self) -> bool {
        !self.json && !self.quiet
    }
}

/// The long help of an input.
pub fn input_help() -> String {
    let first = "The volume: a file, a folder of slices, a Zarr, or slices as in `s%04d.tif`";
    format!("{first}\n\n{}", volume::input_help())
}

/// The parser of `--dtype`. NumPy's names do as well.
pub fn dtype_parser() -> impl TypedValueParser<Value = Dtype> {
    let names = Dtype::ALL.map(|d| PossibleValue::new(d.name()).alias(d.numpy_name()));
    PossibleValuesParser::new(names).try_map(|name| name.parse::<Dtype>())
}

/// Byte order, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum EndianArg {
    /// Least significant byte first
    Little,
    /// Most significant byte first
    Big,
}

/// Way of reading, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum IoArg {
    /// Map the file: if it is cut while it is read, the command ends; its pages count as memory
    Mmap,
    /// Read with system calls: safe on network drives and for files that others may change
    Read,
}

/// Kind of the tables' files, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TableFile {
    /// Text, which other commands read: always there
    Csv,
    /// Typed columns, beside that
    Parquet,
}

impl TableFile {
    /// Whether Parquet is among those that are asked for.
    ///
    /// # Errors
    /// [`Error::Usage`] if CSV is not.
    pub fn parquet(kinds: &[Self]) -> Result<bool> {
        match kinds.contains(&TableFile::Csv) {
            true => Ok(kinds.contains(&TableFile::Parquet)),
            false => Err(Error::usage(
                "--tables",
                "parquet",
                "csv, or csv,parquet: other commands read the tables as CSV",
            )),
        }
    }
}

/// What a file does not say of itself, or says wrongly. Flattened after a command's own options,
/// since clap puts those that follow below the same heading.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Input")]
pub struct InputOptions {
    /// Size in voxels (raw input)
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::dims)]
    pub dims: Option<[u64; 3]>,
    /// Type of the samples (raw input)
    #[arg(long, value_name = "TYPE", value_parser = dtype_parser())]
    pub dtype: Option<Dtype>,
    /// Byte order of the samples (raw input) [default: little]
    #[arg(long, value_name = "ORDER")]
    pub endian: Option<EndianArg>,
    /// Bytes before the first sample (raw input); bytes after the last one are then ignored
    #[arg(long, value_name = "N")]
    pub offset: Option<u64>,
    /// Size of a voxel, one number or three; overrides the file. Needs --unit where the file states none
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing, allow_negative_numbers = true)]
    pub spacing: Option<[f64; 3]>,
    /// Unit of --spacing: voxel, m, cm, mm, um or nm; without --spacing the file's sizes are converted to it
    #[arg(long, value_name = "UNIT", value_parser = parse::unit)]
    pub unit: Option<Unit>,
    /// Which series, if there are several: number, description or UID (DICOM), number or name (TIFF)
    #[arg(long, value_name = "NAME")]
    pub series: Option<String>,
    /// Interpolate slices at uneven steps (DICOM), or axes that are not at right angles, to a regular grid
    #[arg(long)]
    pub resample: bool,
    /// Which array, if there are several (HDF5, Zarr, VTK image data)
    #[arg(long, value_name = "PATH")]
    pub dataset: Option<String>,
    /// Which level of a pyramid, 0 the finest (OME-Zarr) [default: 0]
    #[arg(long, value_name = "N")]
    pub level: Option<u32>,
    /// Which channel, if there are several, from 0 on (TIFF, Zarr, HDF5, NIfTI)
    #[arg(long, value_name = "N")]
    pub channel: Option<u32>,
    /// Which time, if there are several, from 0 on (TIFF, Zarr, HDF5, NIfTI)
    #[arg(long, value_name = "N")]
    pub time: Option<u32>,
    /// How the file is read
    #[arg(long, value_name = "WAY", default_value = "read")]
    pub io: IoArg,
    #[command(flatten)]
    pub filters: FilterArgs,
    #[command(flatten)]
    pub region: RegionArgs,
}

impl InputOptions {
    /// The same for the library.
    pub fn options(&self) -> OpenOptions {
        OpenOptions {
            dims: self.dims,
            dtype: self.dtype,
            endian: self.endian.map(|e| match e {
                EndianArg::Little => Endian::Little,
                EndianArg::Big => Endian::Big,
            }),
            offset: self.offset,
            headerless: None,
            spacing: self.spacing,
            unit: self.unit,
            io: match self.io {
                IoArg::Mmap => Io::Mmap,
                IoArg::Read => Io::Read,
            },
            series: self.series.clone(),
            resample: self.resample,
            dataset: self.dataset.clone(),
            level: self.level,
            channel: self.channel,
            time: self.time,
        }
    }

    /// Refuses the options if there is no input that they could describe.
    pub fn refuse_without_volume(&self, input: &str) -> Result<()> {
        let given = [
            ("--dims", self.dims.is_some()),
            ("--dtype", self.dtype.is_some()),
            ("--endian", self.endian.is_some()),
            ("--offset", self.offset.is_some()),
            ("--spacing", self.spacing.is_some()),
            ("--unit", self.unit.is_some()),
            ("--series", self.series.is_some()),
            ("--resample", self.resample),
            ("--dataset", self.dataset.is_some()),
            ("--level", self.level.is_some()),
            ("--channel", self.channel.is_some()),
            ("--time", self.time.is_some()),
        ];
        let given = given.into_iter().filter(|(_, given)| *given);
        let others = self.filters.names().chain(self.region.names());
        let others = others.map(|name| format!("--{name}"));
        let mut given = given.map(|(option, _)| option.to_owned()).chain(others);
        match given.next() {
            Some(option) => Err(Error::usage(
                option,
                "it without a volume",
                format!("it together with {input}"),
            )),
            None => Ok(()),
        }
    }
}
