//! Zarr of version 2 and 3 in a folder: one array, or an OME-Zarr pyramid.
//!
//! The volume is the last three axes (z, y, x), or those of these names; others must have one entry.
//! Only the chunks that are asked for are read and unpacked.

mod codec;
mod meta;
mod ome;

use super::blosc::Broken;
use super::chunked::Chunks;
use super::half;
use super::layout::{Recipe, Samples};
use super::open::OpenOptions;
use super::paged::MAX_CHUNK;
use super::{Dtype, Endian};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use meta::{Array, Meta};
use ome::{Axis, Level};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Longer metadata are damaged.
const MAX_JSON: u64 = 16 << 20;
/// Groups in groups beyond this are not looked into.
const MAX_DEPTH: u32 = 6;
/// More arrays than a message can name.
const MAX_ARRAYS: usize = 200;
/// Tables of shards that are kept, in entries of 16 bytes.
const RECENT: usize = 1 << 20;

/// True for a folder that holds an array or group.
pub(super) fn is_zarr(path: &Path) -> bool {
    [".zarray", ".zgroup", "zarr.json"]
        .iter()
        .any(|name| path.join(name).is_file())
}

/// What a folder holds.
enum Node {
    Array(Box<Array>),
    Group(Value),
    Nothing,
}

/// The JSON of a file; `None` if there is none.
fn json(path: &Path) -> Result<Option<Value>> {
    let fail = |e| Error::io(path, "read", e);
    let file = match File::open(path) {
        Ok(file) => file,
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        Err(e) => return Err(fail(e)),
    };
    let mut bytes = Vec::new();
    file.take(MAX_JSON).read_to_end(&mut bytes).map_err(fail)?;
    let value = serde_json::from_slice(&bytes)
        .map_err(|e| Error::format(path, format!("metadata with {e}"), "JSON"))?;
    Ok(Some(value))
}

/// Looks at a folder.
fn node(folder: &Path) -> Result<Node> {
    let path = folder.join("zarr.json");
    if let Some(json) = json(&path)? {
        let meta = Meta {
            path: &path,
            json: &json,
        };
        return match json["node_type"].as_str() {
            Some("array") => Ok(Node::Array(Box::new(meta.version_3()?))),
            Some("group") => Ok(Node::Group(json["attributes"].clone())),
            other => Err(Error::format(
                &path,
                format!("{other:?}"),
                "an array or group",
            )),
        };
    }
    let path = folder.join(".zarray");
    if let Some(json) = json(&path)? {
        let meta = Meta {
            path: &path,
            json: &json,
        };
        return Ok(Node::Array(Box::new(meta.version_2()?)));
    }
    if !folder.join(".zgroup").is_file() {
        return Ok(Node::Nothing);
    }
    let attributes = json(&folder.join(".zattrs"))?;
    Ok(Node::Group(attributes.unwrap_or(Value::Null)))
}

/// Opens the array in a folder, or the one in its groups that the options name.
///
/// # Errors
/// [`Error::Usage`] with the list if there are several arrays or levels and none is named rightly;
/// [`Error::Unsupported`] by name for types and codecs, [`Error::Format`] for damaged metadata.
pub(super) fn parse(path: &Path, options: &OpenOptions) -> Result<Recipe> {
    let mut folder = path.to_path_buf();
    if let Some(name) = &options.dataset {
        if name.split('/').any(|part| part == "..") {
            return Err(Error::usage("--dataset", name, "a path inside the Zarr"));
        }
        folder.push(name.trim_matches('/'));
    }
    match node(&folder)? {
        Node::Array(array) => {
            no_level(options)?;
            recipe(path, folder, *array, None, Vec::new())
        }
        Node::Group(attributes) => {
            let levels = ome::levels(&folder, &attributes)?;
            if levels.is_empty() {
                no_level(options)?;
                return only(path, &folder);
            }
            level(path, &folder, levels, options.level.unwrap_or(0))
        }
        Node::Nothing => {
            let found = options.dataset.as_deref().unwrap_or_default();
            let names = arrays(path, path)?.join(", ");
            Err(Error::usage("--dataset", found, format!("one of {names}")))
        }
    }
}

fn no_level(options: &OpenOptions) -> Result<()> {
    match options.level {
        Some(level) => Err(Error::usage(
            "--level",
            level.to_string(),
            "it with an OME-Zarr pyramid",
        )),
        None => Ok(()),
    }
}

/// A level of a pyramid.
fn level(path: &Path, folder: &Path, levels: Vec<Level>, wanted: u32) -> Result<Recipe> {
    let count = levels.len();
    let Some(level) = levels.into_iter().nth(wanted as usize) else {
        let expected = format!("0 to {}, as {} has levels", count - 1, path.display());
        return Err(Error::usage("--level", wanted.to_string(), expected));
    };
    let inner = folder.join(&level.path);
    let Node::Array(array) = node(&inner)? else {
        return Err(Error::format(inner, "no array", "a level of the pyramid"));
    };
    let note = format!("level {wanted} of {count} (0 is the finest)");
    recipe(path, inner, *array, Some(level.axes), vec![note])
}

/// The only array with a volume in a group.
fn only(path: &Path, folder: &Path) -> Result<Recipe> {
    let names = arrays(folder, folder)?;
    let [name] = &names[..] else {
        if names.is_empty() {
            let found = "a Zarr group without an array of 3 axes";
            return Err(Error::format(path, found, "a volume"));
        }
        let found = format!("nothing, and {} arrays in {}", names.len(), path.display());
        let expected = format!("one of {}", names.join(", "));
        return Err(Error::usage("--dataset", found, expected));
    };
    let inner = folder.join(name);
    match node(&inner)? {
        Node::Array(array) => {
            let note = format!("array {name}");
            recipe(path, inner, *array, None, vec![note])
        }
        _ => Err(Error::format(inner, "no array", "an array")),
    }
}

/// Paths of the arrays below a folder that could be volumes.
fn arrays(root: &Path, folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    let mut folders = vec![(folder.to_path_buf(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        match node(&folder) {
            Ok(Node::Array(array)) => {
                if volume_axes(&array.shape, &array.names).is_some() && names.len() < MAX_ARRAYS {
                    let name = folder.strip_prefix(root).unwrap_or(&folder);
                    names.push(name.display().to_string());
                }
                continue;
            }
            // an array that is not read is not the one that is meant, unless it is named
            Err(_) => continue,
            Ok(_) => {}
        }
        let fail = |e| Error::io(&folder, "list", e);
        for entry in std::fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            if depth < MAX_DEPTH && entry.file_type().map_err(fail)?.is_dir() {
                folders.push((entry.path(), depth + 1));
            }
        }
    }
    names.sort();
    Ok(names)
}

/// Which axes are x, y and z: those of these names, else the last ones. `None` if there are too few
/// or another one has more than one entry.
fn volume_axes(shape: &[u64], names: &[String]) -> Option<[usize; 3]> {
    let named = |name: &str| names.iter().position(|n| n.eq_ignore_ascii_case(name));
    let n = shape.len();
    let axes = match (named("x"), named("y"), named("z")) {
        (Some(x), Some(y), Some(z)) if names.len() == n => [x, y, z],
        _ if n >= 3 => [n - 1, n - 2, n - 3],
        _ => return None,
    };
    let single = |i: usize| axes.contains(&i) || shape[i] == 1;
    (0..n).all(single).then_some(axes)
}

fn recipe(
    path: &Path,
    folder: PathBuf,
    array: Array,
    axes: Option<Vec<Axis>>,
    notes: Vec<String>,
) -> Result<Recipe> {
    let names = match &axes {
        Some(axes) => axes.iter().map(|a| a.name.clone()).collect(),
        None => array.names.clone(),
    };
    let Some([x, y, z]) = volume_axes(&array.shape, &names) else {
        let what = format!("a Zarr array of shape {:?}", array.shape);
        let hint = "volumes have 3 axes with more than one entry: save one channel and time as an \
                    array of its own";
        return Err(Error::unsupported(path, what, hint));
    };
    let dims = Dims::new([x, y, z].map(|a| array.shape[a]))
        .map_err(|e| Error::format(path, format!("an array with {e}"), "a volume"))?;
    let sample = if array.half {
        2
    } else {
        array.dtype.bytes() as u64
    };
    let chunk = array
        .chunk
        .iter()
        .try_fold(sample, |n, &c| n.checked_mul(c));
    let Some(bytes) = chunk.filter(|&n| n <= MAX_CHUNK) else {
        let what = format!("a Zarr array with chunks of {:?}", array.chunk);
        return Err(Error::unsupported(
            path,
            what,
            "write it anew with smaller chunks",
        ));
    };
    let (placement, provenance) = place(axes.as_deref(), [x, y, z]);
    let (dtype, endian) = (array.dtype, array.coding.endian);
    let chunks = ZarrChunks {
        folder,
        bytes: bytes as usize,
        dims,
        axes: [x, y, z],
        array,
        tables: Mutex::default(),
    };
    Ok(Recipe {
        endian: Some(endian),
        placement,
        provenance,
        notes,
        ..Recipe::new("zarr", dims, dtype, Samples::Chunks(Box::new(chunks)))
    })
}

/// Steps and units of the axes x, y and z; a unit only if it is the same for all.
fn place(axes: Option<&[Axis]>, volume: [usize; 3]) -> (Placement, Provenance) {
    let mut place = Placement::default();
    let mut from = Provenance::default();
    let axes = axes.and_then(|axes| {
        let [x, y, z] = volume.map(|a| axes.get(a));
        Some([x?, y?, z?])
    });
    let Some(axes) = axes else {
        return (place, from);
    };
    let units = axes.map(|a| a.unit.filter(|u| *u != Unit::Voxel));
    place.spacing = axes.map(|a| a.step);
    place.origin = axes.map(|a| a.start);
    (from.spacing, from.origin) = (Origin::File, Origin::File);
    if let [Some(unit), b, c] = units
        && (b, c) == (Some(unit), Some(unit))
    {
        place.unit = unit;
        from.unit = Origin::File;
    }
    (place, from)
}

/// Places of the chunks of a shard: position and length, `u64::MAX` for none.
type Table = Arc<Vec<[u64; 2]>>;

/// The chunks of an array.
struct ZarrChunks {
    folder: PathBuf,
    array: Array,
    dims: Dims,
    /// Axes of the array that are x, y and z.
    axes: [usize; 3],
    /// Bytes of a chunk as stored.
    bytes: usize,
    tables: Mutex<HashMap<Vec<u64>, Option<Table>>>,
}

impl Chunks for ZarrChunks {
    fn shape(&self) -> [u32; 3] {
        let most = u64::from(crate::grid::MAX_DIM);
        self.axes.map(|a| self.array.chunk[a].min(most) as u32)
    }

    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        let mut place = vec![0u64; self.array.shape.len()];
        for (axis, i) in self.axes.iter().zip(index) {
            place[*axis] = i.into();
        }
        let Some((path, packed)) = self.packed(&place)? else {
            let fill = &self.array.fill;
            out.chunks_exact_mut(fill.len())
                .for_each(|s| s.copy_from_slice(fill));
            return Ok(());
        };
        let steps = &self.array.coding.packing;
        let stored = codec::unpack(steps, packed, self.bytes).map_err(|e| match e {
            Broken::Damaged(found) => {
                Error::format(&path, found, "a whole chunk, as the metadata say")
            }
            Broken::Unsupported(what) => {
                Error::unsupported(&path, what, "write it anew with lz4 or zstd")
            }
        })?;
        self.put(index, stored, out);
        Ok(())
    }

    fn scratch(&self) -> u64 {
        // packed, unpacked, and in between
        3 * self.bytes as u64 + (1 << 20)
    }
}

impl ZarrChunks {
    fn file(&self, place: &[u64]) -> PathBuf {
        let (front, separator) = self.array.key;
        let mut key = front.to_owned();
        for (i, n) in place.iter().enumerate() {
            if i > 0 || !front.is_empty() {
                key.push(separator);
            }
            key += &n.to_string();
        }
        self.folder.join(key)
    }

    /// The file of a chunk or shard; `None` if there is none.
    fn open(&self, path: &Path) -> Result<Option<(File, u64)>> {
        let file = match File::open(path) {
            Ok(file) => file,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Error::io(path, "open", e)),
        };
        let meta = file.metadata().map_err(|e| Error::io(path, "read", e))?;
        if !meta.is_file() {
            return Err(Error::format(path, "a folder", "a chunk"));
        }
        Ok(Some((file, meta.len())))
    }

    /// The bytes of a chunk as they are in its file.
    fn packed(&self, place: &[u64]) -> Result<Option<(PathBuf, Vec<u8>)>> {
        let (path, range) = match &self.array.shards {
            None => (self.file(place), None),
            Some(shards) => {
                let counts = shards.count.iter();
                let outer: Vec<u64> = place
                    .iter()
                    .zip(counts.clone())
                    .map(|(p, n)| p / n)
                    .collect();
                let inner = place.iter().zip(counts);
                let at = inner.fold(0, |at, (p, n)| at * n + p % n);
                let path = self.file(&outer);
                let table = self.table(&path, outer)?;
                let Some([start, len]) = table.map(|t| t[at as usize]) else {
                    return Ok(None);
                };
                if [start, len] == [u64::MAX; 2] {
                    return Ok(None);
                }
                (path, Some((start, len)))
            }
        };
        let Some((file, size)) = self.open(&path)? else {
            return Ok(None);
        };
        let (start, len) = range.unwrap_or((0, size));
        // what is packed is hardly ever larger than what is not
        let most = self.bytes as u64 + self.bytes as u64 / 8 + 65_536;
        if start.checked_add(len).is_none_or(|end| end > size) || len > most {
            let found = format!("a chunk of {len} bytes at {start} of {size}");
            return Err(Error::format(&path, found, format!("at most {most}")));
        }
        let mut bytes = vec![0; len as usize];
        file.read_exact_at(&mut bytes, start)
            .map_err(|e| Error::io(&path, "read", e))?;
        Ok(Some((path, bytes)))
    }

    /// The table of a shard.
    fn table(&self, path: &Path, shard: Vec<u64>) -> Result<Option<Table>> {
        let tables = || self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(table) = tables().get(&shard) {
            return Ok(table.clone());
        }
        let table = self.read_table(path)?.map(Arc::new);
        let mut tables = tables();
        let kept: usize = tables.values().flatten().map(|t| t.len()).sum();
        if kept + table.as_ref().map_or(0, |t| t.len()) > RECENT || tables.len() > RECENT {
            tables.clear();
        }
        tables.insert(shard, table.clone());
        Ok(table)
    }

    fn read_table(&self, path: &Path) -> Result<Option<Vec<[u64; 2]>>> {
        let (Some(shards), Some((file, size))) = (&self.array.shards, self.open(path)?) else {
            return Ok(None);
        };
        let count = shards
            .count
            .iter()
            .try_fold(16u64, |n, &c| n.checked_mul(c));
        let len = count
            .unwrap_or(u64::MAX)
            .saturating_add(4 * shards.index.len() as u64);
        let Some(end) = size.checked_sub(len) else {
            let found = format!("a shard of {size} bytes");
            let expected = format!("{len} bytes of its table alone");
            return Err(Error::format(path, found, expected));
        };
        let mut bytes = vec![0; len as usize];
        file.read_exact_at(&mut bytes, if shards.at_end { end } else { 0 })
            .map_err(|e| Error::io(path, "read", e))?;
        let words = codec::unpack(&shards.index, bytes, count.unwrap_or(0) as usize);
        let words = words.map_err(|e| {
            Error::format(
                path,
                format!("a table of a shard with {e:?}"),
                "a whole one",
            )
        })?;
        let words = words
            .as_chunks::<8>()
            .0
            .iter()
            .map(|w| u64::from_le_bytes(*w));
        Ok(Some(words.collect::<Vec<_>>().as_chunks::<2>().0.to_vec()))
    }

    /// Copies what of a chunk is inside the volume, x fastest.
    fn put(&self, index: [u32; 3], mut stored: Vec<u8>, out: &mut [u8]) {
        let array = &self.array;
        let sample = if array.half { 2 } else { array.dtype.bytes() };
        if array.coding.endian != Endian::NATIVE && sample > 1 {
            stored.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
        }
        // samples from one to the next along each axis of the array
        let mut strides = vec![0; array.chunk.len()];
        let mut stride = 1;
        for &axis in array.coding.order.iter().rev() {
            strides[axis] = stride;
            stride *= array.chunk[axis] as usize;
        }
        let shape = self.shape();
        let [nx, ny, nz] = [0, 1, 2].map(|a| {
            let start = u64::from(index[a]) * u64::from(shape[a]);
            u64::from(shape[a]).min(u64::from(self.dims.0[a]) - start) as usize
        });
        let [sx, sy, sz] = self.axes.map(|a| strides[a]);
        let size = array.dtype.bytes();
        let mut rows = out.chunks_exact_mut(nx * size);
        for k in 0..nz {
            for (j, row) in (&mut rows).take(ny).enumerate() {
                let start = k * sz + j * sy;
                if sx == 1 && !array.half {
                    row.copy_from_slice(&stored[start * size..(start + nx) * size]);
                    continue;
                }
                for (i, out) in row.chunks_exact_mut(size).enumerate() {
                    let at = (start + i * sx) * sample;
                    let from = &stored[at..at + sample];
                    if array.half {
                        let value = half::to_f32(u16::from_ne_bytes([from[0], from[1]]));
                        out.copy_from_slice(&value.to_ne_bytes());
                    } else {
                        out.copy_from_slice(from);
                    }
                }
            }
        }
        debug_assert!(array.dtype == Dtype::F32 || !array.half);
    }
}
