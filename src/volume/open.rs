//! Opening a volume: the format by its content, the options that complete or override the header.

use super::file::FileVolume;
use super::layout::{self, Data, Encoding, Recipe, Start};
use super::{Dtype, Endian, Header, Volume};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use std::io::Read;
use std::path::Path;

/// How uncompressed files are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Io {
    /// A memory map: fastest. The file must not be changed or cut while it is read, or the process
    /// may die; its pages count as resident memory until they are released.
    #[default]
    Mmap,
    /// Positioned reads: for files on network drives or that others may change.
    Read,
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
    /// Overrides the spacing of the file.
    pub spacing: Option<[f64; 3]>,
    /// Overrides the unit of the file; numbers are kept, not converted.
    pub unit: Option<Unit>,
    /// How uncompressed files are read.
    pub io: Io,
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
}

impl std::fmt::Debug for Opened {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Opened")
            .field("header", self.volume.header())
            .field("provenance", &self.provenance)
            .field("name", &self.name)
            .field("offset", &self.offset)
            .finish()
    }
}

/// Opens a volume. NRRD and MetaImage files are recognised by their content, whatever their name;
/// everything else is headerless raw, whose size and type the options must give.
///
/// # Errors
/// [`Error::Usage`] if an option is missing, impossible or contradicts the file's header;
/// [`Error::Io`], [`Error::Format`] or [`Error::Unsupported`] if the file or its data files cannot
/// be read as what they say they are.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Opened> {
    layout::file_len(path)?;
    let mut head = Vec::new();
    layout::open_file(path)?
        .take(4096)
        .read_to_end(&mut head)
        .map_err(|e| Error::io(path, "read", e))?;
    let recipe = raw(path, &head, options)?;
    let offset = match recipe.data.start {
        Start::At { bytes, .. } if recipe.format == "raw" => bytes,
        _ => 0,
    };
    let (placement, provenance) = place(&recipe, options)?;
    let endian = recipe.endian.unwrap_or_default();
    let source = layout::source(&recipe, options.io)?;
    let header = Header {
        format: recipe.format,
        dims: recipe.dims,
        dtype: recipe.dtype,
        endian,
        placement,
    };
    let name = path.file_name().unwrap_or(path.as_os_str());
    Ok(Opened {
        volume: Box::new(FileVolume::new(header, source, endian != Endian::NATIVE)),
        provenance,
        name: name.to_string_lossy().into_owned(),
        offset,
    })
}

/// The placement after the options, checked.
fn place(recipe: &Recipe, options: &OpenOptions) -> Result<(Placement, Provenance)> {
    let mut placement = recipe.placement;
    let mut provenance = recipe.provenance;
    if let Some(spacing) = options.spacing {
        placement.spacing = spacing;
        provenance.spacing = Origin::Option;
    }
    if let Some(unit) = options.unit {
        placement.unit = unit;
        provenance.unit = Origin::Option;
    }
    placement.check()?;
    Ok((placement, provenance))
}

/// A headerless file: everything comes from the options.
fn raw(path: &Path, _head: &[u8], options: &OpenOptions) -> Result<Recipe> {
    let Some(dims) = options.dims else {
        return Err(missing(
            "--dims",
            "the size in voxels, as in --dims 512,512,300",
            path,
        ));
    };
    let Some(dtype) = options.dtype else {
        return Err(missing(
            "--dtype",
            "one of u8, i8, u16, i16, u32, i32, f32, f64",
            path,
        ));
    };
    Ok(Recipe {
        format: "raw",
        dims: Dims::new(dims)?,
        dtype,
        endian: options.endian,
        placement: Placement::default(),
        provenance: Provenance::default(),
        data: Data {
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
            encoding: Encoding::Raw,
        },
    })
}

fn missing(option: &str, expected: &str, path: &Path) -> Error {
    Error::usage(option, "nothing", expected).with_hint(format!(
        "{} has no header that is known, so it is read as raw samples",
        path.display()
    ))
}
