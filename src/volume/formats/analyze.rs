//! ANALYZE 7.5: a header of 348 bytes (`.hdr`) beside the samples (`.img`, `.img.gz`).
//!
//! The header is that of "ANALYZE 7.5 File Format", Biomedical Imaging Resource, Mayo Foundation, with the types that SPM
//! added. Lengths are in mm unless the file states another unit. The format leaves open which side is left, which is told.
//! A scale, for which SPM took a field that the format does not use, is refused: the two read other values.

use crate::error::{Error, Result};
use crate::grid::length::shortest;
use crate::grid::{Dims, Origin, Unit};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::formats::foreign::Described;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::{Dtype, Endian};
use std::path::{Path, PathBuf};

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "analyze",
    title: "ANALYZE 7.5",
    extensions: &["hdr"],
    starts: |head| Head::of(Path::new(""), head).is_some(),
    headers: &["hdr"],
    parse: Some(|input, _| parse(input.path, input.head)),
    ..Format::BASE
};

const SIZE: i32 = 348;

/// A header in its byte order.
struct Head<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    endian: Endian,
}

impl<'a> Head<'a> {
    /// The header, if its size and number of axes can be those of one, and no later format has its mark in it.
    fn of(path: &'a Path, bytes: &'a [u8]) -> Option<Self> {
        let bytes = bytes.get(..SIZE as usize)?;
        if bytes[344..].starts_with(b"n+") || bytes[344..].starts_with(b"ni") {
            return None;
        }
        let orders = [Endian::Little, Endian::Big];
        let mut heads = orders
            .map(|endian| Head {
                path,
                bytes,
                endian,
            })
            .into_iter();
        heads.find(|head| i32::from_le_bytes(head.at(0)) == SIZE && (1..=7).contains(&head.i16(40)))
    }

    fn at<const N: usize>(&self, at: usize) -> [u8; N] {
        // every place is inside the header
        let mut out = [0; N];
        out.copy_from_slice(&self.bytes[at..at + N]);
        if self.endian == Endian::Big {
            out.reverse();
        }
        out
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.at(at))
    }

    fn f32(&self, at: usize) -> f64 {
        shortest(f32::from_le_bytes(self.at(at)))
    }

    fn wrong(&self, found: String, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn dims(&self) -> Result<Dims> {
        let axes = self.i16(40) as usize;
        let sizes: Vec<i16> = (1..=axes).map(|i| self.i16(40 + 2 * i)).collect();
        if axes < 3 || sizes[3..].iter().any(|n| *n > 1) {
            let what = format!("an ANALYZE image of size {sizes:?}");
            let hint = "volumes have 3 dimensions: convert it to NIfTI, as with nibabel, of which `--time` takes one";
            return Err(Error::unsupported(self.path, what, hint));
        }
        let positive = [0, 1, 2].map(|i| u64::try_from(sizes[i]).unwrap_or(0));
        Dims::new(positive).map_err(|e| e.of_header(self.path, "an image"))
    }

    fn dtype(&self) -> Result<Dtype> {
        let dtype = match self.i16(70) {
            2 => Dtype::U8,
            4 => Dtype::I16,
            8 => Dtype::I32,
            16 => Dtype::F32,
            64 => Dtype::F64,
            130 => Dtype::I8,
            132 => Dtype::U16,
            136 => Dtype::U32,
            code => {
                let name = match code {
                    1 => "1-bit samples".to_owned(),
                    32 => "complex numbers".into(),
                    128 => "colours".into(),
                    other => {
                        return Err(self.wrong(format!("the type code {other}"), "one of ANALYZE"));
                    }
                };
                let hint = "convert it to a type of at most 32 bits or to f64";
                let what = format!("an ANALYZE image of {name}");
                return Err(Error::unsupported(self.path, what, hint));
            }
        };
        match self.i16(72) {
            bits if bits == 0 || bits as usize == 8 * dtype.bytes() => Ok(dtype),
            bits => {
                let found = format!("{bits} bits per voxel for samples of {dtype}");
                Err(self.wrong(found, "a type and a size that agree"))
            }
        }
    }

    /// The file with the samples.
    fn image(&self) -> Result<(PathBuf, Encoding)> {
        for (ending, encoding) in [("img", Encoding::Raw), ("img.gz", Encoding::Gzip)] {
            let path = self.path.with_extension(ending);
            if path.is_file() {
                return Ok((path, encoding));
            }
        }
        let hint = format!("put {} there", self.path.with_extension("img").display());
        let found = "an ANALYZE header without samples".into();
        Err(self
            .wrong(found, "its samples in a file beside it")
            .with_hint(hint))
    }

    /// Bytes before the samples. A number below 0 is that of each image.
    fn offset(&self) -> Result<u64> {
        let offset = self.f32(108).abs();
        match (0.0..=1e15).contains(&offset) && offset.fract() == 0.0 {
            true => Ok(offset as u64),
            false => Err(self.wrong(format!("vox_offset {offset}"), "a whole number")),
        }
    }

    /// The unit that the file states; empty if none.
    fn unit(&self) -> String {
        let bytes = &self.bytes[56..60];
        let text = bytes.split(|b| *b == 0).next().unwrap_or_default();
        String::from_utf8_lossy(text).trim().to_owned()
    }
}

/// Parses a header.
///
/// # Errors
/// [`Error::Unsupported`] for types that are not read, several times, and a scale; [`Error::Format`] for headers that
/// contradict themselves.
fn parse(path: &Path, head: &[u8]) -> Result<VolumeDescriptor> {
    let head = Head::of(path, head)
        .ok_or_else(|| Error::format(path, "another header", "one of ANALYZE 7.5"))?;
    let (dims, dtype) = (head.dims()?, head.dtype()?);
    let (file, encoding) = head.image()?;
    let offset = head.offset()?;
    let steps = [80, 84, 88].map(|at| head.f32(at).abs());
    let scale = head.f32(112);
    if scale != 0.0 && scale != 1.0 {
        let described = Described {
            endian: head.endian,
            offset,
            spacing: Some((steps, "mm")),
            ..Described::new(file, dims.0.map(u64::from), dtype)
        };
        let what =
            format!("an ANALYZE image whose values are {scale} times what is stored for SPM alone");
        let hint = format!(
            "convert it to NIfTI, as with nibabel; {} as they are stored",
            described.advice()
        );
        return Err(Error::unsupported(path, what, hint));
    }
    let samples = Samples::Files(Data {
        files: vec![file],
        start: Start::At {
            base: 0,
            lines: 0,
            bytes: offset,
            stated: offset > 0,
        },
        encoding,
    });
    let mut found = VolumeDescriptor::new("analyze", dims, dtype, samples);
    found.endian = Some(head.endian);
    let unit = head.unit();
    let stated = steps.iter().any(|s| *s != 0.0);
    let size = voxel_size(steps.map(|s| stated.then(|| Step::new(s, unit.as_str()))));
    size.apply(&mut found.placement, &mut found.provenance);
    // the unit of the format where the file states none
    if unit.is_empty() && size.spacing.is_some() {
        found.placement.unit = Unit::Millimetre;
        found.provenance.unit = Origin::Default;
    }
    found.warnings.extend(size.warning);
    found
        .notes
        .push("ANALYZE 7.5 leaves open which side is left: the volume may be mirrored".into());
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{OpenOptions, Opened, open};

    /// A header of 4 x 3 x 2 voxels of i16 in an order, with what `change` puts at places of it.
    fn header(big: bool, change: &[(usize, &[u8])]) -> Vec<u8> {
        let mut out = vec![0; 348];
        let mut put = |at: usize, bytes: &[u8]| {
            let mut bytes = bytes.to_vec();
            if big {
                bytes.reverse();
            }
            out[at..at + bytes.len()].copy_from_slice(&bytes);
        };
        put(0, &348i32.to_le_bytes());
        for (i, n) in [4i16, 4, 3, 2, 1].iter().enumerate() {
            put(40 + 2 * i, &n.to_le_bytes());
        }
        put(70, &4i16.to_le_bytes());
        put(72, &16i16.to_le_bytes());
        for (i, size) in [-0.7f32, 0.7, 2.0].iter().enumerate() {
            put(80 + 4 * i, &size.to_le_bytes());
        }
        change.iter().for_each(|(at, bytes)| put(*at, bytes));
        out
    }

    fn opened(header: &[u8], samples: &[u8]) -> Result<Opened> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("v.img"), samples).unwrap();
        let path = dir.path().join("v.hdr");
        std::fs::write(&path, header).unwrap();
        open(&path, &OpenOptions::default())
    }

    #[test]
    fn both_byte_orders_are_read() {
        for big in [false, true] {
            let order = |v: i16| {
                if big {
                    v.to_be_bytes()
                } else {
                    v.to_le_bytes()
                }
            };
            let samples: Vec<u8> = (0..24i16).flat_map(|v| order(v * 300 - 9)).collect();
            let opened = opened(&header(big, &[]), &samples).unwrap();
            let found = opened.volume.header();
            assert_eq!((found.dims.0, found.dtype), ([4, 3, 2], Dtype::I16));
            assert_eq!(found.placement.spacing, [0.7, 0.7, 2.0]);
            assert_eq!(found.placement.unit, Unit::Millimetre);
            assert!(opened.notes[0].contains("mirrored"), "{:?}", opened.notes);
            let mut out = [0; 4];
            opened.volume.read_box(2..4, 0..1, 0..1, &mut out).unwrap();
            assert_eq!(bytemuck::pod_read_unaligned::<[i16; 2]>(&out), [591, 891]);
        }
    }

    #[test]
    fn what_is_unclear_is_refused() {
        for (change, says) in [
            (
                &[(112, &0.5f32.to_le_bytes()[..])][..],
                "--dims 4,3,2 --dtype i16",
            ),
            (&[(70, &128i16.to_le_bytes())], "colours"),
            (&[(70, &16i16.to_le_bytes())], "16 bits per voxel"),
            (&[(70, &77i16.to_le_bytes())], "type code 77"),
            (&[(48, &5i16.to_le_bytes())], "size [4, 3, 2, 5]"),
            (&[(42, &(-4i16).to_le_bytes())], "0 x 3 x 2"),
            (&[(108, &0.5f32.to_le_bytes())], "vox_offset 0.5"),
            (&[(108, &8f32.to_le_bytes())], "56 bytes"),
        ] {
            let said = opened(&header(false, change), &[0; 48])
                .unwrap_err()
                .to_string();
            assert!(said.contains(says), "{says}: {said}");
        }
        let unit = opened(&header(false, &[(56, b"um\0\0")]), &[0; 48]).unwrap();
        let place = unit.volume.header().placement;
        assert_eq!(
            (place.unit, unit.provenance.unit),
            (Unit::Micrometre, Origin::File)
        );
    }
}
