//! AIM of versions 020 and 030: the lengths of five blocks, a block that describes the volume, a log of the processing
//! as text, and the samples. Version 030 begins with its name and counts in 64 bits, lengths of voxels in nanometres; 020
//! has 32 bits, and millimetres in the floating-point numbers of a VAX.

use crate::error::{Error, Result};
use crate::grid::length::shortest;
use crate::grid::{Dims, Origin};
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
    name: "aim",
    title: "Scanco AIM",
    extensions: &["aim"],
    starts: |head| Version::of(head).is_some(),
    parse: Some(|input, _| parse(input.path, input.head)),
    ..Format::BASE
};

const MAGIC: &[u8] = b"AIMDATA_V030";
/// Logs are shorter.
const MAX_LOG: u64 = 1 << 20;

/// Where what stands in a header.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Version {
    wide: bool,
    /// Lengths of the blocks.
    blocks: usize,
    /// The block that describes the volume, and its bytes.
    volume: usize,
    bytes: u64,
    /// In that block: the type of samples, the place of the volume, and the size of a voxel. The number of voxels
    /// follows the place.
    kind: usize,
    place: usize,
    step: usize,
}

const V020: Version = Version {
    wide: false,
    blocks: 0,
    volume: 20,
    bytes: 140,
    kind: 20,
    place: 24,
    step: 108,
};
const V030: Version = Version {
    wide: true,
    blocks: 16,
    volume: 56,
    bytes: 224,
    kind: 12,
    place: 16,
    step: 184,
};

impl Version {
    fn of(head: &[u8]) -> Option<Version> {
        let fits = |version: &Version| {
            version.whole(head, version.blocks, 0) == version.volume as i64 - version.blocks as i64
                && version.whole(head, version.blocks, 1) == version.bytes as i64
        };
        match head.starts_with(MAGIC) {
            true => Some(V030).filter(fits),
            false => Some(V020).filter(fits),
        }
    }

    /// Whole number `i` of those from `at` on.
    fn whole(&self, head: &[u8], at: usize, i: usize) -> i64 {
        match self.wide {
            false => i32_at(head, at + 4 * i).into(),
            true => i64::from_le_bytes(word(head, at + 8 * i, Endian::Little)),
        }
    }

    fn three(&self, head: &[u8], at: usize) -> [i64; 3] {
        [0, 1, 2].map(|i| self.whole(head, self.volume + at, i))
    }

    /// The size of a voxel in millimetres.
    fn steps(&self, head: &[u8]) -> [f64; 3] {
        match self.wide {
            true => self.three(head, self.step).map(|nm| nm as f64 / 1e6),
            false => [0, 4, 8].map(|by| vax(i32_at(head, self.volume + self.step + by) as u32)),
        }
    }
}

/// A floating-point number of a VAX: its halves change places, and the exponent counts from another number.
fn vax(bits: u32) -> f64 {
    let turned = bits.rotate_left(16);
    shortest(f32::from_bits(turned)) / 4.0
}

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for sizes that cannot be or do not fit, [`Error::Unsupported`] for types that are packed or not read.
fn parse(path: &Path, head: &[u8]) -> Result<VolumeDescriptor> {
    let Some(version) = Version::of(head) else {
        return Err(Error::format(path, "another header", "one of AIM"));
    };
    if (head.len() as u64) < version.volume as u64 + version.bytes {
        let found = format!("a header of {} bytes", head.len());
        return Err(Error::format(path, found, "a whole header of AIM"));
    }
    let sizes = version.three(head, version.place + 3 * if version.wide { 8 } else { 4 });
    let sizes = sizes.map(|n| u64::try_from(n).unwrap_or(0));
    let dims = Dims::new(sizes).map_err(|e| e.of_header(path, "a volume"))?;
    let dtype = dtype(path, i32_at(head, version.volume + version.kind))?;
    let block = |i: usize| {
        let bytes = version.whole(head, version.blocks, i);
        u64::try_from(bytes).map_err(|_| {
            Error::format(path, format!("a block of {bytes} bytes"), "0 bytes or more")
        })
    };
    let (log, bytes) = (block(2)?, block(3)?);
    let need = dims.voxels() * dtype.bytes() as u64;
    if bytes != need {
        let found = format!("{bytes} bytes of samples");
        return Err(Error::format(
            path,
            found,
            format!("{need}, for {dims} of {dtype}"),
        ));
    }
    let before = version.volume as u64 + version.bytes;
    let samples = Samples::Files(Data {
        files: vec![path.to_path_buf()],
        start: Start::behind(before.saturating_add(log)),
        encoding: Encoding::Raw,
    });
    let mut found = VolumeDescriptor::new("aim", dims, dtype, samples);
    found.endian = Some(Endian::Little);
    let steps = version.steps(head);
    let size = voxel_size(steps.map(|mm| (mm != 0.0).then(|| Step::new(mm, "mm"))));
    size.apply(&mut found.placement, &mut found.provenance);
    found.warnings.extend(size.warning);
    if size.spacing.is_some() {
        let place = version.three(head, version.place);
        found.placement.origin = [0, 1, 2].map(|a| place[a] as f64 * steps[a]);
        found.provenance.origin = Origin::File;
    }
    scale(path, &mut found, before, log)?;
    Ok(found)
}

/// Takes the scale of attenuation from the log. Masks, which have 8 bits, have none.
fn scale(path: &Path, found: &mut VolumeDescriptor, start: u64, bytes: u64) -> Result<()> {
    if found.dtype.bytes() == 1 {
        return Ok(());
    }
    let blob = Blob::file(path)?;
    let mut log = vec![0; bytes.min(MAX_LOG).min(blob.len().saturating_sub(start)) as usize];
    blob.open()?.read_at(start, &mut log)?;
    let log = String::from_utf8_lossy(&log);
    let text = |key: &str| log.lines().find_map(|line| line.trim().strip_prefix(key));
    let value = |key: &str| text(key)?.trim().parse::<f64>().ok();
    found.values = value("Mu_Scaling").and_then(attenuation);
    if found.values.is_none() {
        let note = "the log states no scale of attenuation: values are as they are stored";
        found.notes.push(note.into());
    }
    if let (Some(slope), Some(intercept)) = (value("Density: slope"), value("Density: intercept")) {
        let calibration = Calibration {
            slope,
            intercept,
            unit: text("Density: unit").unwrap_or_default().trim().to_owned(),
        };
        found.notes.extend(calibration.note());
    }
    Ok(())
}

fn dtype(path: &Path, code: i32) -> Result<Dtype> {
    let of = |kind: i32, bytes: i32| kind << 16 | bytes;
    let name = match code {
        c if c == of(1, 1) => return Ok(Dtype::I8),
        c if c == of(13, 1) || c == of(22, 1) => return Ok(Dtype::U8),
        c if c == of(2, 2) => return Ok(Dtype::I16),
        c if c == of(23, 2) => return Ok(Dtype::U16),
        c if c == of(3, 4) => return Ok(Dtype::I32),
        c if c == of(26, 4) => return Ok(Dtype::F32),
        c if c == of(21, 1) => "two values that are packed (binCmp)".into(),
        c if c == of(8, 2) => "8 bits that are packed (charCmp)".into(),
        c if c == of(6, 1) => "single bits (bit8)".into(),
        c if c == of(4, 4) => "floats of a VAX".into(),
        other => format!("type {other:#010x}"),
    };
    let hint = "save it as `char` or `short` in IPL, or read it with aimio-py and save it as NRRD or MetaImage";
    Err(Error::unsupported(
        path,
        format!("AIM samples of {name}"),
        hint,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Unit;
    use crate::volume::{OpenOptions, Opened, open};

    const LOG: &str = "! Processing Log\n!---\nMu_Scaling                          4096\nDensity: unit  mg \
                       HA/ccm\nDensity: slope                  1.6e+03\nDensity: intercept             -3.9e+02\n";

    /// A volume of 4 x 3 x 2 of a type, at voxel (10, 20, 30), with voxels of 0.25 x 0.25 x 0.5 mm.
    fn aim(wide: bool, kind: i32, bytes: u64) -> Vec<u8> {
        let version = if wide { V030 } else { V020 };
        let mut out = if wide {
            b"AIMDATA_V030   \0".to_vec()
        } else {
            Vec::new()
        };
        let whole = |out: &mut Vec<u8>, v: i64| match wide {
            true => out.extend(v.to_le_bytes()),
            false => out.extend((v as i32).to_le_bytes()),
        };
        let sizes = [
            version.volume - version.blocks,
            version.bytes as usize,
            LOG.len(),
        ];
        for n in [sizes[0], sizes[1], sizes[2], bytes as usize, 0] {
            whole(&mut out, n as i64);
        }
        out.resize(version.volume + version.kind, 0);
        out.extend(kind.to_le_bytes());
        for v in [10, 20, 30, 4, 3, 2] {
            whole(&mut out, v);
        }
        out.resize(version.volume + version.step, 0);
        match wide {
            true => [250_000i64, 250_000, 500_000]
                .iter()
                .for_each(|v| whole(&mut out, *v)),
            // 0.25 and 0.5 as a VAX has them
            false => [0x3F80u32, 0x3F80, 0x4000]
                .iter()
                .for_each(|v| out.extend((v).to_le_bytes())),
        }
        out.resize(version.volume + version.bytes as usize, 0);
        out.extend(LOG.as_bytes());
        out.extend((0..bytes).map(|v| v as u8));
        out
    }

    fn opened(bytes: &[u8]) -> Result<Opened> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("v.aim");
        std::fs::write(&path, bytes).unwrap();
        open(&path, &OpenOptions::default())
    }

    #[test]
    fn both_versions_are_read_alike() {
        for wide in [false, true] {
            let opened = opened(&aim(wide, 0x0002_0002, 48)).unwrap();
            let header = opened.volume.header();
            assert_eq!((header.dims.0, header.dtype), ([4, 3, 2], Dtype::F32));
            let place = header.placement;
            assert_eq!(
                (place.spacing, place.unit),
                ([0.25, 0.25, 0.5], Unit::Millimetre)
            );
            assert_eq!(place.origin, [2.5, 5.0, 15.0]);
            let mut out = [0; 4];
            opened.volume.read_box(1..2, 0..1, 0..1, &mut out).unwrap();
            assert_eq!(f32::from_ne_bytes(out), f32::from(0x0302i16) / 4096.0);
            assert!(opened.values.unwrap().contains("mu_scaling"));
            assert!(opened.notes[0].contains("1600 times"), "{:?}", opened.notes);
        }
        let mask = opened(&aim(true, 0x0001_0001, 24)).unwrap();
        assert_eq!((mask.volume.header().dtype, mask.values), (Dtype::I8, None));
    }

    #[test]
    fn what_is_packed_or_does_not_fit_is_refused() {
        let cut = aim(true, 0x0002_0002, 48);
        for (bytes, says) in [
            (aim(true, 0x0015_0001, 24), "binCmp"),
            (aim(false, 0x0008_0002, 24), "charCmp"),
            (aim(false, 0x0004_0004, 96), "VAX"),
            (aim(false, 0x0077_0004, 96), "0x00770004"),
            (aim(false, 0x0002_0002, 47), "47 bytes of samples"),
            (cut[..cut.len() - 1].to_vec(), "cut short"),
            (cut[..200].to_vec(), "a header of 200 bytes"),
        ] {
            let said = opened(&bytes).unwrap_err().to_string();
            assert!(said.contains(says), "{says}: {said}");
        }
    }
}
