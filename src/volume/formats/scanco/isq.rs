//! ISQ (and RSQ): a header in blocks of 512 bytes, then samples of i16. Sizes of the whole are in micrometres.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::formats::scanco::{Calibration, attenuation, i32_at};
use crate::volume::io::blob::Blob;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::word::word;
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::{Dtype, Endian};
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "isq",
    title: "Scanco ISQ",
    extensions: &["isq", "rsq"],
    starts: |head| head.starts_with(MAGIC),
    parse: Some(|input, _| parse(input.path, input.head)),
    ..Format::BASE
};

/// What more there is to know lies in blocks behind the header: a list of their names and sizes, in one or two blocks, and
/// then they. No list is longer.
const LISTED: usize = 4;
const CALIBRATION: &[u8] = b"Calibration     ";
const LIST: &[u8] = b"MultiHeader     ";

const MAGIC: &[u8] = b"CTDATA-HEADER_V1";
const BLOCK: u64 = 512;
/// No more of them are looked at.
const MAX_BLOCKS: u64 = 1 << 11;
/// A scout view, which is flat.
const SCOUT: i32 = 9;

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for a header that is cut short or of impossible sizes, [`Error::Unsupported`] for scout views.
fn parse(path: &Path, head: &[u8]) -> Result<VolumeDescriptor> {
    if (head.len() as u64) < BLOCK {
        let found = format!("a header of {} bytes", head.len());
        return Err(Error::format(path, found, "512 bytes of an ISQ"));
    }
    let three = |at: usize| [0, 4, 8].map(|by| i32_at(head, at + by));
    let (voxels, lengths) = (three(44), three(56));
    if i32_at(head, 16) == SCOUT || lengths[2] == 0 && voxels[2] <= 1 {
        let hint = "it is a flat picture for planning a scan: give the ISQ";
        return Err(Error::unsupported(path, "a scout view of Scanco", hint));
    }
    if voxels.iter().any(|&n| n < 0) {
        let [x, y, z] = voxels;
        let found = format!("a volume of {x} x {y} x {z}");
        return Err(Error::format(path, found, "sizes from 2 on"));
    }
    let sizes = voxels.map(|n| u64::try_from(n).unwrap_or(0));
    let dims = Dims::new(sizes).map_err(|e| e.of_header(path, "a volume"))?;
    let blocks = i32_at(head, 508);
    let Ok(blocks) = u64::try_from(blocks) else {
        let found = format!("samples that begin at block {blocks}");
        return Err(Error::format(path, found, "a block behind the header"));
    };
    let step = |a: usize| {
        let size = f64::from(lengths[a]) / f64::from(dims.0[a]);
        (lengths[a] != 0).then(|| Step::new(size, "um"))
    };
    let samples = Samples::Files(Data {
        files: vec![path.to_path_buf()],
        start: Start::behind((blocks + 1) * BLOCK),
        encoding: Encoding::Raw,
    });
    let mut found = VolumeDescriptor::new("isq", dims, Dtype::I16, samples);
    found.endian = Some(Endian::Little);
    found.values = attenuation(i32_at(head, 88).into());
    if found.values.is_none() {
        let note = "the header states no scale of attenuation: values are as they are stored";
        found.notes.push(note.into());
    }
    if found.values.is_some()
        && let Some(calibration) = calibration(path, blocks)?
    {
        found.notes.extend(calibration.note());
    }
    let size = voxel_size([step(0), step(1), step(2)]);
    size.apply(&mut found.placement, &mut found.provenance);
    found.warnings.extend(size.warning);
    Ok(found)
}

/// What the `blocks` behind the header state of density, if they do.
fn calibration(path: &Path, blocks: u64) -> Result<Option<Calibration>> {
    let mut head = Blob::file(path)?.head((blocks.min(MAX_BLOCKS) + 1) * BLOCK)?;
    head.drain(..(BLOCK as usize).min(head.len()));
    let block = BLOCK as usize;
    let name = |at: usize| head.get(at + 8..at + 24);
    let list = if name(0) == Some(LIST) { block } else { 0 };
    let mut start = list + block;
    for each in (0..LISTED).map(|i| list + 128 * i) {
        let size = usize::try_from(i32_at(&head, each + 24)).unwrap_or(0);
        let end = size.saturating_mul(block).saturating_add(start);
        match head.get(start..end) {
            Some(part) if name(each) == Some(CALIBRATION) && size >= 2 => {
                let unit = part[648..664].split(|&b| b == 0).next().unwrap_or_default();
                return Ok(Some(Calibration {
                    slope: vax_double(part, 664),
                    intercept: vax_double(part, 672),
                    unit: String::from_utf8_lossy(unit).trim().to_owned(),
                }));
            }
            Some(_) => start = end,
            None => break,
        }
    }
    Ok(None)
}

/// A floating-point number of 64 bits of a VAX: its quarters change places, and the exponent counts from another number.
fn vax_double(bytes: &[u8], at: usize) -> f64 {
    let quarters: [u8; 8] = word(bytes, at, Endian::Little);
    let [a, b, c, d, e, f, g, h] = quarters;
    f64::from_le_bytes([g, h, e, f, c, d, a, b]) / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Unit;
    use crate::volume::{OpenOptions, Opened, open};

    /// A volume of 4 x 3 x 2 whose samples count up, in blocks behind `blocks` others.
    fn isq(kind: i32, lengths: [i32; 3], scaling: i32, blocks: i32) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        let words = [&[kind, 48, 0, 1, 2, 0, 0, 4, 3, 2][..], &lengths].concat();
        out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
        out.resize(88, 0);
        out.extend(scaling.to_le_bytes());
        out.resize(508, 0);
        out.extend(blocks.to_le_bytes());
        out.resize(512 * (1 + blocks.max(0)) as usize, 0);
        out.extend((0..24i16).flat_map(|v| (v * 100 - 50).to_le_bytes()));
        out
    }

    fn opened(bytes: &[u8]) -> Result<Opened> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("v.isq");
        std::fs::write(&path, bytes).unwrap();
        open(&path, &OpenOptions::default())
    }

    #[test]
    fn values_are_attenuation_where_a_scale_is_stated() {
        let scaled = opened(&isq(3, [400, 300, 1000], 4096, 1)).unwrap();
        let header = scaled.volume.header();
        assert_eq!((header.dims.0, header.dtype), ([4, 3, 2], Dtype::F32));
        let place = header.placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([100.0, 100.0, 500.0], Unit::Micrometre)
        );
        let mut out = [0; 8];
        scaled.volume.read_box(0..2, 0..1, 0..1, &mut out).unwrap();
        let values: [f32; 2] = bytemuck::pod_read_unaligned(&out);
        assert_eq!(values, [-50.0 / 4096.0, 50.0 / 4096.0]);
        let plain = opened(&isq(3, [400, 300, 1000], 0, 3)).unwrap();
        assert_eq!(plain.volume.header().dtype, Dtype::I16);
        assert!(
            plain.notes[0].contains("as they are stored"),
            "{:?}",
            plain.notes
        );
    }

    /// The bytes of a number as a VAX has them.
    fn to_vax(value: f64) -> [u8; 8] {
        let [a, b, c, d, e, f, g, h] = (value * 4.0).to_le_bytes();
        [g, h, e, f, c, d, a, b]
    }

    #[test]
    fn a_calibration_is_told_and_not_applied() {
        for list in [false, true] {
            let mut bytes = isq(3, [400, 300, 1000], 8192, 6);
            let at = if list { 1024 } else { 512 };
            if list {
                bytes[512 + 8..512 + 24].copy_from_slice(LIST);
            }
            for (i, (name, size)) in [(&b"Foobar          "[..], 1), (CALIBRATION, 2)]
                .iter()
                .enumerate()
            {
                let entry = at + 128 * i;
                bytes[entry + 8..entry + 24].copy_from_slice(name);
                bytes[entry + 24..entry + 28].copy_from_slice(&i32::to_le_bytes(*size));
            }
            let part = at + 1024;
            bytes[part + 648..part + 657].copy_from_slice(b"mg HA/ccm");
            bytes[part + 664..part + 672].copy_from_slice(&to_vax(1603.5));
            bytes[part + 672..part + 680].copy_from_slice(&to_vax(-391.25));
            let found = opened(&bytes).unwrap();
            let note = "the file states a density (mg HA/ccm) of 1603.5 times the attenuation in 1/cm - 391.25";
            assert!(found.notes[0].contains(note), "{:?}", found.notes);
            let mut out = [0; 4];
            found.volume.read_box(0..1, 0..1, 0..1, &mut out).unwrap();
            assert_eq!(f32::from_ne_bytes(out), -50.0 / 8192.0);
            // one that says nothing, and a list that leads outside
            bytes[part + 664..part + 672].copy_from_slice(&to_vax(0.0));
            assert!(opened(&bytes).unwrap().notes.is_empty());
            bytes[at + 24..at + 28].copy_from_slice(&i32::MAX.to_le_bytes());
            assert!(opened(&bytes).unwrap().notes.is_empty());
        }
    }

    #[test]
    fn what_is_no_volume_is_refused() {
        let whole = isq(3, [400, 300, 1000], 4096, 0);
        for (bytes, says) in [
            (isq(9, [400, 300, 0], 4096, 0), "scout view"),
            (isq(3, [400, 300, 1000], 4096, -2), "block -2"),
            (whole[..whole.len() - 1].to_vec(), "559 bytes"),
            (whole[..300].to_vec(), "a header of 300 bytes"),
        ] {
            let said = opened(&bytes).unwrap_err().to_string();
            assert!(said.contains(says), "{says}: {said}");
        }
        let unplaced = opened(&isq(3, [400, 300, -7], 4096, 0)).unwrap();
        assert!(
            unplaced.warnings[0].contains("--spacing"),
            "{:?}",
            unplaced.warnings
        );
    }
}
