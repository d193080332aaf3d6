//! VTK image data (`.vti`): samples appended to the header or inside of it, as they are, as base64 or
//! as text, plain or in blocks of zlib or LZ4: what ParaView and VTK write.
//!
//! The format is described at <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.
//! The volume is the file's only array of points or cells, or its active scalars. Voxels are the points of point
//! data and the cells of cell data, whose centres lie half a step from the points. `Direction` is a matrix by rows;
//! `Origin` is the place of index 0, from which the extent may start elsewhere. Base64 and text are
//! first unpacked to an unnamed file in the folder for temporary files (`TMPDIR`).

mod blocks;
mod tags;
mod text;

use crate::error::{Error, Result};
use crate::grid::{Dims, Origin, Placement, Provenance};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::io::blob::{Blob, Bytes};
use crate::volume::io::byte_source::{ByteSource, FileSource};
use crate::volume::options::{Choice, OpenOptions};
use crate::volume::{Dtype, Endian};
use blocks::{Packing, Place};
use std::path::Path;
use std::sync::Arc;
use tags::Tag;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "vti",
    title: "VTK image data",
    extensions: &["vti"],
    takes: &[Choice::Resample, Choice::Dataset],
    starts: is_vti,
    parse: Some(|input, options| parse(input.path, options)),
    ..Format::BASE
};

/// True if a file begins as one of VTK's XML files.
pub(crate) fn is_vti(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    text.trim_start().starts_with('<') && text.contains("<VTKFile")
}

/// An array of the file and whether its numbers belong to cells.
#[derive(Clone, Copy)]
struct Array<'a> {
    tag: &'a Tag,
    cells: bool,
    /// Named as the scalars of its points or cells.
    active: bool,
}

impl Array<'_> {
    fn name(&self) -> &str {
        self.tag.get("Name").unwrap_or_default()
    }

    /// Its name with what its numbers belong to, as `--dataset` takes it.
    fn path(&self) -> String {
        let of = if self.cells { "CellData" } else { "PointData" };
        format!("{of}/{}", self.name())
    }
}

/// The header's tags.
struct Head<'a> {
    path: &'a Path,
    tags: Vec<Tag>,
}

impl<'a> Head<'a> {
    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn one(&self, name: &str) -> Result<&Tag> {
        let mut tags = self.tags.iter().filter(|t| t.name() == name);
        match (tags.next(), tags.next()) {
            (Some(tag), None) => Ok(tag),
            (None, _) => Err(self.wrong(format!("no {name}"), "image data of one piece")),
            _ => {
                let count = self.tags.iter().filter(|t| t.name() == name).count();
                let what = format!("VTK image data with {count} {name}s");
                let hint =
                    "save it as one piece, as vtkXMLImageDataWriter and ParaView's Save Data do";
                Err(Error::unsupported(self.path, what, hint))
            }
        }
    }

    fn numbers<const N: usize>(&self, tag: &Tag, key: &str) -> Result<Option<[f64; N]>> {
        let Some(text) = tag.get(key) else {
            return Ok(None);
        };
        let values: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
        let array = values.and_then(|v| <[f64; N]>::try_from(v).ok());
        match array.filter(|a| a.iter().all(|v| v.is_finite())) {
            Some(array) => Ok(Some(array)),
            None => Err(self.wrong(format!("{key}=\"{text}\""), "finite numbers")),
        }
    }

    /// First and last index along each axis.
    fn extent(&self) -> Result<[f64; 6]> {
        let (image, piece) = (self.one("ImageData")?, self.one("Piece")?);
        let whole = self.numbers(image, "WholeExtent")?;
        match (whole, self.numbers(piece, "Extent")?) {
            (Some(whole), Some(part)) if whole == part => Ok(whole),
            (Some(whole), None) => Ok(whole),
            (a, b) => {
                let text = |extent: Option<[f64; 6]>| {
                    extent.map_or("none".into(), |e| e.map(|v| v.to_string()).join(" "))
                };
                let found = format!("WholeExtent {}, Extent {}", text(a), text(b));
                Err(self.wrong(found, "one piece that is the whole image"))
            }
        }
    }

    fn placement(&self, extent: [f64; 6], cells: bool) -> Result<(Placement, Provenance)> {
        let image = self.one("ImageData")?;
        let (spacing, origin) = (
            self.numbers::<3>(image, "Spacing")?,
            self.numbers(image, "Origin")?,
        );
        let stated = |there: bool| if there { Origin::File } else { Origin::Default };
        let from = Provenance {
            spacing: [stated(spacing.is_some()); 3],
            unit: Origin::Default,
            origin: stated(origin.is_some()),
            ..Provenance::default()
        };
        let mut place = Placement {
            spacing: spacing.unwrap_or([1.0; 3]),
            origin: origin.unwrap_or([0.0; 3]),
            ..Placement::default()
        };
        if let Some(rows) = self.numbers::<9>(image, "Direction")? {
            place.directions =
                std::array::from_fn(|axis| [rows[axis], rows[3 + axis], rows[6 + axis]]);
            let axes = place.directions.map(glam::DVec3::from);
            if axes.iter().any(|axis| (axis.length() - 1.0).abs() >= 1e-4) {
                let found = format!("Direction=\"{rows:?}\"");
                return Err(self.wrong(found, "three unit vectors at right angles"));
            }
        }
        let half = if cells { 0.5 } else { 0.0 };
        place.origin = place.world([extent[0] + half, extent[2] + half, extent[4] + half]);
        for axis in 0..3 {
            if place.spacing[axis] < 0.0 {
                place.spacing[axis] = -place.spacing[axis];
                place.directions[axis] = place.directions[axis].map(|v| 0.0 - v);
            }
        }
        Ok((place, from))
    }

    /// The arrays of points and cells, without those that VTK keeps for itself.
    fn arrays(&self) -> Vec<Array<'_>> {
        let mut arrays = Vec::new();
        let mut inside = None;
        for tag in &self.tags {
            match tag.name() {
                "PointData" | "CellData" => inside = Some(tag),
                "DataArray" => {
                    let Some(owner) = inside else { continue };
                    let name = tag.get("Name");
                    let active = name.is_some() && owner.get("Scalars") == name;
                    let cells = owner.name() == "CellData";
                    if !name.is_some_and(|n| n.starts_with("vtkGhost")) {
                        arrays.push(Array { tag, cells, active });
                    }
                }
                _ => {}
            }
            if tag.text.starts_with("/PointData")
                || tag.text.starts_with("/CellData")
                || tag.text.ends_with('/') && tag.name() != "DataArray"
            {
                inside = None;
            }
        }
        arrays
    }

    /// The array that is the volume, and what to say of the others.
    fn array(&self, options: &OpenOptions) -> Result<(Array<'_>, Option<String>)> {
        let arrays = self.arrays();
        let list = || {
            arrays
                .iter()
                .map(Array::path)
                .collect::<Vec<_>>()
                .join(", ")
        };
        let fits = |array: &&Array| match &options.dataset {
            Some(wanted) => *wanted == array.path() || wanted == array.name(),
            None => arrays.len() == 1 || array.active,
        };
        let found: Vec<&Array> = arrays.iter().filter(fits).collect();
        match found[..] {
            [one] => {
                let others = (arrays.len() > 1 && options.dataset.is_none()).then(|| {
                    format!(
                        "{} is the active one of the arrays {}: --dataset takes another",
                        one.path(),
                        list()
                    )
                });
                Ok((*one, others))
            }
            [] if arrays.is_empty() => {
                let hint = "save it with the array that is the volume as point or cell data";
                Err(Error::unsupported(
                    self.path,
                    "VTK image data without an array",
                    hint,
                ))
            }
            _ => {
                let wanted = options.dataset.as_ref();
                let asked = wanted.map_or(
                    format!("nothing, and several arrays in {}", self.path.display()),
                    |w| format!("\"{w}\""),
                );
                Err(Error::usage(
                    "--dataset",
                    asked,
                    format!("one of {}", list()),
                ))
            }
        }
    }

    fn dtype(&self, array: &Tag) -> Result<Dtype> {
        let components = array.get("NumberOfComponents").unwrap_or("1");
        let name = array.get("type").unwrap_or_default();
        let no =
            |what: String| Error::unsupported(self.path, what, "save one number per point or cell");
        if components != "1" {
            return Err(no(format!("a VTK array of {components} components")));
        }
        Ok(match name {
            "UInt8" => Dtype::U8,
            "Int8" => Dtype::I8,
            "UInt16" => Dtype::U16,
            "Int16" => Dtype::I16,
            "UInt32" => Dtype::U32,
            "Int32" => Dtype::I32,
            "Float32" => Dtype::F32,
            "Float64" => Dtype::F64,
            "Int64" | "UInt64" => {
                let what = format!("a VTK array of type {name}");
                let hint = "save it as Int32 or UInt32, or as Float64, which holds whole numbers up to 2^53";
                return Err(Error::unsupported(self.path, what, hint));
            }
            _ => return Err(no(format!("a VTK array of type {name}"))),
        })
    }

    fn packing(&self, file: &Tag) -> Result<Packing> {
        match file.get("compressor") {
            None => Ok(Packing::None),
            Some("vtkZLibDataCompressor") => Ok(Packing::Zlib),
            Some("vtkLZ4DataCompressor") => Ok(Packing::Lz4),
            Some(other) => {
                let what = format!("the compressor {other}");
                let hint = "save it with LZ4 or ZLib, or without compression";
                Err(Error::unsupported(self.path, what, hint))
            }
        }
    }

    /// The tag of the whole file, which must be one of image data.
    fn image_data(&self) -> Result<&Tag> {
        let file = self.one("VTKFile")?;
        let kind = file.get("type").unwrap_or_default();
        if kind == "ImageData" {
            return Ok(file);
        }
        let hint = "volumes are ImageData (.vti): of a grid, save it as that, as with ParaView's filter Resample To \
                    Image";
        let what = format!("VTK data of type {kind}");
        Err(Error::unsupported(self.path, what, hint))
    }

    fn byte_order(&self, file: &Tag) -> Result<Endian> {
        match file.get("byte_order") {
            Some("LittleEndian") | None => Ok(Endian::Little),
            Some("BigEndian") => Ok(Endian::Big),
            Some(other) => Err(self.wrong(other, "LittleEndian or BigEndian")),
        }
    }

    /// Bytes of a number of an array's header.
    fn word(&self, file: &Tag) -> Result<u64> {
        match file.get("header_type") {
            Some("UInt32") | None => Ok(4),
            Some("UInt64") => Ok(8),
            Some(other) => Err(self.wrong(other, "UInt32 or UInt64")),
        }
    }

    /// The samples of an array, wherever they are.
    fn samples(&self, bytes: Bytes, array: &Tag, stored: Stored) -> Result<Box<dyn ByteSource>> {
        match array.get("format") {
            Some("appended") => match self.appended(&bytes, array)? {
                (at, false) => stored.source(bytes, at),
                (at, true) => stored.decoded(&bytes, at),
            },
            Some("binary") => stored.decoded(&bytes, array.end),
            Some("ascii") => {
                let file: Arc<_> = text::decimal(&bytes, array.end, stored.dtype, stored.voxels)?;
                Ok(Box::new(FileSource {
                    file,
                    path: self.path.to_path_buf(),
                    offset: 0,
                }))
            }
            other => Err(self.wrong(format!("format {other:?}"), "appended, binary or ascii")),
        }
    }

    /// Position and encoding of the appended samples.
    fn appended(&self, bytes: &Bytes, array: &Tag) -> Result<(u64, bool)> {
        let tag = self.one("AppendedData")?;
        let base64 = match tag.get("encoding") {
            Some("base64") => true,
            Some("raw") => false,
            other => return Err(self.wrong(format!("encoding {other:?}"), "raw or base64")),
        };
        // an underscore, perhaps after a line end, stands in front
        let mut gap = [0; 64];
        let len = bytes.len().saturating_sub(tag.end).min(64) as usize;
        bytes.read_at(tag.end, &mut gap[..len])?;
        let mark = gap[..len].iter().position(|&b| b == b'_');
        let offset = array
            .get("offset")
            .and_then(|o| o.trim().parse::<u64>().ok());
        let place = mark.zip(offset).and_then(|(mark, offset)| {
            let base = tag.end + mark as u64 + 1;
            base.checked_add(offset)
        });
        match place {
            Some(place) => Ok((place, base64)),
            None => Err(self.wrong(format!("`{}`", array.text), "an array with an offset")),
        }
    }
}

/// How an array is stored.
#[derive(Clone, Copy)]
struct Stored {
    dtype: Dtype,
    voxels: u64,
    packing: Packing,
    /// Bytes of a number of the array's header.
    word: u64,
    endian: Endian,
}

impl Stored {
    /// Bytes of all samples.
    fn total(&self) -> u64 {
        self.voxels * self.dtype.bytes() as u64
    }

    /// The samples whose header is `at` that position.
    fn source(&self, bytes: Bytes, at: u64) -> Result<Box<dyn ByteSource>> {
        let place = Place {
            at,
            word: self.word,
            endian: self.endian,
        };
        let total = self.total();
        if self.packing != Packing::None {
            let blocks = blocks::Blocks::open(bytes, place, total, self.packing)?;
            return Ok(Box::new(blocks));
        }
        let start = place.at.saturating_add(place.word);
        let stored = place.number(&bytes, 0)?;
        let end = start.checked_add(total);
        if stored != total || end.is_none_or(|end| end > bytes.len()) {
            let found = format!("{stored} bytes of samples at {start}");
            let expected = format!("{total} inside the file, as size and type say");
            return Err(Error::format(bytes.path(), found, expected));
        }
        Ok(Box::new(FileSource {
            path: bytes.path().to_path_buf(),
            offset: start,
            file: bytes.file(),
        }))
    }

    /// The samples in base64 text that holds their header too.
    fn decoded(&self, bytes: &Bytes, at: u64) -> Result<Box<dyn ByteSource>> {
        // a table of blocks is as long as the smallest blocks make it
        let most = match self.packing {
            Packing::None => self.total() + 8,
            _ => u64::MAX,
        };
        let (file, len) = text::base64(bytes, at, most)?;
        let inside = Blob::part(bytes.path().to_path_buf(), file, 0, len).open()?;
        self.source(inside, 0)
    }
}

/// Parses a `.vti` file.
///
/// # Errors
/// [`Error::Unsupported`] by name for other data sets, encodings and compressors, [`Error::Format`]
/// for headers that contradict themselves or the file's length.
pub(crate) fn parse(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let bytes = Blob::file(path)?.open()?;
    let head = Head {
        path,
        tags: tags::read(&bytes)?,
    };
    let file = head.image_data()?;
    let extent = head.extent()?;
    let (array, note) = head.array(options)?;
    let points = if array.cells { 0.0 } else { 1.0 };
    let size =
        [0, 1, 2].map(|a| (extent[2 * a + 1] - extent[2 * a] + points).clamp(0.0, 1e12) as u64);
    let dims = Dims::new(size).map_err(|e| e.of_header(head.path, "an image"))?;
    let stored = Stored {
        dtype: head.dtype(array.tag)?,
        voxels: dims.voxels(),
        packing: head.packing(file)?,
        word: head.word(file)?,
        endian: head.byte_order(file)?,
    };
    let total = stored.total();
    if total > bytes.len().saturating_mul(1032) {
        let found = format!("{} bytes for {total} bytes of samples", bytes.len());
        return Err(head.wrong(found, "a whole file"));
    }
    let endian = match array.tag.get("format") {
        Some("ascii") => text::ORDER,
        _ => stored.endian,
    };
    let samples = head.samples(bytes, array.tag, stored)?;
    let (placement, provenance) = head.placement(extent, array.cells)?;
    Ok(VolumeDescriptor {
        endian: Some(endian),
        placement,
        provenance,
        notes: note.into_iter().collect(),
        ..VolumeDescriptor::new("vti", dims, stored.dtype, Samples::Bytes(samples))
    })
}
