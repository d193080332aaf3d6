//! HDF5 and the formats in it: NeXus, NetCDF-4, MINC 2, Imaris, MATLAB 7.3 and others.
//!
//! A volume is a dataset with three axes of more than one entry, or one of which a channel and a time are chosen. It
//! is found by itself if there is one. Names of axes, sizes of voxels and scales of values are taken from the
//! attributes of the common writers; without names the last axis is x. Filters are those of the library itself
//! and, of plugins, LZF, LZ4, Blosc, bitshuffle and Zstandard. What is not read is refused by name.

mod attributes;
mod axes;
mod choose;
mod chunks;
mod filter;
mod geometry;
mod image;
mod minc;
mod missing;
mod number;
mod place;
mod scale;
mod series;
mod tree;

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::adapters::values::Values;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::formats::optional;
use crate::volume::formats::optional::hdf5::SIGNATURE;
use crate::volume::io::blob::Blob;
use crate::volume::io::chunked::Chunks;
use crate::volume::io::paged::MAX_CHUNK;
use crate::volume::options::OpenOptions;
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written;
use crate::volume::{Dtype, Endian};
use axes::{Axes, shape_text};
use choose::{Chosen, chosen};
use chunks::{H5Chunks, pieces};
use geometry::Geometry;
use hdf5_reader::error::Error as H5Error;
use hdf5_reader::{ByteOrder, FileStorage, Hdf5File};
use missing::{Stored, missing};
use number::{Number, type_text};
use place::Place;
use series::{Kind, Member};
use std::path::Path;
use std::sync::Arc;

/// The library keeps this of unpacked chunks; the volume has a cache of its own.
const LIBRARY_CACHE: usize = 1 << 20;
/// The first piece is unpacked at once, to see whether that goes, unless it is larger than this.
const TRIED: u64 = 4 << 20;
/// The format.
pub(crate) const FORMAT: Format = Format {
    looks: Some(|path, _| has_signature_inside(path)),
    parse: Some(|input, options| parse(input.path, options)),
    ..optional::hdf5::FORMAT
};

/// True for a file that begins as HDF5 does behind a block of the user's own of 512 bytes, or 1024, and so on, as in
/// MATLAB's files.
fn has_signature_inside(path: &Path) -> bool {
    let Ok(bytes) = Blob::file(path).and_then(|blob| blob.open()) else {
        return false;
    };
    let places = (9..63).map(|n| 1u64 << n);
    let mut inside = places.take_while(|at| at + SIGNATURE.len() as u64 <= bytes.len());
    inside.any(|at| {
        let mut found = [0; SIGNATURE.len()];
        bytes.read_at(at, &mut found).is_ok() && found == SIGNATURE
    })
}

/// Opens the dataset that the options name, or the only one that is a volume.
///
/// # Errors
/// [`Error::Usage`] with the list if there are several; [`Error::Unsupported`] by name for types,
/// layouts and filters that are not read, [`Error::Format`] for damaged files.
pub(crate) fn parse(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let storage = FileStorage::open(path).map_err(|e| broken(path, "", &e))?;
    let limits = hdf5_reader::OpenOptions::default()
        .with_chunk_cache_bytes(LIBRARY_CACHE)
        .with_max_chunk_bytes(MAX_CHUNK as usize)
        .with_max_read_bytes(MAX_CHUNK as usize)
        .with_filter_registry(filter::registry());
    let file = Hdf5File::from_storage_with_options(Arc::new(storage), limits)
        .map_err(|e| broken(path, "", &e))?;
    let tree = tree::Tree::of(&file).map_err(|e| broken(path, "/", &e))?;
    let found = chosen(path, &file, &tree, options)?;
    let place = Place::of(&file, &tree, &found.name, &found.dataset);
    descriptor(path, &place, &found, options)
}

/// What the library's error means: what is wrong, and what to do about it if it is only not supported.
fn meaning(error: &H5Error) -> (String, Option<&'static str>) {
    // the library wraps the cause in text that says where
    let text = error.to_string();
    if text.contains("unsupported layout class 3") {
        let hint = "copy it to a plain one, as with `h5repack -l CONTI`";
        return ("a virtual dataset of HDF5".into(), Some(hint));
    }
    if let Some((_, id)) = text.split_once("filter id ") {
        let number: String = id.chars().take_while(char::is_ascii_digit).collect();
        let hint = "write it anew with one that HDF5 itself has, as with `h5repack -f GZIP=1`";
        return (filter::name(&number), Some(hint));
    }
    let hint = text.contains("unsupported");
    (
        format!("HDF5 with {text}"),
        hint.then_some("write the file anew, as with `h5repack`"),
    )
}

/// The library's error as one of ours.
fn broken(path: &Path, name: &str, error: &H5Error) -> Error {
    if let H5Error::Io(e) = error {
        return Error::io(path, "read", std::io::Error::new(e.kind(), e.to_string()));
    }
    let place = match name {
        "" => String::new(),
        _ => format!(" ({name})"),
    };
    match meaning(error) {
        (what, Some(hint)) => Error::unsupported(path, format!("{what}{place}"), hint),
        (what, None) => Error::format(path, format!("{what}{place}"), "a whole file")
            .with_hint("the file is cut short or damaged"),
    }
}

/// A dataset as messages call it.
fn described(place: &Place) -> String {
    let (shape, dtype) = (place.dataset.shape(), place.dataset.dtype());
    format!("{} of {}", shape_text(shape), type_text(dtype))
}

/// How to read a dataset as a volume.
///
/// # Errors
/// Why it is none.
fn judged(place: &Place) -> Result<(Number, Axes), String> {
    let dataset = place.dataset;
    let raw = dataset.raw_datatype().map_err(|e| meaning(&e).0)?;
    let number = Number::of(dataset.dtype(), &raw)?;
    match place.attributes.text("MATLAB_class").as_deref() {
        Some(class @ ("char" | "cell" | "struct" | "function_handle")) => {
            return Err(format!("a {class} of MATLAB"));
        }
        _ if place.attributes.has("MATLAB_empty") => return Err("an empty array of MATLAB".into()),
        _ => {}
    }
    let names = axes::agreed(place.names())?;
    if names.is_none()
        && let Some(reason) = vague_order(place).or_else(|| place.projections())
    {
        return Err(reason);
    }
    let axes = Axes::of(dataset.shape(), names.as_ref())?;
    let stored = Stored::of(place.file, dataset).map_err(|e| meaning(&e).0)?;
    if stored.external.is_some() {
        return Err("its samples lie in other files (external storage): copy it, as with `h5repack -l CONTI`".into());
    }
    Ok((number, axes))
}

/// Why the order that attributes state cannot be told, and what to do.
fn vague_order(place: &Place) -> Option<String> {
    let own = place.attributes.written().vague_order();
    let why = own.or_else(|| place.group.written().vague_order())?;
    Some(format!(
        "{why}: name its axes by the attribute DIMENSION_LABELS, as z, y, x"
    ))
}

/// The entry of an axis that is not of space.
fn entry(
    option: &str,
    what: &str,
    given: Option<u32>,
    axis: Option<usize>,
    shape: &[u64],
) -> Result<u64> {
    let Some(n) = axis.map(|a| shape[a]) else {
        return match given {
            None => Ok(0),
            Some(n) => Err(Error::usage(
                option,
                n.to_string(),
                format!("it with a dataset of several {what}s"),
            )),
        };
    };
    match given {
        Some(given) if u64::from(given) < n => Ok(given.into()),
        Some(given) => Err(Error::usage(
            option,
            given.to_string(),
            format!("0 to {}", n - 1),
        )),
        None => {
            let found = format!("nothing, and {n} {what}s");
            Err(Error::usage(
                option,
                found,
                format!("one of 0 to {}", n - 1),
            ))
        }
    }
}

fn descriptor(
    path: &Path,
    place: &Place,
    found: &Chosen,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let (number, axes) = &found.how;
    let member = Member::of(place.name)
        .filter(|m| m.kind != Kind::BigDataViewer || number.dtype == Dtype::I16);
    let shape = place.dataset.shape();
    let mut entries = vec![0; shape.len()];
    // those of a file of many datasets are chosen already
    let taken = found.by_parts;
    let given = |option: Option<u32>| option.filter(|_| !taken);
    let channel = entry(
        "--channel",
        "channel",
        given(options.channel),
        axes.channel,
        shape,
    )?;
    let time = entry("--time", "time", given(options.time), axes.time, shape)?;
    for (axis, at) in [(axes.channel, channel), (axes.time, time)] {
        if let Some(axis) = axis {
            entries[axis] = at;
        }
    }
    let mut draft = Draft {
        path,
        place,
        axes,
        entries,
        notes: found.notes.clone(),
        warnings: Vec::new(),
    };
    draft.open(*number, member, options)
}

/// A volume in the making.
struct Draft<'a> {
    path: &'a Path,
    place: &'a Place<'a>,
    axes: &'a Axes,
    entries: Vec<u64>,
    notes: Vec<String>,
    warnings: Vec<Warning>,
}

impl Draft<'_> {
    fn open(
        &mut self,
        number: Number,
        member: Option<Member>,
        options: &OpenOptions,
    ) -> Result<VolumeDescriptor> {
        let size = self.size(member)?;
        let dims = Dims::new(size).map_err(|e| e.of_header(self.path, "a dataset"))?;
        let (number, values) = self.values(number, member)?;
        let geometry = self.geometry(member, size, options)?;
        let (placement, provenance, notes, warnings) = geometry.place();
        let (path, dataset) = (self.path, self.place.dataset);
        let name = self.place.name.to_owned();
        let shape =
            pieces(dataset, self.axes.volume, dims, number.size as u64).map_err(|what| {
                let what = format!("the HDF5 dataset {name} with {what}");
                Error::unsupported(path, what, "write it anew with other chunks")
            })?;
        self.stored(size, &number)?;
        self.describe(&number);
        self.notes.extend(notes);
        self.warnings.extend(warnings);
        let chunks = H5Chunks {
            path: path.to_path_buf(),
            name,
            dataset: dataset.clone(),
            number,
            shape,
            dims,
            axes: self.axes.volume,
            entry: self.entries.clone(),
        };
        // what only a chunk shows is better known now than after an hour
        let first = chunks.size([0; 3]).iter().product::<u64>() * number.dtype.bytes() as u64;
        if first <= TRIED && chunks.scratch() <= 4 * TRIED {
            chunks.decode([0; 3], &mut vec![0; first as usize])?;
        }
        Ok(VolumeDescriptor {
            endian: Some(match number.order {
                ByteOrder::BigEndian => Endian::Big,
                ByteOrder::LittleEndian => Endian::Little,
            }),
            placement,
            provenance,
            values,
            notes: std::mem::take(&mut self.notes),
            warnings: std::mem::take(&mut self.warnings),
            ..VolumeDescriptor::new(
                "hdf5",
                dims,
                number.dtype,
                Samples::Chunks(Box::new(chunks)),
            )
        })
    }

    /// What a user should know of the array.
    fn describe(&mut self, number: &Number) {
        self.notes.insert(0, format!("dataset {}", self.place.name));
        let unread = self.place.other_names();
        self.warnings.extend(unread.into_iter().map(Warning::from));
        self.notes.extend(self.axes.note.clone());
        self.notes.extend(number.note());
        if self.place.attributes.has("MATLAB_class") {
            let note =
                "an array of MATLAB: A(i, j, k) is the voxel x = i - 1, y = j - 1, z = k - 1";
            self.notes.push(note.into());
        }
    }

    fn no(&self, what: impl std::fmt::Display, hint: &str) -> Error {
        let what = format!("the HDF5 dataset {} with {what}", self.place.name);
        Error::unsupported(self.path, what, hint)
    }

    /// Voxels along x, y and z: those of the array, without what it is padded by.
    fn size(&mut self, member: Option<Member>) -> Result<[u64; 3]> {
        let size = self.axes.volume.map(|a| self.place.dataset.shape()[a]);
        if member.is_none_or(|m| m.kind != Kind::Imaris) {
            return Ok(size);
        }
        let Some(own) = series::true_size(self.place) else {
            self.warnings.push(
                "the file does not state the size of the image: its array may be padded to whole chunks".into(),
            );
            return Ok(size);
        };
        let text = |size: [u64; 3]| shape_text(&size);
        if own.iter().zip(size).any(|(&own, size)| own > size) {
            let found = format!("an image of {} in an array of {}", text(own), text(size));
            return Err(Error::format(
                self.path,
                found,
                "an array that holds the image",
            ));
        }
        if own != size {
            let note = format!(
                "the array of {} is padded: cut to {}",
                text(size),
                text(own)
            );
            self.notes.push(note);
        }
        Ok(own)
    }

    fn values(
        &mut self,
        number: Number,
        member: Option<Member>,
    ) -> Result<(Number, Option<Values>)> {
        match member.map(|m| m.kind) {
            Some(Kind::Minc) => {
                let (axes, entries) = (self.axes.volume, &self.entries);
                let values = minc::values(self.place, axes, entries, &number, &mut self.warnings);
                let values =
                    values.map_err(|what| self.no(what, "convert it with MINC's own tools"))?;
                Ok((number, values))
            }
            Some(Kind::BigDataViewer) => {
                let note = "i16 read as u16, as BigDataViewer does; the size of a voxel is in its .xml, which is not read";
                self.notes.push(note.into());
                Ok((number.read_as(Dtype::U16), None))
            }
            _ => scale::values(self.path, self.place, number, &mut self.warnings),
        }
    }

    fn geometry(
        &self,
        member: Option<Member>,
        size: [u64; 3],
        options: &OpenOptions,
    ) -> Result<Geometry> {
        let own = options.spacing.is_some();
        let geometry = match member.map(|m| m.kind) {
            Some(Kind::Imaris) => series::extent(self.place.file, size),
            Some(Kind::Minc) => match minc::geometry(self.place, self.axes.volume) {
                Ok(geometry) => geometry,
                Err(_) if own => Geometry::default(),
                Err(what) => return Err(self.no(what, "give --spacing and --unit")),
            },
            _ => match image::placement(self.place, size) {
                Ok(Some(whole)) => Geometry {
                    whole: Some(whole),
                    ..Geometry::default()
                },
                Ok(None) => self.place.geometry(self.axes),
                Err(_) if own => Geometry::default(),
                Err(what) => return Err(self.no(what, "give --spacing and --unit")),
            },
        };
        match &geometry.uneven {
            Some(what) if !own => Err(self.no(
                what,
                "resample it, or give --spacing and --unit to take it as even",
            )),
            _ => Ok(geometry),
        }
    }

    /// Looks at filters and at chunks that are not there.
    fn stored(&mut self, size: [u64; 3], number: &Number) -> Result<()> {
        let (file, dataset) = (self.place.file, self.place.dataset);
        let fail = |e: H5Error| broken(self.path, self.place.name, &e);
        let stored = Stored::of(file, dataset).map_err(fail)?;
        let filters = stored.filters.iter().flat_map(|f| &f.filters);
        if let Some(unknown) = filters.map(|f| f.id).find(|&id| !filter::is_known(id)) {
            return Err(fail(H5Error::UnsupportedFilter(format!(
                "filter id {unknown}"
            ))));
        }
        let mut part: Vec<_> = self.entries.iter().map(|&at| at..at + 1).collect();
        for (&axis, n) in self.axes.volume.iter().zip(size) {
            part[axis] = 0..n;
        }
        let value = dataset.fill_value().and_then(|f| f.value.as_ref());
        let value = value
            .and_then(|v| number.show(v))
            .unwrap_or_else(|| "0".into());
        let count = missing(file, dataset, &stored, &part).map_err(fail)?;
        written::missing(count, &value, &mut self.notes, &mut self.warnings);
        Ok(())
    }
}
