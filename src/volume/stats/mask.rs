//! A mask, read once: which of its voxels are inside.

use crate::error::{Error, Result};
use crate::grid::{Dims, Voxel, with_voxel_type};
use crate::progress::Progress;
use crate::volume::Volume;
use crate::volume::region::{InsideBits, RegionVoxels, row_words, wrong_size};
use crate::volume::stats::walk::Walk;
use std::path::Path;

impl RegionVoxels {
    /// The voxels of a mask, for a volume of size `dims`, that are not 0, nor NaN. They are kept as bits in a temporary file in the directory `dir`,
    /// which takes an eighth of a byte a voxel. With them comes the checksum that
    /// [`crate::grid::Shape::Mask`] states.
    ///
    /// # Errors
    /// The mask's own; [`crate::Error::Io`]; [`crate::Error::Interrupted`]; [`crate::Error::Usage`] if no voxel is
    /// inside, or the mask is of another size.
    pub fn of_mask(
        mask: &dyn Volume,
        dims: Dims,
        dir: &Path,
        progress: &dyn Progress,
    ) -> Result<(RegionVoxels, String)> {
        let header = mask.header();
        if header.dims != dims {
            return Err(wrong_size(header.dims, dims));
        }
        let bits = InsideBits::new(header.dims, dir)?;
        with_voxel_type!(header.dtype, T => read::<T>(mask, &bits, progress))?;
        let region = RegionVoxels::mask(bits);
        let (mut crc, mut any) = (crc32fast::Hasher::new(), false);
        region.for_each_word(|word| {
            any |= word != 0;
            crc.update(&word.to_le_bytes());
        })?;
        if !any {
            let expected = "some that are not 0, which are inside";
            return Err(Error::usage(
                "--roi",
                "a mask whose voxels are all 0",
                expected,
            ));
        }
        Ok((region, format!("crc32:{:08x}", crc.finalize())))
    }
}

/// Writes the bits of all voxels.
fn read<T: Voxel>(mask: &dyn Volume, bits: &InsideBits, progress: &dyn Progress) -> Result<()> {
    let nx = mask.header().dims.0[0] as usize;
    let words = row_words(nx as u32);
    let walk = Walk::whole(mask, 0);
    progress.begin("mask", walk.pieces());
    walk.fold(
        mask,
        progress,
        Vec::new,
        |out: &mut Vec<u64>, piece, samples: &[T]| {
            let rows = piece.y.len();
            for (z, slice) in piece.z.clone().zip(samples.chunks_exact(nx * rows)) {
                out.clear();
                out.resize(words * rows, 0);
                for (row, out) in slice.chunks_exact(nx).zip(out.chunks_exact_mut(words)) {
                    for (x, v) in row.iter().map(|v| v.to_f64()).enumerate() {
                        let inside = v != 0.0 && !v.is_nan();
                        out[x / 64] |= u64::from(inside) << (x % 64);
                    }
                }
                bits.write(piece.y.start, z, out)?;
            }
            Ok(())
        },
        |a, _| a,
    )
    .map(|_| ())
}
