//! A compressed volume, decoded once into a temporary file.

use super::Volume;
use super::file::FileVolume;
use super::source::FileSource;
use crate::error::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Bytes that are decoded and written at a time, unless a row has more.
const PIECE: u64 = 8 << 20;

/// Writes the samples of a volume, in the machine's byte order, to an unnamed temporary file in the
/// directory `dir` and returns a volume that reads from there, at random and with the same header.
/// The file needs `voxels * bytes per sample` of disk space and goes away with the volume, also if
/// the process dies.
///
/// # Errors
/// [`Error::Io`] if the file cannot be made or the disk is full; the volume's own errors.
pub fn spool(volume: &dyn Volume, dir: &Path) -> Result<Box<dyn Volume>> {
    let fail = |e| Error::io(dir, "write a temporary copy of the volume", e);
    let mut file = tempfile::tempfile_in(dir).map_err(fail)?;
    let header = volume.header().clone();
    let [nx, ny, nz] = header.dims.0;
    let row = u64::from(nx) * header.dtype.bytes() as u64;
    let rows = (PIECE / row).clamp(1, u64::from(ny)) as u32;
    let slices = (PIECE / (row * u64::from(ny))).clamp(1, u64::from(nz)) as u32;
    let mut buffer = Vec::new();
    for z in (0..nz).step_by(slices as usize) {
        let z = z..nz.min(z.saturating_add(slices));
        for y in (0..ny).step_by(rows as usize) {
            let y = y..ny.min(y.saturating_add(rows));
            buffer.resize(row as usize * y.len() * z.len(), 0);
            volume.read_box(0..nx, y, z.clone(), &mut buffer)?;
            file.write_all(&buffer).map_err(fail)?;
        }
        volume.release(z);
    }
    let source = FileSource {
        file: file.into(),
        path: dir.join("(temporary copy of the volume)"),
        offset: 0,
    };
    Ok(Box::new(FileVolume::new(header, Box::new(source), false)))
}
