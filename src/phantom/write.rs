//! Phantoms as files: raw, MetaImage and NRRD.

use super::PhantomVolume;
use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::progress::Progress;
use crate::sys::atomic_file::NewFile;
use crate::volume::{Dtype, Endian, Header, Volume};
use std::fmt::Write as _;
use std::io::{ErrorKind, Write as _};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Bytes that are made at once; twice as many are in memory, as one part is written while the next
/// is made. At least one row is made at once, whatever its size.
const PART_BYTES: u64 = 16 << 20;

/// What [`write()`] has written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The file to open.
    pub path: PathBuf,
    /// The file with the samples, if that is another one.
    pub data: Option<PathBuf>,
    /// Bytes of all files.
    pub bytes: u64,
}

/// Where header and samples go.
enum Layout {
    Raw,
    /// MetaImage with the samples in a file of this name beside it.
    Detached(PathBuf),
    Attached,
    Nrrd,
}

/// Writes a phantom to a file of the type that the name's extension says: `.raw`, `.mhd` (with a
/// `.raw` beside it), `.mha`, `.nrrd`. Memory is bounded, whatever the size. Files get their name
/// only when they are whole.
///
/// # Errors
/// [`Error::Usage`] for another extension, [`Error::FileExists`] without `force`;
/// [`Error::Io`]; [`Error::Interrupted`].
pub fn write(
    volume: &PhantomVolume,
    path: &Path,
    force: bool,
    progress: &dyn Progress,
) -> Result<Written> {
    let layout = layout(path)?;
    let data = match &layout {
        Layout::Detached(data) => Some(data.clone()),
        _ => None,
    };
    if !force {
        for file in [Some(path), data.as_deref()].into_iter().flatten() {
            if file.symlink_metadata().is_ok() {
                return Err(exists(file));
            }
        }
    }
    let head = match &layout {
        Layout::Raw => String::new(),
        Layout::Detached(data) => metaimage(volume.header(), &file_name(data)),
        Layout::Attached => metaimage(volume.header(), "LOCAL"),
        Layout::Nrrd => nrrd(volume.header()),
    };
    let samples = volume.header().dims.voxels() * volume.header().dtype.bytes() as u64;
    let mut file = temporary(path)?;
    put(&mut file, path, head.as_bytes())?;
    if let Some(data) = &data {
        let mut beside = temporary(data)?;
        write_samples(volume, &mut beside, data, progress)?;
        keep(beside, data, force)?;
    } else {
        write_samples(volume, &mut file, path, progress)?;
    }
    keep(file, path, force)?;
    Ok(Written {
        path: path.to_path_buf(),
        data,
        bytes: head.len() as u64 + samples,
    })
}

fn layout(path: &Path) -> Result<Layout> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    match extension.to_ascii_lowercase().as_str() {
        "raw" => Ok(Layout::Raw),
        "mhd" => Ok(Layout::Detached(path.with_extension("raw"))),
        "mha" => Ok(Layout::Attached),
        "nrrd" => Ok(Layout::Nrrd),
        _ => Err(Error::usage(
            "OUT",
            path.display().to_string(),
            "a file name that ends in .raw, .mhd, .mha or .nrrd",
        )),
    }
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn exists(path: &Path) -> Error {
    Error::FileExists {
        path: path.to_path_buf(),
    }
}

fn temporary(path: &Path) -> Result<NewFile> {
    NewFile::create(path).map_err(|e| Error::io(path, "create the file", e))
}

fn keep(file: NewFile, path: &Path, force: bool) -> Result<()> {
    file.keep(force).map_err(|e| match e.kind() {
        ErrorKind::AlreadyExists if !force => exists(path),
        _ => Error::io(path, "give its name to the finished file", e),
    })
}

fn put(file: &mut NewFile, path: &Path, bytes: &[u8]) -> Result<()> {
    file.write_all(bytes)
        .map_err(|e| Error::io(path, "write", e))
}

/// The boxes, in file order, that are made one at a time: whole slices, or rows of one slice.
fn parts(header: &Header) -> impl Iterator<Item = (Range<u32>, Range<u32>)> {
    let [nx, ny, nz] = header.dims.0;
    let row_bytes = u64::from(nx) * header.dtype.bytes() as u64;
    let rows = (PART_BYTES / row_bytes).clamp(1, u64::from(ny)) as u32;
    let slices = match rows == ny {
        true => (PART_BYTES / (row_bytes * u64::from(ny))).clamp(1, u64::from(nz)) as u32,
        false => 1,
    };
    (0..nz).step_by(slices as usize).flat_map(move |z| {
        (0..ny)
            .step_by(rows as usize)
            .map(move |y| (y..ny.min(y + rows), z..nz.min(z + slices)))
    })
}

fn write_samples(
    volume: &PhantomVolume,
    file: &mut NewFile,
    path: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let [nx, ny, nz] = volume.header().dims.0;
    let sample_bytes = volume.header().dtype.bytes();
    progress.begin("phantom", u64::from(nz));
    let (mut ready, mut next) = (Vec::new(), Vec::new());
    for (y, z) in parts(volume.header()) {
        if progress.interrupted() {
            return Err(Error::Interrupted);
        }
        next.resize(nx as usize * y.len() * z.len() * sample_bytes, 0);
        let (made, written) = rayon::join(
            || volume.read_box(0..nx, y.clone(), z.clone(), &mut next),
            || put(file, path, &ready),
        );
        made?;
        written?;
        std::mem::swap(&mut ready, &mut next);
        if y.end == ny {
            progress.advance(z.len() as u64);
        }
    }
    put(file, path, &ready)
}

/// The text of a MetaImage header; see
/// <https://itk.org/Wiki/MetaIO/Documentation>. The axes are those of the grid.
fn metaimage(header: &Header, data_file: &str) -> String {
    let element = match header.dtype {
        Dtype::U8 => "MET_UCHAR",
        Dtype::I8 => "MET_CHAR",
        Dtype::U16 => "MET_USHORT",
        Dtype::I16 => "MET_SHORT",
        Dtype::U32 => "MET_UINT",
        Dtype::I32 => "MET_INT",
        Dtype::F32 => "MET_FLOAT",
        Dtype::F64 => "MET_DOUBLE",
    };
    let msb = if header.endian == Endian::Big {
        "True"
    } else {
        "False"
    };
    let [nx, ny, nz] = header.dims.0;
    let mut text = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {msb}\n\
         CompressedData = False\n"
    );
    let place = &header.placement;
    if *place != Placement::default() {
        let axes = place.directions.as_flattened();
        let _ = writeln!(text, "TransformMatrix = {}", join(axes));
        let _ = writeln!(text, "Offset = {}", join(&place.origin));
        let _ = writeln!(text, "ElementSpacing = {}", join(&place.spacing));
        if place.unit != Unit::Voxel {
            let _ = writeln!(text, "DistanceUnits = {}", place.unit);
        }
    }
    let _ = write!(
        text,
        "DimSize = {nx} {ny} {nz}\nElementType = {element}\nElementDataFile = {data_file}\n"
    );
    text
}

/// The text of a NRRD header; see <https://teem.sourceforge.net/nrrd/format.html>.
fn nrrd(header: &Header) -> String {
    let kind = match header.dtype {
        Dtype::F32 => "float",
        Dtype::F64 => "double",
        whole => whole.numpy_name(),
    };
    let [nx, ny, nz] = header.dims.0;
    let mut text = format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {nx} {ny} {nz}\n");
    let place = &header.placement;
    if *place != Placement::default() {
        let vector = |v: &[f64]| format!("({})", join(v).replace(' ', ","));
        let axes: Vec<String> = (0..3)
            .map(|a| vector(&place.directions[a].map(|d| d * place.spacing[a])))
            .collect();
        let _ = writeln!(
            text,
            "space dimension: 3\nspace directions: {}",
            axes.join(" ")
        );
        let _ = writeln!(text, "space origin: {}", vector(&place.origin));
        if place.unit != Unit::Voxel {
            let unit = place.unit;
            let _ = writeln!(text, "space units: \"{unit}\" \"{unit}\" \"{unit}\"");
        }
    }
    if header.dtype.bytes() > 1 {
        let big = header.endian == Endian::Big;
        let _ = writeln!(text, "endian: {}", if big { "big" } else { "little" });
    }
    text.push_str("encoding: raw\n\n");
    text
}

fn join(values: &[f64]) -> String {
    values
        .iter()
        .map(f64::to_string)
        .collect::<Vec<_>>()
        .join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;

    #[test]
    fn parts_cover_the_file_in_order_with_bounded_memory() {
        for dims in [[7, 5, 3], [2, 2, 65_536], [65_536, 300, 2], [4096, 4096, 3]] {
            let header = Header {
                format: "raw",
                dims: Dims(dims),
                dtype: Dtype::F64,
                endian: Endian::Little,
                placement: Placement::default(),
            };
            let (mut at, [nx, ny, _]) = (0u64, dims.map(u64::from));
            for (y, z) in parts(&header) {
                assert_eq!(at, nx * (u64::from(y.start) + ny * u64::from(z.start)));
                let voxels = nx * y.len() as u64 * z.len() as u64;
                assert!(voxels * 8 <= PART_BYTES);
                at += voxels;
            }
            assert_eq!(at, header.dims.voxels());
        }
    }
}
