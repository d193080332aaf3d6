//! A compressed volume, decoded once into a temporary file.

use crate::error::{Error, Result};
use crate::volume::io::byte_source::FileSource;
use crate::volume::io::file::FileVolume;
use crate::volume::{Header, Volume};
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

/// Bytes that are decoded and written at a time, unless a row or a chunk has more.
pub(crate) const PIECE: u64 = 8 << 20;
/// Rows of chunks are decoded over the volume's full width if they have at most this many bytes.
const MAX_PIECE: u64 = 64 << 20;

/// Writes the samples of a volume, in the machine's byte order, to an unnamed temporary file in the
/// directory `dir` and returns a volume that reads from there, at random and with the same header.
/// The file needs `voxels * bytes per sample` of disk space and goes away with the volume, also if
/// the process dies.
///
/// # Errors
/// [`Error::Io`] if the file cannot be made or the disk is full; the volume's own errors.
pub fn spool(volume: &dyn Volume, dir: &Path) -> Result<Box<dyn Volume>> {
    let copy = TemporaryCopy::new(volume.header(), dir)?;
    copy.fill(volume, |_| true)?;
    Ok(Box::new(copy.volume))
}

/// A file for all samples, and the volume in it.
pub(crate) struct TemporaryCopy<'a> {
    file: File,
    dir: &'a Path,
    pub(crate) volume: FileVolume,
}

impl<'a> TemporaryCopy<'a> {
    pub(crate) fn new(header: &Header, dir: &'a Path) -> Result<Self> {
        let fail = |e| Error::io(dir, "write a temporary copy of the volume", e);
        let file = crate::sys::temp_file::unnamed(dir).map_err(fail)?;
        let same = file.try_clone().map_err(fail)?;
        let source = FileSource {
            file: Arc::new(same.into()),
            path: dir.join("(temporary copy of the volume)"),
            offset: 0,
        };
        let volume = FileVolume::new(header.clone(), Box::new(source), false);
        Ok(TemporaryCopy { file, dir, volume })
    }

    /// Writes all slices, a few at a time, and calls `filled` with how many there are after each of them;
    /// stops when that returns false.
    pub(crate) fn fill(&self, volume: &dyn Volume, filled: impl Fn(u32) -> bool) -> Result<()> {
        let header = volume.header();
        let [nx, ny, nz] = header.dims.0;
        let [gx, gy, gz] = volume.grain();
        let sample = header.dtype.bytes() as u64;
        let row = u64::from(nx) * sample;
        // whole slices if they fit, else whole rows of whole slabs of chunks
        let slices = multiple(PIECE / (row * u64::from(ny)), gz, nz);
        let rows = multiple(PIECE / (row * u64::from(slices)), gy, ny);
        let thick = u64::from(slices) * u64::from(rows);
        let columns = match row * thick <= MAX_PIECE {
            true => nx,
            false => multiple(MAX_PIECE / (sample * thick), gx, nx),
        };
        let mut buffer = Vec::new();
        for z in pieces(nz, slices) {
            for y in pieces(ny, rows) {
                for x in pieces(nx, columns) {
                    buffer.resize(x.len() * y.len() * z.len() * sample as usize, 0);
                    let part = [x.clone(), y.clone(), z.clone()];
                    volume.read_box(x, y.clone(), z.clone(), &mut buffer)?;
                    write(&self.file, header.dims.0, &part, &buffer).map_err(|e| {
                        Error::io(self.dir, "write a temporary copy of the volume", e)
                    })?;
                }
            }
            volume.release(z.clone());
            if !filled(z.end) {
                break;
            }
        }
        Ok(())
    }
}

/// `wanted` as a multiple of `grain`, at least one of them, unless there are only `most`.
pub(crate) fn multiple(wanted: u64, grain: u32, most: u32) -> u32 {
    let grain = u64::from(grain.max(1));
    let count = (wanted / grain).max(1) * grain;
    count.min(u64::from(most)) as u32
}

fn pieces(total: u32, step: u32) -> impl Iterator<Item = Range<u32>> {
    (0..total)
        .step_by(step as usize)
        .map(move |at| at..at.saturating_add(step).min(total))
}

/// Writes a box of samples to its place in a file of them all, in as few pieces as it has.
fn write(
    file: &File,
    [nx, ny, _]: [u32; 3],
    [x, y, z]: &[Range<u32>; 3],
    samples: &[u8],
) -> std::io::Result<()> {
    let voxels = x.len() * y.len() * z.len();
    let sample = samples.len() / voxels;
    let whole_rows = x.len() == nx as usize;
    let run = match (whole_rows, y.len() == ny as usize) {
        (true, true) => voxels,
        (true, false) => x.len() * y.len(),
        _ => x.len(),
    };
    for (i, run_of) in samples.chunks_exact(run * sample).enumerate() {
        let first = i * run / x.len();
        let (k, j) = (first / y.len(), first % y.len());
        let row = u64::from(z.start + k as u32) * u64::from(ny) + u64::from(y.start + j as u32);
        let at = (row * u64::from(nx) + u64::from(x.start)) * sample as u64;
        file.write_all_at(run_of, at)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_land_in_their_places() {
        let dims = [5u32, 4, 3];
        let all: Vec<u8> = (0..120).collect();
        for steps in [[5, 4, 3], [5, 4, 1], [5, 3, 2], [2, 3, 2], [1, 1, 1]] {
            let file = tempfile::tempfile().unwrap();
            for z in pieces(3, steps[2]) {
                for y in pieces(4, steps[1]) {
                    for x in pieces(5, steps[0]) {
                        let mut part = Vec::new();
                        for k in z.clone() {
                            for j in y.clone() {
                                let row = ((k * 4 + j) * 5) as usize * 2;
                                let [a, b] = [x.start, x.end].map(|i| row + 2 * i as usize);
                                part.extend(&all[a..b]);
                            }
                        }
                        let asked = [x, y.clone(), z.clone()];
                        write(&file, dims, &asked, &part).unwrap();
                    }
                }
            }
            let mut found = vec![0; 120];
            file.read_exact_at(&mut found, 0).unwrap();
            assert_eq!(found, all, "{steps:?}");
        }
    }
}
