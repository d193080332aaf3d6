//! NumPy arrays: `.npy`, whose format is that of
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.
//!
//! The axes of an array are z, y, x, as `array[z, y, x]` has them, in C order and in Fortran order alike; `bool` is u8,
//! and `float16` becomes f32. Axes of one entry are left out.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::text;
use crate::volume::{Dtype, Endian};
use std::path::{Path, PathBuf};

const MAGIC: &[u8] = b"\x93NUMPY";
/// A longer header belongs to no plain array.
pub(crate) const MAX_HEAD: usize = 4096;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "numpy",
    title: "NumPy",
    extensions: &["npy", "npz"],
    starts: is_npy,
    parse: Some(|input, _| parse(input.path, input.head)),
    in_buckets: true,
    ..Format::BASE
};

/// True if a file begins as a NumPy array does.
pub(crate) fn is_npy(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// What the header says.
#[derive(Debug, PartialEq)]
pub(crate) struct Array {
    /// Size along each axis, the slowest first.
    pub(crate) shape: Vec<u64>,
    dtype: Dtype,
    endian: Endian,
    /// Floats of 16 bits, of which f32 are made.
    half: bool,
    /// The first axis is the fastest.
    fortran: bool,
    /// Bytes of the header.
    pub(crate) head: u64,
}

/// The value of a key in the header's dictionary: all that follows it.
fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let at = text.find(&format!("'{key}'"))? + key.len() + 2;
    text[at..]
        .trim_start()
        .strip_prefix(':')
        .map(str::trim_start)
}

/// Parses the first bytes, at most [`MAX_HEAD`], of an array.
///
/// # Errors
/// [`Error::Unsupported`] for types that are not read, [`Error::Format`] for a damaged header.
pub(crate) fn array(path: &Path, bytes: &[u8]) -> Result<Array> {
    let wrong = |found: String| Error::format(path, found, "the header of a NumPy array");
    let (start, len) = match bytes.get(6..12) {
        Some(&[1, _, a, b, ..]) => (10, u32::from(u16::from_le_bytes([a, b]))),
        Some(&[2 | 3, _, a, b, c, d]) => (12, u32::from_le_bytes([a, b, c, d])),
        _ => return Err(wrong("an unknown version".into())),
    };
    let end = start + len as usize;
    let Some(text) = bytes.get(start..end).filter(|_| end <= MAX_HEAD) else {
        return Err(wrong(format!("a header of {len} bytes")));
    };
    let text = String::from_utf8_lossy(text);
    let shown: String = text.trim_end().chars().take(120).collect();
    let (Some(descr), Some(order), Some(shape)) = (
        value(&text, "descr"),
        value(&text, "fortran_order"),
        value(&text, "shape"),
    ) else {
        return Err(wrong(format!("`{shown}`")));
    };
    let shape = shape
        .strip_prefix('(')
        .and_then(|s| s.split(')').next())
        .map(|s| s.split(',').map(str::trim).filter(|n| !n.is_empty()));
    let shape: Option<Vec<u64>> = shape.and_then(|s| s.map(|n| n.parse().ok()).collect());
    let Some(shape) = shape else {
        return Err(wrong(format!("`{shown}`")));
    };
    let fortran = match (order.starts_with("True"), order.starts_with("False")) {
        (true, _) => shape.len() > 1,
        (_, true) => false,
        _ => return Err(wrong(format!("`{shown}`"))),
    };
    let Kind {
        dtype,
        endian,
        half,
    } = kind(path, descr)?;
    Ok(Array {
        shape,
        dtype,
        endian,
        half,
        fortran,
        head: end as u64,
    })
}

/// The type of entries.
struct Kind {
    dtype: Dtype,
    endian: Endian,
    half: bool,
}

fn kind(path: &Path, descr: &str) -> Result<Kind> {
    let name = descr.strip_prefix('\'').and_then(|d| d.split('\'').next());
    let name = name.unwrap_or("a record");
    let endian = if name.starts_with('>') {
        Endian::Big
    } else {
        Endian::Little
    };
    let plain = name.trim_start_matches(['<', '>', '|', '=']);
    let dtype = match plain {
        "u1" | "b1" => Dtype::U8,
        "i1" => Dtype::I8,
        "u2" => Dtype::U16,
        "i2" => Dtype::I16,
        "u4" => Dtype::U32,
        "i4" => Dtype::I32,
        "f2" | "f4" => Dtype::F32,
        "f8" => Dtype::F64,
        _ => {
            let hint = "save it as bool, a type of at most 32 bits, or float64";
            return Err(Error::unsupported(
                path,
                format!("the NumPy type {name}"),
                hint,
            ));
        }
    };
    Ok(Kind {
        dtype,
        endian,
        half: plain == "f2",
    })
}

/// Where in a file the bytes of an array are, header included.
pub(crate) struct Place {
    pub(crate) file: PathBuf,
    /// Bytes before the array or its compressed stream.
    pub(crate) base: u64,
    pub(crate) encoding: Encoding,
}

impl Array {
    /// True if it has three axes, besides those of one entry.
    pub(crate) fn is_volume(&self) -> bool {
        text::kept_axes(&self.shape).is_some()
    }

    /// The volume of a three-dimensional array.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for another number of dimensions, [`Error::Format`] for sizes out of
    /// range.
    pub(crate) fn descriptor(&self, path: &Path, place: Place) -> Result<VolumeDescriptor> {
        let Some(axes) = text::kept_axes(&self.shape) else {
            let what = format!("an array of shape {:?}", self.shape);
            let hint = "volumes have 3 dimensions, z, y, x: save one of several, as array[0] or array[..., 0]";
            return Err(Error::unsupported(path, what, hint));
        };
        let [z, y, x] = axes.map(|axis| self.shape[axis]);
        let dims = Dims::new([x, y, z]).map_err(|e| e.of_header(path, "an array"))?;
        if self.fortran && place.encoding != Encoding::Raw {
            let hint = "save it with numpy.save, or array.copy() in its place: x is the slowest axis of the file";
            return Err(Error::unsupported(
                path,
                "a packed array in Fortran order",
                hint,
            ));
        }
        let warning = self.fortran.then_some(
            "the array is in Fortran order and read as array[z, y, x], as NumPy indexes it: if it is indexed [x, y, z], \
             the volume is mirrored, save array.T",
        );
        Ok(VolumeDescriptor {
            endian: Some(self.endian),
            half: self.half,
            stored_axes: if self.fortran { [2, 1, 0] } else { [0, 1, 2] },
            warnings: warning.into_iter().map(Into::into).collect(),
            ..VolumeDescriptor::new(
                "numpy",
                dims,
                self.dtype,
                Samples::Files(Data {
                    files: vec![place.file],
                    start: Start::At {
                        base: place.base,
                        lines: 0,
                        bytes: self.head,
                        stated: true,
                    },
                    encoding: place.encoding,
                }),
            )
        })
    }
}

/// Parses a `.npy` file.
///
/// # Errors
/// Those of [`array()`] and [`Array::descriptor`].
pub(crate) fn parse(path: &Path, head: &[u8]) -> Result<VolumeDescriptor> {
    array(path, head)?.descriptor(
        path,
        Place {
            file: path.to_path_buf(),
            base: 0,
            encoding: Encoding::Raw,
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(dict: &str) -> Result<Array> {
        let len = (dict.len() as u16).to_le_bytes();
        let bytes = [MAGIC, &[1, 0], &len, dict.as_bytes()].concat();
        array(Path::new("a.npy"), &bytes)
    }

    #[test]
    fn dictionaries() {
        let array = read("{'descr': '>i2', 'fortran_order': False, 'shape': (4, 3, 2), }").unwrap();
        assert_eq!((array.shape, array.dtype), (vec![4, 3, 2], Dtype::I16));
        assert_eq!(array.endian, Endian::Big);
        assert!(!array.fortran && !array.half);
        let array = read("{'descr': '<f2', 'fortran_order': True, 'shape': (4, 3, 2), }").unwrap();
        assert_eq!(
            (array.dtype, array.half, array.fortran),
            (Dtype::F32, true, true)
        );
        for (bad, says) in [
            (
                "{'descr': '<u2', 'fortran_order': Maybe, 'shape': (4, 3, 2)}",
                "Maybe",
            ),
            (
                "{'descr': '<i8', 'fortran_order': False, 'shape': (4, 3, 2)}",
                "<i8",
            ),
            (
                "{'descr': [('a', '<u2')], 'fortran_order': False, 'shape': (4,)}",
                "record",
            ),
            (
                "{'descr': '<u2', 'fortran_order': False, 'shape': (-4,)}",
                "-4",
            ),
            ("{'fortran_order': False}", "header"),
        ] {
            let error = read(bad).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
