//! Opening a volume: the format by its content, the options that complete or override the header.

use super::{Endian, Header, Io, OpenOptions, Opened, Volume};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement};
use crate::store::{self, is_remote};
use crate::volume::adapters::mirror::Mirrored;
use crate::volume::adapters::permute::Permuted;
use crate::volume::adapters::resample;
use crate::volume::adapters::resample::{Grid, Resampled};
use crate::volume::adapters::values::Valued;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Input;
use crate::volume::formats::{folder, foreign};
use crate::volume::io::blob::Blob;
#[cfg(feature = "s3")]
use crate::volume::io::blocked::Blocked;
#[cfg(any(feature = "hdf5", feature = "s3", feature = "zarr"))]
use crate::volume::io::chunked::ChunkedVolume;
use crate::volume::io::data::{self, Data, Encoding, Start};
use crate::volume::io::file::FileVolume;
use crate::volume::io::half::HalfSource;
use crate::volume::io::paged::PagedVolume;
use crate::volume::options::Choice;
use crate::volume::registry::{self, FORMATS};
use crate::volume::stated::{place, warning};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
#[cfg(feature = "s3")]
use std::sync::Arc;

/// Opens a volume. Files are recognised by their content, whatever their name; everything that is of no format that is
/// read is headerless raw (or raw packed by gzip, with a name that ends in `.gz`), whose size and type the options must
/// give. A folder is a Zarr, a DICOM series, or a stack of TIFF, PNG or BMP slices, or, if size and type are given, of
/// headerless ones. A name with a printf number, as `slice_%04d.tif`, stands for the slices of such names.
///
/// # Errors
/// [`Error::Usage`] if an option is missing, impossible or contradicts the file's header;
/// [`Error::Io`], [`Error::Format`] or [`Error::Unsupported`] if the file or its data files cannot
/// be read as what they say they are.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Opened> {
    let mut descriptor = parsed(path, options)?;
    refuse_unused(descriptor.format, options)?;
    let (offset, files) = (raw_offset(&descriptor), sample_files(&descriptor));
    let (placement, provenance) =
        place::place(path, descriptor.placement, descriptor.provenance, options)?;
    let grid = regular(path, &mut descriptor, placement)?;
    let header = Header {
        format: descriptor.format,
        dims: descriptor.dims,
        dtype: descriptor.dtype,
        endian: descriptor.endian.unwrap_or_default(),
        placement,
    };
    let mut notes = std::mem::take(&mut descriptor.notes);
    let warnings = std::mem::take(&mut descriptor.warnings);
    let warnings = warning::texts(warnings, options.spacing.is_some());
    // behind the samples of a TIFF are its directories, and behind those of one of several times another
    let part = options.time.is_some() || options.channel.is_some();
    if !matches!(descriptor.format, "raw" | "tiff")
        && !part
        && let Samples::Files(data) = &descriptor.samples
    {
        notes.extend(data::more_than_described(&descriptor.stored(), data)?);
    }
    let values = descriptor.values.as_ref().map(|values| values.to_string());
    let values = values.or(descriptor.applied.take());
    let scaled = match &descriptor.values {
        Some(values) => values.is_scaled(),
        None => values.is_some(),
    };
    Ok(Opened {
        volume: match grid {
            Some((grid, placement)) => {
                let volume = volume(header, descriptor, options.io)?;
                Box::new(Resampled::new(volume, grid, placement)?)
            }
            None => volume(header, descriptor, options.io)?,
        },
        filtered: None,
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

/// Bytes before the first sample of a headerless file.
fn raw_offset(descriptor: &VolumeDescriptor) -> u64 {
    match &descriptor.samples {
        Samples::Files(Data {
            start: Start::At { bytes, .. },
            ..
        }) if descriptor.format == "raw" => *bytes,
        _ => 0,
    }
}

/// The files that the samples lie in, where they are known.
fn sample_files(descriptor: &VolumeDescriptor) -> Vec<PathBuf> {
    match &descriptor.samples {
        Samples::Files(data) => data.files.clone(),
        Samples::Pages(pages) => pages.files(),
        _ => Vec::new(),
    }
}

/// The grid that samples are interpolated to, with its placement: that of the descriptor, or one at right angles where the
/// axes are not.
fn regular(
    path: &Path,
    descriptor: &mut VolumeDescriptor,
    placement: Placement,
) -> Result<Option<(Grid, Placement)>> {
    if let Some(grid) = descriptor.grid.take() {
        return Ok(Some((grid, placement)));
    }
    if placement.shear().is_none() {
        return Ok(None);
    }
    let dtype = match &descriptor.values {
        Some(values) => values.dtype(descriptor.dtype),
        None => descriptor.dtype,
    };
    let grid = Grid::upright(path, placement, descriptor.dims, resample::fill(dtype))?;
    let note = grid.note("its axes are not at right angles");
    descriptor.notes.push(note);
    let placement = grid.placement;
    Ok(Some((grid, placement)))
}

/// What the parser of the format finds, completed by the options.
fn parsed(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    if is_remote(path) {
        return in_bucket(path, options);
    }
    let slices = match path.is_dir() {
        true => Some(folder::parse(path, FORMATS, options)),
        false if path.exists() => None,
        false => folder::numbered(path, FORMATS, options),
    };
    let Some(descriptor) = slices else {
        return recognise(path, &Blob::file(path)?.head(4096)?, options);
    };
    let mut descriptor = descriptor?;
    if descriptor.format != "raw" {
        complete(path, &mut descriptor, options)?;
    }
    Ok(descriptor)
}

/// The same of a file or folder in a bucket, which can be of some formats only: those that are read in few requests.
fn in_bucket(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let meta = store::metadata(path).map_err(|e| Error::io(path, "open", e))?;
    let way_out = "copy it to this machine";
    if meta.is_file {
        let head = Blob::file(path)?.head(4096)?;
        if let Some(format) = FORMATS.iter().find(|f| !f.in_buckets && (f.starts)(&head)) {
            let what = format!("{} in a bucket", format.title);
            return Err(Error::unsupported(path, what, way_out));
        }
        let descriptor = recognise(path, &head, options)?;
        // a header from elsewhere does not make this program read other files of this machine
        if let Samples::Files(data) = &descriptor.samples
            && let Some(file) = data.files.iter().find(|file| !is_remote(file))
        {
            let found = format!("samples in {}, on this machine", file.display());
            return Err(Error::format(path, found, "samples in the same bucket"));
        }
        return Ok(descriptor);
    }
    let mut formats = FORMATS.iter().filter(|f| f.in_buckets && f.is_folder(path));
    let Some((format, parse)) = formats.find_map(|f| Some((f, f.parse?))) else {
        return Err(Error::unsupported(
            path,
            "a folder in a bucket that is no Zarr",
            way_out,
        ));
    };
    debug_assert!(format.folder);
    let input = Input {
        path,
        head: &[],
        formats: FORMATS,
    };
    let mut descriptor = parse(&input, options)?;
    complete(path, &mut descriptor, options)?;
    Ok(descriptor)
}

/// The samples of a descriptor as the values that they stand for, the right way round.
fn volume(header: Header, descriptor: VolumeDescriptor, io: Io) -> Result<Box<dyn Volume>> {
    let swap = header.endian != Endian::NATIVE;
    let stored = descriptor.stored();
    let header = Header {
        dims: stored.dims,
        ..header
    };
    let volume: Box<dyn Volume> = match descriptor.samples {
        Samples::Files(data) => {
            let source = data::source(&stored, &data, io)?;
            match descriptor.half {
                true => {
                    let source = Box::new(HalfSource::new(source, header.endian));
                    in_files(&data, FileVolume::new(header, source, false))
                }
                false => in_files(&data, FileVolume::new(header, source, swap)),
            }
        }
        Samples::Bytes(source) => Box::new(FileVolume::new(header, source, swap)),
        Samples::Pages(pages) => Box::new(PagedVolume::new(header, pages)),
        #[cfg(any(feature = "hdf5", feature = "zarr"))]
        Samples::Chunks(chunks) => Box::new(ChunkedVolume::new(header, chunks)),
    };
    let volume = match descriptor.stored_axes {
        [0, 1, 2] => volume,
        axes => Box::new(Permuted::new(volume, axes)),
    };
    let volume = match descriptor.mirrored {
        [false, false] => volume,
        turned => Box::new(Mirrored::new(volume, turned)),
    };
    Ok(match descriptor.values {
        Some(values) => Box::new(Valued::new(volume, values)),
        None => volume,
    })
}

/// A volume whose samples lie in files; what lies in a bucket is read in large parts.
fn in_files(data: &Data, volume: FileVolume) -> Box<dyn Volume> {
    #[cfg(feature = "s3")]
    if data.files.iter().any(|path| is_remote(path)) && volume.random_access() {
        let header = volume.header().clone();
        let chunks = Blocked::new(Arc::new(volume));
        return Box::new(ChunkedVolume::new(header, Box::new(chunks)));
    }
    let _ = data;
    Box::new(volume)
}

/// The name of a file or folder without its directory; of one that is given as `.` or `..` the name that it has.
pub fn file_name(path: &Path) -> String {
    let own = path.file_name().map(OsStr::to_owned);
    let real = || path.canonicalize().ok()?.file_name().map(OsStr::to_owned);
    let name = own.or_else(real).unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// The name of a file or folder without its directory and the endings of formats: `scan` of `ct/scan.nii.gz`. Of a file
/// any last ending goes.
pub fn stem(path: &Path) -> String {
    /// Endings of samples without a header, of compressed files, and of names such as `scan.ome.tif`.
    const OTHERS: [&str; 8] = ["raw", "img", "gz", "bz2", "xz", "zst", "ome", "slices"];
    let name = file_name(path);
    let known = |ending: &str| {
        let own = FORMATS.iter().flat_map(|f| f.extensions);
        let all = own.flat_map(|e| e.split('.')).chain(OTHERS);
        all.into_iter().any(|e| e.eq_ignore_ascii_case(ending))
    };
    let split = |name: &str| {
        let (stem, ending) = name.rsplit_once('.')?;
        (!stem.is_empty()).then(|| (stem.to_owned(), ending.to_owned()))
    };
    let mut rest = name.clone();
    while let Some((stem, ending)) = split(&rest) {
        let first = rest == name && !path.is_dir();
        let of_letters = !ending.is_empty() && ending.chars().all(char::is_alphabetic);
        if !(known(&ending) || first && of_letters) {
            break;
        }
        rest = stem;
    }
    rest
}

/// Options that choose a part of a file must not be given for formats that have no such parts.
fn refuse_unused(format: &str, options: &OpenOptions) -> Result<()> {
    let own = registry::named(format).map_or(&[][..], |format| format.takes);
    let mut given = Choice::ALL.into_iter().filter(|c| c.is_given(options));
    let Some(choice) = given.find(|choice| !own.contains(choice)) else {
        return Ok(());
    };
    let takers = FORMATS.iter().filter(|f| f.takes.contains(&choice));
    let mut names: Vec<&str> = takers.map(|format| format.name).collect();
    names.sort_unstable();
    let expected = format!("it with {} alone", names.join(" or "));
    let found = format!("it with {format}");
    Err(Error::usage(choice.option(), found, expected))
}

/// Parses the header of the format that the file's first bytes show.
fn recognise(path: &Path, head: &[u8], options: &OpenOptions) -> Result<VolumeDescriptor> {
    // with both, the samples of a file that is not read otherwise can be picked out of it
    let by_options = options.dims.is_some() && options.dtype.is_some();
    let mut tried = FORMATS
        .iter()
        .filter(|format| format.begins.is_some() || !by_options)
        .filter_map(|format| Some((format, format.parse?)));
    let Some((_, parse)) = tried.find(|(format, _)| format.is_file(path, head)) else {
        let told = options.headerless.is_some_and(|raw| !raw.supposed);
        refuse_known(path, head, by_options || told)?;
        let options = options.of_headerless();
        return raw(path, head, &options);
    };
    let input = Input {
        path,
        head,
        formats: FORMATS,
    };
    let mut descriptor = parse(&input, options)?;
    complete(path, &mut descriptor, options)?;
    Ok(descriptor)
}

/// Options that say what the header also says must agree with it; they may fill its gaps.
fn complete(path: &Path, descriptor: &mut VolumeDescriptor, options: &OpenOptions) -> Result<()> {
    let differ = |option: &str, found: String, stated: String| {
        let expected = format!("{stated}, as the header of {} says", path.display());
        Err(Error::usage(option, found, expected).with_hint("leave the option out"))
    };
    if let Some(dims) = options.dims
        && dims != descriptor.dims.0.map(u64::from)
    {
        let [x, y, z] = dims;
        return differ(
            "--dims",
            format!("{x} x {y} x {z}"),
            descriptor.dims.to_string(),
        );
    }
    let dtype = match &descriptor.values {
        Some(values) => values.dtype(descriptor.dtype),
        None => descriptor.dtype,
    };
    if let Some(given) = options.dtype
        && given != dtype
    {
        return differ("--dtype", given.to_string(), dtype.to_string());
    }
    match (options.endian, descriptor.endian) {
        (Some(a), Some(b)) if a != b && descriptor.dtype.bytes() > 1 => {
            return differ("--endian", a.to_string(), b.to_string());
        }
        (endian, stated) => descriptor.endian = stated.or(endian),
    }
    if descriptor.endian.is_none() && descriptor.dtype.bytes() > 1 && descriptor.format == "nrrd" {
        return Err(Error::format(
            path,
            format!("no field `endian` for samples of {}", descriptor.dtype),
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

/// Refuses what is certainly not a headerless file: a header's file name on something else, and,
/// where nobody has told its size and type, the formats of other programs.
fn refuse_known(path: &Path, head: &[u8], told: bool) -> Result<()> {
    let named = FORMATS.iter().filter(|format| format.has_name(path));
    if let Some(expected) = named.filter_map(|format| format.begins).next() {
        let begin = head[..head.len().min(16)].escape_ascii();
        let found = format!("a file that begins with \"{begin}\"");
        return Err(Error::format(path, found, expected));
    }
    match told {
        true => Ok(()),
        false => foreign::refuse(path, head, FORMATS),
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
                    Some(bytes) => Start::behind(bytes),
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
    if let Some(words) = foreign::suggestion(path, FORMATS) {
        hint += &format!("; {words}");
    }
    Error::usage(option, "nothing", expected).with_hint(hint)
}
