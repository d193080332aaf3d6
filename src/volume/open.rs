//! Opening a volume: the format by its content, the options that complete or override the header.

use super::{Dtype, Endian, Header, Volume};
use crate::error::{Error, Result};
use crate::grid::{Dims, Part, Placement, Provenance, Unit};
use crate::volume::adapters::mirror::Mirrored;
use crate::volume::adapters::resample;
use crate::volume::adapters::resample::{Grid, Resampled};
use crate::volume::adapters::values::Valued;
use crate::volume::formats::{
    archive, dicom, folder, foreign, hdf5, metaimage, nifti, npy, nrrd, tiff, vti,
};
use crate::volume::io::blob::Blob;
use crate::volume::io::descriptor::{self, Data, Encoding, Samples, Start, VolumeDescriptor};
use crate::volume::io::file::FileVolume;
use crate::volume::io::paged::PagedVolume;
use crate::volume::stated::{place, warning};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

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

    /// What these ask for of an input that may hold several volumes.
    fn part(&self) -> Part {
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
            .field("provenance", &self.provenance)
            .field("name", &self.name)
            .field("offset", &self.offset)
            .field("notes", &self.notes)
            .field("warnings", &self.warnings)
            .finish()
    }
}

/// Opens a volume. NRRD, MetaImage, TIFF, NIfTI, NumPy, VTK image data and zip files are recognised by their content, whatever
/// their name, as are DICOM and HDF5; everything else is headerless raw (or raw packed by gzip, with a name that ends in
/// `.gz`), whose size and type the options must give. A folder is a Zarr, a DICOM series, or a
/// stack of TIFF or PNG slices, or, if size and type are given, of headerless ones. A name with a
/// printf number, as `slice_%04d.tif`, stands for the slices of such names.
///
/// # Errors
/// [`Error::Usage`] if an option is missing, impossible or contradicts the file's header;
/// [`Error::Io`], [`Error::Format`] or [`Error::Unsupported`] if the file or its data files cannot
/// be read as what they say they are.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Opened> {
    let mut recipe = parsed(path, options)?;
    refuse_unused(recipe.format, options)?;
    let offset = match &recipe.samples {
        Samples::Files(Data {
            start: Start::At { bytes, .. },
            ..
        }) if recipe.format == "raw" => *bytes,
        _ => 0,
    };
    let files = match &recipe.samples {
        Samples::Files(data) => data.files.clone(),
        Samples::Pages(pages) => pages.files(),
        _ => Vec::new(),
    };
    let (placement, provenance) = place::place(path, &recipe, options)?;
    let grid = regular(path, &mut recipe, placement)?;
    let header = Header {
        format: recipe.format,
        dims: recipe.dims,
        dtype: recipe.dtype,
        endian: recipe.endian.unwrap_or_default(),
        placement,
    };
    let mut notes = std::mem::take(&mut recipe.notes);
    let warnings = std::mem::take(&mut recipe.warnings);
    let warnings = warning::texts(warnings, options.spacing.is_some());
    // behind the samples of a TIFF are its directories, and behind those of one of several times another
    let part = options.time.is_some() || options.channel.is_some();
    if !matches!(recipe.format, "raw" | "tiff")
        && !part
        && let Samples::Files(data) = &recipe.samples
    {
        notes.extend(descriptor::more_than_described(&header, data)?);
    }
    let values = recipe.values.as_ref().map(|values| values.to_string());
    let values = values.or(recipe.applied.take());
    let scaled = match &recipe.values {
        Some(values) => values.is_scaled(),
        None => values.is_some(),
    };
    Ok(Opened {
        volume: match grid {
            Some((grid, placement)) => {
                let volume = volume(header, recipe, options.io)?;
                Box::new(Resampled::new(volume, grid, placement)?)
            }
            None => volume(header, recipe, options.io)?,
        },
        provenance,
        name: file_name(path),
        offset,
        part: options.part(),
        files,
        values,
        scaled,
        notes,
        warnings,
    })
}

/// The grid that samples are interpolated to, with its placement: that of the recipe, or one at right angles where the
/// axes are not.
fn regular(
    path: &Path,
    recipe: &mut VolumeDescriptor,
    placement: Placement,
) -> Result<Option<(Grid, Placement)>> {
    if let Some(grid) = recipe.grid.take() {
        return Ok(Some((grid, placement)));
    }
    if placement.shear().is_none() {
        return Ok(None);
    }
    let dtype = match &recipe.values {
        Some(values) => values.dtype(recipe.dtype),
        None => recipe.dtype,
    };
    let grid = Grid::upright(path, placement, recipe.dims, resample::fill(dtype))?;
    let note = grid.note("its axes are not at right angles");
    recipe.notes.push(note);
    let placement = grid.placement;
    Ok(Some((grid, placement)))
}

/// What the parser of the format finds, completed by the options.
fn parsed(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let slices = match path.is_dir() {
        true => Some(folder::parse(path, options)),
        false if path.exists() => None,
        false => folder::numbered(path, options),
    };
    let Some(recipe) = slices else {
        return recognise(path, &Blob::file(path)?.head(4096)?, options);
    };
    let mut recipe = recipe?;
    if recipe.format != "raw" {
        complete(path, &mut recipe, options)?;
    }
    Ok(recipe)
}

/// The samples of a recipe as the values that they stand for, the right way round.
fn volume(header: Header, recipe: VolumeDescriptor, io: Io) -> Result<Box<dyn Volume>> {
    let swap = header.endian != Endian::NATIVE;
    let volume: Box<dyn Volume> = match recipe.samples {
        Samples::Files(data) => {
            let source = descriptor::source(&header, &data, io)?;
            Box::new(FileVolume::new(header, source, swap))
        }
        Samples::Bytes(source) => Box::new(FileVolume::new(header, source, swap)),
        Samples::Pages(pages) => Box::new(PagedVolume::new(header, pages)),
        #[cfg(any(feature = "hdf5", feature = "zarr"))]
        Samples::Chunks(chunks) => Box::new(crate::volume::io::chunked::ChunkedVolume::new(
            header, chunks,
        )),
    };
    let volume = match recipe.mirrored {
        [false, false] => volume,
        turned => Box::new(Mirrored::new(volume, turned)),
    };
    Ok(match recipe.values {
        Some(values) => Box::new(Valued::new(volume, values)),
        None => volume,
    })
}

/// The name of a file or folder without its directory; of one that is given as `.` or `..` the name that it has.
pub fn file_name(path: &Path) -> String {
    let own = path.file_name().map(OsStr::to_owned);
    let real = || path.canonicalize().ok()?.file_name().map(OsStr::to_owned);
    let name = own.or_else(real).unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Options that choose a part of a file must not be given for formats that have no such parts.
fn refuse_unused(format: &str, options: &OpenOptions) -> Result<()> {
    let given = [
        ("--series", options.series.is_some(), &["dicom", "tiff"][..]),
        (
            "--resample",
            options.resample,
            &["dicom", "hdf5", "metaimage", "nifti", "nrrd", "vti", "zarr"],
        ),
        (
            "--dataset",
            options.dataset.is_some(),
            &["hdf5", "vti", "zarr"],
        ),
        ("--level", options.level.is_some(), &["hdf5", "zarr"]),
        (
            "--channel",
            options.channel.is_some(),
            &["hdf5", "nifti", "tiff", "zarr"],
        ),
        (
            "--time",
            options.time.is_some(),
            &["hdf5", "nifti", "tiff", "zarr"],
        ),
    ];
    for (option, given, formats) in given {
        if given && !formats.contains(&format) {
            let expected = format!("it with {} alone", formats.join(" or "));
            return Err(Error::usage(option, format!("it with {format}"), expected));
        }
    }
    Ok(())
}

/// Parses the header of the format that the file's first bytes show.
fn recognise(path: &Path, head: &[u8], options: &OpenOptions) -> Result<VolumeDescriptor> {
    // with both, the samples of a file that is not read otherwise can be picked out of it
    let by_options = options.dims.is_some() && options.dtype.is_some();
    let mut recipe = if nrrd::is_nrrd(head) {
        nrrd::parse(path)?
    } else if metaimage::is_metaimage(head) {
        metaimage::parse(path)?
    } else if tiff::is_tiff(head) && !by_options {
        tiff::parse(path, vec![Blob::file(path)?], options)?
    } else if npy::is_npy(head) && !by_options {
        npy::parse(path, head)?
    } else if archive::is_zip(head) && !by_options {
        archive::parse(path, options)?
    } else if vti::is_vti(head) && !by_options {
        vti::parse(path, options)?
    } else if !by_options && let Some(recipe) = nifti::parse(path, head, options)? {
        recipe
    } else if !by_options && hdf5::is_hdf5(path, head) {
        hdf5::parse(path, options)?
    } else if dicom::is_dicom(head) && !by_options {
        dicom::parse(path, vec![Blob::file(path)?], options)?
    } else {
        let options = options.of_headerless();
        refuse_known(path, head, &options)?;
        return raw(path, head, &options);
    };
    complete(path, &mut recipe, options)?;
    Ok(recipe)
}

/// Options that say what the header also says must agree with it; they may fill its gaps.
fn complete(path: &Path, recipe: &mut VolumeDescriptor, options: &OpenOptions) -> Result<()> {
    let differ = |option: &str, found: String, stated: String| {
        let expected = format!("{stated}, as the header of {} says", path.display());
        Err(Error::usage(option, found, expected).with_hint("leave the option out"))
    };
    if let Some(dims) = options.dims
        && dims != recipe.dims.0.map(u64::from)
    {
        let [x, y, z] = dims;
        return differ(
            "--dims",
            format!("{x} x {y} x {z}"),
            recipe.dims.to_string(),
        );
    }
    let dtype = match &recipe.values {
        Some(values) => values.dtype(recipe.dtype),
        None => recipe.dtype,
    };
    if let Some(given) = options.dtype
        && given != dtype
    {
        return differ("--dtype", given.to_string(), dtype.to_string());
    }
    match (options.endian, recipe.endian) {
        (Some(a), Some(b)) if a != b && recipe.dtype.bytes() > 1 => {
            return differ("--endian", a.to_string(), b.to_string());
        }
        (endian, stated) => recipe.endian = stated.or(endian),
    }
    if recipe.endian.is_none() && recipe.dtype.bytes() > 1 && recipe.format == "nrrd" {
        return Err(Error::format(
            path,
            format!("no field `endian` for samples of {}", recipe.dtype),
            "`endian: little` or `endian: big`",
        )
        .with_hint("give --endian"));
    }
    // 0 is what manifests record for files with a header
    match options.offset {
        Some(offset) if offset > 0 => {
            let stated = "no offset but that of the samples".to_owned();
            differ("--offset", offset.to_string(), stated)
        }
        _ => Ok(()),
    }
}

/// The name of the format that a file with these first bytes is read as, unless that is raw or DICOM.
pub(super) fn reads(head: &[u8]) -> Option<&'static str> {
    let formats = [
        ("NRRD", nrrd::is_nrrd(head)),
        ("MetaImage", metaimage::is_metaimage(head)),
        ("TIFF", tiff::is_tiff(head)),
        ("NumPy", npy::is_npy(head)),
        ("zip", archive::is_zip(head)),
        ("VTK image data", vti::is_vti(head)),
        ("NIfTI", nifti::recognise(head).is_some()),
        ("HDF5", head.starts_with(b"\x89HDF\r\n\x1a\n")),
    ];
    formats.iter().find(|(_, is)| *is).map(|(name, _)| *name)
}

/// Refuses what is certainly not a headerless file: a header's file name on something else, and,
/// where no size is given, the formats of other programs.
fn refuse_known(path: &Path, head: &[u8], options: &OpenOptions) -> Result<()> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let expected = match extension.to_ascii_lowercase().as_str() {
        "nrrd" | "nhdr" => "a NRRD file, which begins with NRRD000",
        "mha" | "mhd" => "a MetaImage header, which begins with ObjectType or NDims",
        _ => "",
    };
    if !expected.is_empty() {
        let begin = head[..head.len().min(16)].escape_ascii();
        return Err(Error::format(
            path,
            format!("a file that begins with \"{begin}\""),
            expected,
        ));
    }
    match options.dims.is_none() || options.dtype.is_none() {
        true => foreign::refuse(path, head),
        false => Ok(()),
    }
}

/// A headerless file, perhaps compressed by gzip: everything comes from the options.
fn raw(path: &Path, head: &[u8], options: &OpenOptions) -> Result<VolumeDescriptor> {
    let (Some(dims), Some(dtype)) = (options.dims, options.dtype) else {
        return Err(missing(path, options));
    };
    // by name and content, since a volume may begin with gzip's two bytes by chance
    let gzip = head.starts_with(&[0x1f, 0x8b]) && path.extension().is_some_and(|e| e == "gz");
    let encoding = if gzip { Encoding::Gzip } else { Encoding::Raw };
    Ok(VolumeDescriptor {
        endian: options.endian,
        ..VolumeDescriptor::new(
            "raw",
            Dims::new(dims)?,
            dtype,
            Samples::Files(Data {
                files: vec![path.to_path_buf()],
                start: match options.offset {
                    Some(bytes) => Start::At {
                        base: 0,
                        lines: 0,
                        bytes,
                        stated: true,
                    },
                    None => Start::UNSTATED,
                },
                encoding,
            }),
        )
    })
}

/// Asks for what a headerless file does not say, with what lies beside it or its name suggest.
fn missing(path: &Path, options: &OpenOptions) -> Error {
    let dims = "the size in voxels, as in --dims 512,512,300";
    let dtype = "the sample type, one of u8, i8, u16, i16, u32, i32, f32, f64";
    let (option, expected) = match (options.dims, options.dtype) {
        (None, None) => ("--dims and --dtype", format!("{dims}, and {dtype}")),
        (None, Some(_)) => ("--dims", dims.into()),
        (Some(_), _) => ("--dtype", dtype.into()),
    };
    let path_shown = path.display();
    let mut hint =
        format!("{path_shown} has no header that is known, so it is read as raw samples");
    if let Some(words) = foreign::suggestion(path) {
        hint += &format!("; {words}");
    }
    Error::usage(option, "nothing", expected).with_hint(hint)
}
