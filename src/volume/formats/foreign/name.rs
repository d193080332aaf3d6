//! Sizes and types in the names of headerless files: `scan_28x20x12_16bit.raw`.

use crate::volume::Dtype;
use crate::volume::formats::foreign::described::{Described, dtype_of, of_width};
use std::path::Path;

/// The size in a file's name, with the type that the name states or the file's length gives.
pub(crate) fn read(path: &Path, len: u64) -> Option<Described> {
    let name = path.file_name()?.to_string_lossy().to_lowercase();
    let words: Vec<&str> = name
        .split(|c: char| !c.is_alphanumeric() && c != '×')
        .collect();
    let dims = words.iter().find_map(|word| size(word))?;
    let voxels = dims
        .iter()
        .try_fold(1u64, |n, d| n.checked_mul(*d))
        .filter(|n| *n > 0)?;
    let stated = words.iter().find_map(|word| kind(word));
    let (dtype, offset) = match stated {
        Some(dtype) => (
            dtype,
            len.checked_sub(voxels.checked_mul(dtype.bytes() as u64)?)?,
        ),
        None => (of_width(dims, len)?, 0),
    };
    let mut described = Described::new(path.to_path_buf(), dims, dtype);
    described.offset = offset;
    Some(described)
}

/// Three sizes: `28x20x12`.
fn size(word: &str) -> Option<[u64; 3]> {
    let numbers: Option<Vec<u64>> = word.split(['x', '×']).map(|n| n.parse().ok()).collect();
    numbers?.try_into().ok()
}

/// `uint16`, `16bit`, `float`.
fn kind(word: &str) -> Option<Dtype> {
    let bits = word.strip_suffix("bits").or(word.strip_suffix("bit"));
    match bits {
        Some("8") => Some(Dtype::U8),
        Some("16") => Some(Dtype::U16),
        Some("32") => Some(Dtype::F32),
        _ => dtype_of(word),
    }
}
