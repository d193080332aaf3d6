//! Which voxels a mask holds, as bits in a temporary file: an eighth of a byte for each voxel of the disk, no memory.

use crate::error::{Error, Result};
use crate::grid::Dims;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Words for a row of voxels.
pub(crate) fn row_words(nx: u32) -> usize {
    nx.div_ceil(64) as usize
}

/// Calls `each` with stretches of the voxels `x` of a row, in their order, whose bits are alike: all inside, or all not.
/// None reaches over the end of a word.
pub(crate) fn for_each_stretch(
    inside: &[u64],
    x: &Range<u32>,
    mut each: impl FnMut(Range<u32>, bool),
) {
    let mut at = x.start;
    while at < x.end {
        // what is left of the word, shifted so that its lowest bit is that of `at`
        let rest = inside[at as usize / 64] >> (at % 64);
        let is_inside = rest & 1 == 1;
        let alike = match is_inside {
            true => rest.trailing_ones(),
            false => rest.trailing_zeros(),
        };
        let end = at + alike.min(64 - at % 64).min(x.end - at);
        each(at..end, is_inside);
        at = end;
    }
}

/// A bit for each voxel, in an unnamed file: rows by z and y, each of whole words of 64 bits, the lowest bit first.
#[derive(Debug)]
pub(crate) struct InsideBits {
    dims: Dims,
    file: File,
    /// The directory that the file was made in.
    dir: PathBuf,
}

impl InsideBits {
    /// All 0, in a file in the directory `dir`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(dims: Dims, dir: &Path) -> Result<Self> {
        let bits = InsideBits {
            dims,
            file: crate::sys::temp_file::unnamed(dir).map_err(|e| failed(dir, e))?,
            dir: dir.to_path_buf(),
        };
        let [_, _, nz] = dims.0;
        bits.file
            .set_len(bits.offset(0, nz))
            .map_err(|e| failed(dir, e))?;
        Ok(bits)
    }

    /// Size of the mask.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// Where a row begins in the file.
    fn offset(&self, y: u32, z: u32) -> u64 {
        let [nx, ny, _] = self.dims.0;
        let row = u64::from(z) * u64::from(ny) + u64::from(y);
        row * 8 * row_words(nx) as u64
    }

    /// Writes whole rows of a slice, from `y` on.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, y: u32, z: u32, words: &[u64]) -> Result<()> {
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        self.file
            .write_all_at(&bytes, self.offset(y, z))
            .map_err(|e| failed(&self.dir, e))
    }

    /// Reads the voxels `x` of rows of a slice, each into [`row_words`] words of `out`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn rows(&self, x: Range<u32>, y: Range<u32>, z: u32, out: &mut [u64]) -> Result<()> {
        let whole = row_words(self.dims.0[0]);
        let mut bytes = vec![0; 8 * whole * y.len()];
        self.file
            .read_exact_at(&mut bytes, self.offset(y.start, z))
            .map_err(|e| failed(&self.dir, e))?;
        let (all, _) = bytes.as_chunks::<8>();
        let rows = all.chunks_exact(whole);
        let (first, shift) = (x.start as usize / 64, x.start % 64);
        let words = row_words(x.len() as u32);
        for (row, out) in rows.zip(out.chunks_exact_mut(words)) {
            let word = |w: usize| row.get(w).map_or(0, |bytes| u64::from_le_bytes(*bytes));
            for (w, out) in out.iter_mut().enumerate() {
                let (low, high) = (word(first + w), word(first + w + 1));
                // a shift by 64 is none
                *out = low >> shift | if shift > 0 { high << (64 - shift) } else { 0 };
            }
            if let (Some(last), rest @ 1..) = (out.last_mut(), x.len() % 64) {
                *last &= !(!0 << rest);
            }
        }
        Ok(())
    }
}

fn failed(dir: &Path, e: std::io::Error) -> Error {
    Error::io(dir, "keep the mask in a temporary file", e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Crop;
    use crate::volume::region::RegionVoxels;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_part_of_a_mask_has_its_bits(
            nx in 2u32..150, ny in 2u32..6, seed in prop::collection::vec(any::<u64>(), 36), cut in (0u32..148, 0u32..4),
        ) {
            let dims = Dims([nx, ny, 2]);
            let dir = tempfile::tempdir().unwrap();
            let bits = InsideBits::new(dims, dir.path()).unwrap();
            let words = row_words(nx);
            let mask = if nx.is_multiple_of(64) { !0 } else { !(!0 << (nx % 64)) };
            let row = |y: u32, z: u32| -> Vec<u64> {
                let from = words * (y + ny * z) as usize;
                let mut row: Vec<u64> = (from..from + words).map(|i| seed[i % seed.len()]).collect();
                row[words - 1] &= mask;
                row
            };
            for z in 0..2 {
                for y in 0..ny {
                    bits.write(y, z, &row(y, z)).unwrap();
                }
            }
            let all = RegionVoxels::mask(bits);
            let crop = Crop { x: cut.0.min(nx - 2)..nx, y: cut.1.min(ny - 2)..ny, z: 0..2 };
            let part = all.cropped(Some(&crop)).unwrap();
            let [width, rows, _] = part.dims().0;
            let mut out = Vec::new();
            let mut count = 0;
            for z in 0..2 {
                part.rows(0..rows, z, &mut out).unwrap();
                for (y, found) in (0..).zip(out.chunks_exact(row_words(width))) {
                    let whole = row(y + crop.y.start, z);
                    for x in 0..64 * found.len() as u32 {
                        let at = x + crop.x.start;
                        let expected = x < width && whole[at as usize / 64] >> (at % 64) & 1 == 1;
                        prop_assert_eq!(found[x as usize / 64] >> (x % 64) & 1 == 1, expected);
                        count += u64::from(expected);
                    }
                }
            }
            prop_assert_eq!(part.count().unwrap(), count);
        }
    }
}
