//! HDF5 and NeXus: a dataset of three axes (z, y, x), whole or in chunks.
//!
//! The dataset is found by itself if there is one; others of more axes count if those in front have
//! one entry. Spacing is read from the attribute `element_size_um` (z, y, x), which ImageJ, ilastik
//! and others write. Filters are those of the library itself and, of plugins, LZF, LZ4, Blosc, bitshuffle
//! and Zstandard. Virtual datasets and other filters are refused by name.

mod filter;

use super::chunked::Chunks;
use super::layout::{Recipe, Samples};
use super::open::OpenOptions;
use super::paged::MAX_CHUNK;
use super::{Dtype, Endian, Voxel, with_voxel_type};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use hdf5_reader::error::Error as H5Error;
use hdf5_reader::group::Group;
use hdf5_reader::{ByteOrder, Dataset, Datatype, FileStorage, H5Type, Hdf5File};
use hdf5_reader::{SliceInfo, SliceInfoElem};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Groups in groups beyond this are not looked into.
const MAX_DEPTH: u32 = 16;
/// More datasets than this are not looked at.
const MAX_DATASETS: usize = 10_000;
/// Names that a message lists.
const LISTED: usize = 30;
/// The library keeps this of unpacked chunks; the volume has a cache of its own.
const LIBRARY_CACHE: usize = 1 << 20;
/// Smaller chunks are read several at a time.
const LEAST: u64 = 512 << 10;
/// Datasets without chunks are read in pieces of at most this size, unless a row has more.
const PIECE: u64 = 4 << 20;

/// True if a file begins as HDF5 does.
pub(super) fn is_hdf5(head: &[u8]) -> bool {
    head.starts_with(b"\x89HDF\r\n\x1a\n")
}

/// Opens the dataset that the options name, or the only one that is a volume.
///
/// # Errors
/// [`Error::Usage`] with the list if there are several; [`Error::Unsupported`] by name for types,
/// layouts and filters that are not read, [`Error::Format`] for damaged files.
pub(super) fn parse(path: &Path, options: &OpenOptions) -> Result<Recipe> {
    let storage = FileStorage::open(path).map_err(|e| broken(path, "", &e))?;
    let limits = hdf5_reader::OpenOptions::default()
        .with_chunk_cache_bytes(LIBRARY_CACHE)
        .with_max_chunk_bytes(MAX_CHUNK as usize)
        .with_max_read_bytes(MAX_CHUNK as usize)
        .with_filter_registry(filter::registry());
    let file = Hdf5File::from_storage_with_options(Arc::new(storage), limits)
        .map_err(|e| broken(path, "", &e))?;
    let (name, dataset) = match &options.dataset {
        Some(name) => {
            let dataset = file.dataset(name).map_err(|e| match e {
                H5Error::DatasetNotFound(_) | H5Error::GroupNotFound(_) => {
                    absent(path, &file, name)
                }
                e if e.to_string().contains("not found") => absent(path, &file, name),
                e => broken(path, name, &e),
            })?;
            (name.clone(), dataset)
        }
        None => only(path, &file)?,
    };
    recipe(path, name, dataset)
}

fn absent(path: &Path, file: &Hdf5File, name: &str) -> Error {
    match Search::of(path, file) {
        Ok(search) => Error::usage("--dataset", name, search.list()),
        Err(error) => error,
    }
}

/// What was found in the groups of a file.
#[derive(Default)]
struct Search {
    volumes: Vec<(String, Dataset)>,
    /// The first dataset that could not be opened, and why.
    failed: Option<(String, H5Error)>,
    seen: HashSet<u64>,
    count: usize,
}

impl Search {
    fn of(path: &Path, file: &Hdf5File) -> Result<Search> {
        let root = file.root_group().map_err(|e| broken(path, "/", &e))?;
        let mut search = Search::default();
        search.group(&root, "", 0);
        search.volumes.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(search)
    }

    fn group(&mut self, group: &Group, name: &str, depth: u32) {
        if depth > MAX_DEPTH || !self.seen.insert(group.address()) {
            return;
        }
        let (groups, datasets) = match group.member_names() {
            Ok(names) => names,
            Err(error) => return self.note(name, error),
        };
        for child in datasets {
            self.count += 1;
            if self.count > MAX_DATASETS {
                return;
            }
            let path = format!("{name}/{child}");
            match group.dataset(&child) {
                Ok(dataset) => {
                    let shape = dataset.shape();
                    let volume = axes(shape).is_some() && kind(dataset.dtype()).is_some();
                    // the same dataset by another name is the same volume
                    if volume && self.seen.insert(dataset.address()) {
                        self.volumes.push((path, dataset));
                    }
                }
                Err(error) => self.note(&path, error),
            }
        }
        for child in groups {
            let path = format!("{name}/{child}");
            match group.group(&child) {
                Ok(group) => self.group(&group, &path, depth + 1),
                Err(error) => self.note(&path, error),
            }
        }
    }

    fn note(&mut self, name: &str, error: H5Error) {
        self.failed.get_or_insert_with(|| (name.to_owned(), error));
    }

    fn list(&self) -> String {
        let lines = self.volumes.iter().take(LISTED).map(|(name, dataset)| {
            let kind = kind(dataset.dtype()).map_or("", |(dtype, _)| dtype.name());
            let shape: Vec<String> = dataset.shape().iter().map(u64::to_string).collect();
            format!("\n  {name}: {} of {kind}", shape.join(" x "))
        });
        let more = match self.volumes.len().saturating_sub(LISTED) {
            0 => String::new(),
            n => format!("\n  and {n} more"),
        };
        format!("one of{}{more}", lines.collect::<String>())
    }
}

/// The only volume of a file.
fn only(path: &Path, file: &Hdf5File) -> Result<(String, Dataset)> {
    let mut search = Search::of(path, file)?;
    match (search.volumes.len(), &search.failed) {
        (1, _) => Ok(search.volumes.swap_remove(0)),
        (0, Some((name, error))) => Err(broken(path, name, error)),
        (0, None) => Err(Error::format(
            path,
            "HDF5 without a dataset of three axes of numbers",
            "a volume",
        )),
        (n, _) => {
            let found = format!("nothing, and {n} datasets in {}", path.display());
            Err(Error::usage("--dataset", found, search.list()))
        }
    }
}

/// What the library's error means for the user.
fn broken(path: &Path, name: &str, error: &H5Error) -> Error {
    let place = match name {
        "" => String::new(),
        _ => format!(" ({name})"),
    };
    let no = |what: String, hint: &str| Error::unsupported(path, what, hint);
    if let H5Error::Io(e) = error {
        return Error::io(path, "read", std::io::Error::new(e.kind(), e.to_string()));
    }
    // the library wraps the cause in text that says where
    let text = error.to_string();
    let has = |part: &str| text.contains(part);
    if has("unsupported layout class 3") {
        return no(
            format!("a virtual dataset of HDF5{place}"),
            "copy it to a plain one, as with `h5repack -l CONTI`",
        );
    }
    if let Some((_, id)) = text.split_once("filter id ") {
        let number: String = id.chars().take_while(char::is_ascii_digit).collect();
        let known = FILTERS.iter().find(|(id, _)| *id == number);
        let known = known.map_or(String::new(), |(_, name)| format!(" ({name})"));
        return no(
            format!("the HDF5 filter {number}{known}{place}"),
            "write it anew with one that HDF5 itself has, as with `h5repack -f GZIP=1`",
        );
    }
    if has("unsupported") {
        let hint = "write the file anew, as with `h5repack`";
        return no(format!("HDF5 with {text}{place}"), hint);
    }
    Error::format(path, format!("HDF5 with {text}{place}"), "a whole file")
        .with_hint("the file is cut short or damaged")
}

/// Filters of plugins, by their registered numbers
/// (<https://github.com/HDFGroup/hdf5_plugins/blob/master/docs/RegisteredFilterPlugins.md>).
const FILTERS: &[(&str, &str)] = &[
    ("307", "bzip2"),
    ("32013", "ZFP"),
    ("32017", "SZ"),
    ("32026", "Blosc 2"),
];

/// The last three axes, if those in front of them have one entry.
fn axes(shape: &[u64]) -> Option<[u64; 3]> {
    let (front, last) = shape.split_last_chunk::<3>()?;
    let volume = front.iter().all(|&n| n == 1) && last.iter().all(|&n| n > 1);
    volume.then_some([last[2], last[1], last[0]])
}

/// The type of numbers; `None` for other data.
fn kind(dtype: &Datatype) -> Option<(Dtype, ByteOrder)> {
    Some(match *dtype {
        Datatype::FixedPoint {
            size,
            signed,
            byte_order,
        } => {
            let dtype = match (size, signed) {
                (1, false) => Dtype::U8,
                (1, true) => Dtype::I8,
                (2, false) => Dtype::U16,
                (2, true) => Dtype::I16,
                (4, false) => Dtype::U32,
                (4, true) => Dtype::I32,
                _ => return None,
            };
            (dtype, byte_order)
        }
        Datatype::FloatingPoint {
            size: size @ (4 | 8),
            byte_order,
        } => {
            let dtype = if size == 4 { Dtype::F32 } else { Dtype::F64 };
            (dtype, byte_order)
        }
        _ => return None,
    })
}

/// A type in words.
fn type_text(dtype: &Datatype) -> String {
    match *dtype {
        Datatype::FixedPoint { size, signed, .. } => {
            let sign = if signed { "signed" } else { "unsigned" };
            format!("{sign} integers of {} bits", 8 * u64::from(size))
        }
        Datatype::FloatingPoint { size, .. } => format!("floats of {} bits", 8 * u64::from(size)),
        _ => "which are no plain numbers".into(),
    }
}

fn recipe(path: &Path, name: String, dataset: Dataset) -> Result<Recipe> {
    let shape = dataset.shape();
    let (Some(size), Some((dtype, order))) = (axes(shape), kind(dataset.dtype())) else {
        let what = format!(
            "the HDF5 dataset {name} of {shape:?}, {}",
            type_text(dataset.dtype())
        );
        let hint = "volumes have 3 axes (z, y, x) of numbers of at most 32 bits or f64";
        return Err(Error::unsupported(path, what, hint));
    };
    let dims = Dims::new(size)
        .map_err(|e| Error::format(path, format!("a dataset with {e}"), "a volume"))?;
    let (placement, provenance) = place(&dataset);
    let sample = dtype.bytes() as u64;
    let shape = match dataset.chunks() {
        Some(chunk) if chunk.contains(&0) => {
            let found = format!("the HDF5 dataset {name} with chunks of {chunk:?}");
            return Err(Error::format(path, found, "chunks of at least one voxel"));
        }
        Some(chunk) if chunk.len() == dataset.ndim() => {
            let last = chunk.last_chunk::<3>().copied().unwrap_or([1; 3]);
            grouped([last[2], last[1], last[0]], dims, sample)
        }
        _ => {
            let rows = PIECE / (u64::from(dims.0[0]) * sample);
            [dims.0[0], rows.clamp(1, dims.0[1].into()) as u32, 1]
        }
    };
    let bytes = shape
        .iter()
        .fold(sample, |n, &s| n.saturating_mul(s.into()));
    if bytes > MAX_CHUNK {
        let what = format!("an HDF5 dataset with chunks of {bytes} bytes");
        return Err(Error::unsupported(
            path,
            what,
            "write it anew with smaller chunks",
        ));
    }
    let chunks = H5Chunks {
        path: path.to_path_buf(),
        shape,
        dims,
        dtype,
        note: format!("dataset {name}"),
        name,
        dataset,
    };
    // filters show only when a chunk is read: better now than after an hour
    let first = chunks.size([0; 3]).iter().product::<u64>() * sample;
    chunks.decode([0; 3], &mut vec![0; first as usize])?;
    Ok(Recipe {
        endian: Some(match order {
            ByteOrder::BigEndian => Endian::Big,
            ByteOrder::LittleEndian => Endian::Little,
        }),
        placement,
        provenance,
        notes: vec![chunks.note.clone()],
        ..Recipe::new("hdf5", dims, dtype, Samples::Chunks(Box::new(chunks)))
    })
}

/// A chunk, or several small ones.
fn grouped(chunk: [u32; 3], dims: Dims, sample: u64) -> [u32; 3] {
    let mut shape = [0, 1, 2].map(|a| chunk[a].clamp(1, dims.0[a]));
    let bytes = |shape: [u32; 3]| shape.iter().fold(sample, |n, &s| n * u64::from(s));
    for a in 0..3 {
        while shape[a] < dims.0[a] && bytes(shape) < LEAST {
            // whole chunks, until the volume ends
            shape[a] = shape[a].saturating_mul(2).min(dims.0[a]);
            if shape[a] < dims.0[a] {
                shape[a] = shape[a] / chunk[a] * chunk[a];
            }
        }
    }
    shape
}

/// The spacing of ImageJ's and ilastik's attribute.
fn place(dataset: &Dataset) -> (Placement, Provenance) {
    let mut place = Placement::default();
    let mut from = Provenance::default();
    let attribute = dataset.attribute("element_size_um");
    let values = attribute.ok().and_then(|a| match a.datatype {
        Datatype::FloatingPoint { size: 4, .. } => {
            let values = a.read_1d::<f32>().ok()?;
            Some(values.into_iter().map(f64::from).collect::<Vec<_>>())
        }
        _ => a.read_1d::<f64>().ok(),
    });
    if let Some([z, y, x]) = values.as_deref()
        && [x, y, z].iter().all(|s| s.is_finite() && **s > 0.0)
    {
        place.spacing = [*x, *y, *z];
        place.unit = Unit::Micrometre;
        (from.spacing, from.unit) = ([Origin::File; 3], Origin::File);
    }
    (place, from)
}

/// The chunks of a dataset, or pieces of one without.
struct H5Chunks {
    path: PathBuf,
    name: String,
    note: String,
    dataset: Dataset,
    shape: [u32; 3],
    dims: Dims,
    dtype: Dtype,
}

impl H5Chunks {
    /// Voxels of a chunk inside the volume, x first.
    fn size(&self, index: [u32; 3]) -> [u64; 3] {
        [0, 1, 2].map(|a| {
            let start = u64::from(index[a]) * u64::from(self.shape[a]);
            u64::from(self.shape[a]).min(u64::from(self.dims.0[a]) - start)
        })
    }

    fn read<T: Voxel + H5Type>(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        let size = self.size(index);
        let front = self.dataset.ndim() - 3;
        let whole = |start: u64, n: u64| SliceInfoElem::Slice {
            start,
            end: start + n,
            step: 1,
        };
        let mut selections: Vec<_> = (0..front).map(|_| whole(0, 1)).collect();
        for a in [2, 1, 0] {
            let start = u64::from(index[a]) * u64::from(self.shape[a]);
            selections.push(whole(start, size[a]));
        }
        let found = self
            .dataset
            .read_slice::<T>(&SliceInfo { selections })
            .map_err(|e| broken(&self.path, &self.name, &e))?;
        let samples = found.as_slice().unwrap_or_default();
        let bytes: &[u8] = bytemuck::cast_slice(samples);
        if bytes.len() != out.len() {
            let what = format!("{} bytes of a chunk", bytes.len());
            return Err(Error::format(&self.path, what, format!("{}", out.len())));
        }
        out.copy_from_slice(bytes);
        Ok(())
    }
}

impl Chunks for H5Chunks {
    fn shape(&self) -> [u32; 3] {
        self.shape
    }

    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        with_voxel_type!(self.dtype, T => self.read::<T>(index, out))
    }

    fn scratch(&self) -> u64 {
        let voxels: u64 = self.shape.iter().map(|&n| u64::from(n)).product();
        // as stored, unpacked, and as an array
        3 * voxels * self.dtype.bytes() as u64 + LIBRARY_CACHE as u64
    }
}
