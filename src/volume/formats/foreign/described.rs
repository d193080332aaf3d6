//! What a header of another program says of samples that lie in one uncompressed piece.

use crate::volume::io::blob::Blob;
use crate::volume::{Dtype, Endian};
use std::path::{Path, PathBuf};

/// Size, type and place of samples.
#[derive(Debug, PartialEq)]
pub(crate) struct Described {
    pub(crate) file: PathBuf,
    pub(crate) dims: [u64; 3],
    pub(crate) dtype: Dtype,
    pub(crate) endian: Endian,
    /// Bytes before the first sample.
    pub(crate) offset: u64,
    /// The size of a voxel and its unit, if the header states both.
    pub(crate) spacing: Option<([f64; 3], &'static str)>,
    /// What else a user must know; may be empty.
    pub(crate) remark: String,
}

impl Described {
    /// Samples at a file's beginning, least significant byte first.
    pub(crate) fn new(file: PathBuf, dims: [u64; 3], dtype: Dtype) -> Self {
        Described {
            file,
            dims,
            dtype,
            endian: Endian::Little,
            offset: 0,
            spacing: None,
            remark: String::new(),
        }
    }

    fn bytes(&self) -> u64 {
        let voxels = self.dims.iter().fold(1u64, |n, d| n.saturating_mul(*d));
        voxels.saturating_mul(self.dtype.bytes() as u64)
    }

    /// The options that read the samples.
    pub(crate) fn options(&self) -> String {
        let list = |values: &[String]| values.join(",");
        let mut words = format!(
            "--dims {} --dtype {}",
            list(&self.dims.map(|d| d.to_string())),
            self.dtype
        );
        if self.endian == Endian::Big && self.dtype.bytes() > 1 {
            words += " --endian big";
        }
        if self.offset > 0 {
            words += &format!(" --offset {}", self.offset);
        }
        let sound = |(size, _): &([f64; 3], _)| size.iter().all(|s| s.is_finite() && *s > 0.0);
        if let Some((size, unit)) = self.spacing.filter(sound) {
            words += &format!(
                " --spacing {} --unit {unit}",
                list(&size.map(|s| s.to_string()))
            );
        }
        words
    }

    /// The command that shows the volume, and what keeps it from doing so.
    pub(crate) fn advice(&self) -> String {
        let mut words = format!(
            "`alvis info {} {}` reads its samples",
            quoted(&self.file),
            self.options()
        );
        let need = self.offset.saturating_add(self.bytes());
        match Blob::file(&self.file) {
            Ok(blob) if blob.len() < need => {
                words += &format!(", but the file has {} bytes, not {need}", blob.len());
            }
            Ok(_) => {}
            Err(_) => words += ", but that file is not there",
        }
        if !self.remark.is_empty() {
            words += &format!(" ({})", self.remark);
        }
        words
    }
}

/// A path as a shell takes it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+=%,:@".contains(c);
    match text.chars().all(plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// The type of samples of a file that holds nothing but `dims` of them in `len` bytes, by their size: unsigned numbers of
/// 8 and 16 bits, floating-point ones of 32 and 64.
pub(crate) fn of_width(dims: [u64; 3], len: u64) -> Option<Dtype> {
    let voxels = dims.iter().try_fold(1u64, |n, d| n.checked_mul(*d))?;
    let types = [Dtype::U8, Dtype::U16, Dtype::F32, Dtype::F64];
    types
        .into_iter()
        .find(|t| voxels.checked_mul(t.bytes() as u64) == Some(len) && voxels > 0)
}

/// The type of a name in a header: `unsigned_short`, `uint16`, `USHORT`, `float`.
pub(crate) fn dtype_of(name: &str) -> Option<Dtype> {
    let name = name.trim().trim_matches('"').to_ascii_lowercase();
    let name = name.replace([' ', '_'], "");
    Some(match name.trim_end_matches("type") {
        "uchar" | "unsignedchar" | "unsignedbyte" | "byte" | "uint8" | "u8" => Dtype::U8,
        "char" | "signedchar" | "signedbyte" | "int8" | "i8" => Dtype::I8,
        "ushort" | "unsignedshort" | "unsignedshortinteger" | "uint16" | "u16" => Dtype::U16,
        "short" | "signedshort" | "int16" | "i16" => Dtype::I16,
        "uint" | "unsignedint" | "unsignedinteger" | "uint32" | "u32" => Dtype::U32,
        "int" | "signedint" | "signedinteger" | "int32" | "i32" => Dtype::I32,
        "float" | "floatvalue" | "single" | "float32" | "f32" => Dtype::F32,
        "double" | "doublevalue" | "float64" | "f64" => Dtype::F64,
        _ => return None,
    })
}

/// The type of numbers of a kind and width: `unsigned integer` of 16 bits.
pub(crate) fn of_bits(kind: &str, bits: u64) -> Option<Dtype> {
    let kind = kind.to_ascii_lowercase();
    Some(
        match (kind.starts_with("float"), kind.starts_with("signed"), bits) {
            (true, _, 32) => Dtype::F32,
            (true, _, 64) => Dtype::F64,
            (false, false, 8) => Dtype::U8,
            (false, false, 16) => Dtype::U16,
            (false, false, 32) => Dtype::U32,
            (false, true, 8) => Dtype::I8,
            (false, true, 16) => Dtype::I16,
            (false, true, 32) => Dtype::I32,
            _ => return None,
        },
    )
}
