//! VTK image data (`.vti`) with appended raw samples, plain or in zlib blocks: what ParaView writes.
//!
//! The format is described at <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.
//! The volume is the point data's active scalars, or its only array. `Direction` is a matrix by rows;
//! `Origin` is the place of index 0, from which the extent may start elsewhere.

mod blocks;

use super::blob::{Blob, Bytes};
use super::layout::{Recipe, Samples};
use super::source::ByteSource;
use super::{Dtype, Endian};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement};
use crate::manifest::{Origin, Provenance};
use std::path::Path;

/// A header in front of the samples is never longer.
const MAX_HEAD: u64 = 1 << 20;

/// True if a file begins as one of VTK's XML files.
pub(super) fn is_vti(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    text.trim_start().starts_with('<') && text.contains("<VTKFile")
}

/// The attribute of a tag.
fn attribute<'a>(tag: &'a str, key: &str) -> Option<&'a str> {
    let at = tag.find(&format!(" {key}=\""))?;
    tag[at + key.len() + 3..].split('"').next()
}

/// The header's text and where the appended samples begin.
struct Head<'a> {
    path: &'a Path,
    text: String,
    base: u64,
}

impl<'a> Head<'a> {
    fn read(path: &'a Path, blob: &Blob) -> Result<Self> {
        let bytes = blob.head(MAX_HEAD)?;
        let name = b"<AppendedData";
        let at = bytes.windows(name.len()).position(|w| w == name);
        let mark = at.and_then(|at| {
            let close = at + bytes[at..].iter().position(|&b| b == b'>')?;
            let mark = close + bytes[close..].iter().position(|&b| b == b'_')?;
            Some((at, close, mark))
        });
        let Some((at, close, mark)) = mark else {
            let what = "a VTK file without appended samples (inline base64 or text)";
            let hint = "save it with appended raw data, as ParaView does by default";
            return Err(Error::unsupported(path, what, hint));
        };
        if !bytes[at..close].windows(5).any(|w| w == b"\"raw\"") {
            let hint = "save it with appended raw data";
            return Err(Error::unsupported(path, "appended base64 data", hint));
        }
        Ok(Head {
            path,
            text: String::from_utf8_lossy(&bytes[..at]).replace(['\n', '\r', '\t'], " "),
            base: mark as u64 + 1,
        })
    }

    fn tags(&self, name: &'static str) -> impl Iterator<Item = &str> {
        let tags = self
            .text
            .split('<')
            .map(|t| t.split('>').next().unwrap_or_default());
        tags.filter(move |t| t.split_whitespace().next() == Some(name))
    }

    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn one(&self, name: &'static str) -> Result<&str> {
        let mut tags = self.tags(name);
        match (tags.next(), tags.next()) {
            (Some(tag), None) => Ok(tag),
            (None, _) => Err(self.wrong(format!("no {name}"), "image data of one piece")),
            _ => {
                let what = format!("VTK image data with several {name}");
                Err(Error::unsupported(self.path, what, "save it as one piece"))
            }
        }
    }

    fn numbers<const N: usize>(&self, tag: &str, key: &str) -> Result<Option<[f64; N]>> {
        let Some(text) = attribute(tag, key) else {
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
                let found = format!("the extents {a:?} and {b:?}");
                Err(self.wrong(found, "one piece that is the whole image"))
            }
        }
    }

    fn placement(&self, extent: [f64; 6]) -> Result<Placement> {
        let image = self.one("ImageData")?;
        let mut place = Placement {
            spacing: self.numbers(image, "Spacing")?.unwrap_or([1.0; 3]),
            origin: self.numbers(image, "Origin")?.unwrap_or([0.0; 3]),
            ..Placement::default()
        };
        if let Some(rows) = self.numbers::<9>(image, "Direction")? {
            place.directions =
                std::array::from_fn(|axis| [rows[axis], rows[3 + axis], rows[6 + axis]]);
            let axes = place.directions.map(glam::DVec3::from);
            let square = [(0, 1), (0, 2), (1, 2)].iter().all(|&(a, b)| {
                axes[a].dot(axes[b]).abs() < 1e-4 && (axes[a].length() - 1.0).abs() < 1e-4
            });
            if !square || (axes[2].length() - 1.0).abs() >= 1e-4 {
                let found = format!("Direction=\"{rows:?}\"");
                return Err(self.wrong(found, "three unit vectors at right angles"));
            }
        }
        place.origin = place.world([extent[0], extent[2], extent[4]]);
        Ok(place)
    }

    /// The tag of the array that is the volume.
    fn array(&self) -> Result<&str> {
        let Some(start) = self.text.find("<PointData") else {
            let what = "VTK image data without point data";
            let hint = "use ParaView's filter Cell Data to Point Data";
            return Err(Error::unsupported(self.path, what, hint));
        };
        let end = self.text[start..].find("</PointData").unwrap_or(0);
        let inside = &self.text[start..start + end];
        let scalars = attribute(inside.split('>').next().unwrap_or_default(), "Scalars");
        let arrays: Vec<&str> = inside
            .split('<')
            .filter(|t| t.starts_with("DataArray "))
            .map(|t| t.split('>').next().unwrap_or_default())
            .collect();
        let active = arrays
            .iter()
            .find(|t| scalars.is_some() && attribute(t, "Name") == scalars);
        match (active, &arrays[..]) {
            (Some(array), _) | (None, [array]) => Ok(array),
            _ => {
                let what = format!("VTK image data of {} arrays, none active,", arrays.len());
                Err(Error::unsupported(self.path, what, "save the one to read"))
            }
        }
    }
}

fn dtype(head: &Head, array: &str) -> Result<Dtype> {
    let components = attribute(array, "NumberOfComponents").unwrap_or("1");
    let name = attribute(array, "type").unwrap_or_default();
    let no = |what: String| Error::unsupported(head.path, what, "save one number per point");
    if components != "1" {
        return Err(no(format!("a VTK array of {components} components")));
    }
    if attribute(array, "format") != Some("appended") {
        return Err(no("a VTK array that is not appended".into()));
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
        _ => return Err(no(format!("a VTK array of type {name}"))),
    })
}

/// The `total` bytes of samples of an array.
fn source(
    blob: &Blob,
    place: blocks::Place,
    total: u64,
    compressor: Option<&str>,
) -> Result<Box<dyn ByteSource>> {
    let (path, start) = (blob.path(), place.at.saturating_add(place.word));
    let bytes = blob.open()?;
    Ok(match compressor {
        None => {
            let stored = place.number(&bytes, 0)?;
            let end = start.checked_add(total);
            if stored != total || end.is_none_or(|end| end > bytes.len()) {
                let found = format!("{stored} bytes of samples at {start}");
                let expected = format!("{total} inside the file, as size and type say");
                return Err(Error::format(path, found, expected));
            }
            Box::new(blob.samples(start)?)
        }
        Some("vtkZLibDataCompressor") => Box::new(blocks::Blocks::open(bytes, place, total)?),
        Some(other) => {
            let hint = "save it with ZLib or without compression";
            return Err(Error::unsupported(
                path,
                format!("the compressor {other}"),
                hint,
            ));
        }
    })
}

/// Parses a `.vti` file.
///
/// # Errors
/// [`Error::Unsupported`] by name for other data sets, encodings and compressors, [`Error::Format`]
/// for headers that contradict themselves or the file's length.
pub(super) fn parse(path: &Path) -> Result<Recipe> {
    let blob = Blob::file(path)?.held()?;
    let head = Head::read(path, &blob)?;
    let file = head.one("VTKFile")?;
    let kind = attribute(file, "type").unwrap_or_default();
    if kind != "ImageData" {
        let hint = "volumes are ImageData";
        return Err(Error::unsupported(
            path,
            format!("VTK data of type {kind}"),
            hint,
        ));
    }
    let endian = match attribute(file, "byte_order") {
        Some("LittleEndian") | None => Endian::Little,
        Some("BigEndian") => Endian::Big,
        Some(other) => return Err(head.wrong(other, "LittleEndian or BigEndian")),
    };
    let word = match attribute(file, "header_type") {
        Some("UInt32") | None => 4,
        Some("UInt64") => 8,
        Some(other) => return Err(head.wrong(other, "UInt32 or UInt64")),
    };
    let extent = head.extent()?;
    let size = [0, 1, 2].map(|a| (extent[2 * a + 1] - extent[2 * a] + 1.0).clamp(0.0, 1e12) as u64);
    let dims = Dims::new(size).map_err(|e| head.wrong(format!("an image with {e}"), "a volume"))?;
    let array = head.array()?;
    let dtype = dtype(&head, array)?;
    let offset = attribute(array, "offset").and_then(|o| o.parse::<u64>().ok());
    let Some(at) = offset.and_then(|o| o.checked_add(head.base)) else {
        return Err(head.wrong(format!("`{array}`"), "an array with an offset"));
    };
    let total = dims.voxels() * dtype.bytes() as u64;
    let place = blocks::Place { at, word, endian };
    let compressor = attribute(file, "compressor");
    let source = source(&blob, place, total, compressor)?;
    Ok(Recipe {
        endian: Some(endian),
        placement: head.placement(extent)?,
        provenance: Provenance {
            spacing: Origin::File,
            unit: Origin::Default,
            origin: Origin::File,
        },
        ..Recipe::new("vti", dims, dtype, Samples::Bytes(source))
    })
}
