//! Arrays of few numbers: coordinates of an axis, parameters of a transformation.

use crate::error::{Error, Result};
use crate::volume::formats::zarr::files::{Cursor, Files};
use crate::volume::formats::zarr::meta::Array;
use crate::volume::formats::zarr::store::{Node, node};
use std::path::Path;

/// Longer ones are not read.
const MAX: u64 = 1 << 20;

/// Shape and numbers, last axis fastest, of the array at a path below a group.
///
/// # Errors
/// [`Error::Format`] if there is none; those of [`read`].
pub(crate) fn at(group: &Path, path: &str) -> Result<(Vec<usize>, Vec<f64>)> {
    let inner = path.trim_matches('/');
    let below = !inner.is_empty()
        && inner
            .split('/')
            .all(|part| !matches!(part, "" | "." | ".."));
    if below && let Node::Array(array) = node(&group.join(inner))? {
        let shape = array.shape.iter().map(|&n| n as usize).collect();
        return Ok((shape, read(&group.join(inner), *array)?));
    }
    Err(Error::format(
        group,
        format!("no array at \"{path}\""),
        "the numbers of a transformation",
    ))
}

/// The numbers of an array of one or two axes.
///
/// # Errors
/// [`Error::Unsupported`] if it is larger than such arrays are, and those of its chunks.
pub(crate) fn read(folder: &Path, array: Array) -> Result<Vec<f64>> {
    let product =
        |sizes: &[u64], start: u64| sizes.iter().try_fold(start, |n, &s| n.checked_mul(s));
    let count = product(&array.shape, 1).filter(|&n| n <= MAX);
    let bytes = product(&array.chunk, array.kind.size as u64).filter(|&n| n <= 8 * MAX);
    let (Some(count), Some(bytes), 1 | 2) = (count, bytes, array.shape.len()) else {
        let what = format!(
            "an array of shape {:?} as the coordinates of an axis",
            array.shape
        );
        return Err(Error::unsupported(folder, what, ""));
    };
    let mut numbers = vec![array.fill.unwrap_or(0.0); count as usize];
    let (kind, coding) = (array.kind, array.coding.clone());
    // an axis of one entry in front makes two axes of one
    let two = |sizes: &[u64]| match *sizes {
        [n] => [1, n],
        _ => [sizes[0], sizes[1]],
    };
    let (shape, chunk) = (two(&array.shape), two(&array.chunk));
    let turned = coding.order == [1, 0];
    let flat = array.shape.len() == 1;
    let files = Files::new(folder.to_path_buf(), array, bytes as usize);
    let mut cursor = Cursor::default();
    for i in 0..shape[0].div_ceil(chunk[0]) {
        for j in 0..shape[1].div_ceil(chunk[1]) {
            let place = if flat { vec![j] } else { vec![i, j] };
            let Some(stored) = files.chunk(&place, &mut cursor)? else {
                continue;
            };
            for (at, bytes) in (0u64..).zip(stored.chunks_exact(kind.size)) {
                let [row, column] = match turned {
                    true => [at % chunk[0], at / chunk[0]],
                    false => [at / chunk[1], at % chunk[1]],
                };
                let [row, column] = [row + i * chunk[0], column + j * chunk[1]];
                if row < shape[0] && column < shape[1] {
                    let to = (row * shape[1] + column) as usize;
                    numbers[to] = kind.number(bytes, coding.endian);
                }
            }
        }
    }
    Ok(numbers)
}
