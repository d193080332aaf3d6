//! Binary headers of other programs.

use crate::grid::Unit;
use crate::grid::length::{Length, shortest};
use crate::volume::formats::foreign::described::Described;
use crate::volume::{Dtype, Endian};
use std::path::Path;

/// Numbers at places of a header, in one byte order.
struct Numbers<'a> {
    bytes: &'a [u8],
    big: bool,
}

impl Numbers<'_> {
    fn at<const N: usize>(&self, at: usize) -> Option<[u8; N]> {
        let mut out = *self.bytes.get(at..)?.first_chunk::<N>()?;
        if self.big {
            out.reverse();
        }
        Some(out)
    }

    fn i16(&self, at: usize) -> Option<i16> {
        self.at(at).map(i16::from_le_bytes)
    }

    fn i32(&self, at: usize) -> Option<i32> {
        self.at(at).map(i32::from_le_bytes)
    }

    fn f32(&self, at: usize) -> Option<f64> {
        self.at(at).map(|b| shortest(f32::from_le_bytes(b)))
    }

    fn size(&self, at: usize) -> Option<u64> {
        u64::try_from(self.i32(at)?).ok().filter(|n| *n > 0)
    }

    fn endian(&self) -> Endian {
        match self.big {
            true => Endian::Big,
            false => Endian::Little,
        }
    }
}

/// MRC and CCP4 maps: 1024 bytes, an extended header, samples.
pub(crate) fn mrc(path: &Path, head: &[u8]) -> Option<Described> {
    let numbers = Numbers {
        bytes: head,
        big: head.get(212) == Some(&0x11),
    };
    let dims = [numbers.size(0)?, numbers.size(4)?, numbers.size(8)?];
    let dtype = match numbers.i32(12)? {
        0 => Dtype::I8,
        1 => Dtype::I16,
        2 => Dtype::F32,
        6 => Dtype::U16,
        _ => return None,
    };
    let mut described = Described::new(path.to_path_buf(), dims, dtype);
    described.endian = numbers.endian();
    described.offset = 1024 + u64::try_from(numbers.i32(92)?).ok()?;
    let length = Length::parse("angstrom")?;
    let step = |a: usize| {
        let cell = numbers.f32(40 + 4 * a)?;
        let count = numbers.size(28 + 4 * a)?;
        let step = shortest((cell / count as f64) as f32);
        Some(length.convert(step, Unit::Nanometre))
    };
    if let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(step) {
        described.spacing = Some(([x, y, z], "nm"));
    }
    if [64, 68, 72].map(|at| numbers.i32(at)) != [Some(1), Some(2), Some(3)] {
        described.remark =
            "the file's axes are not x, y, z: the volume would be turned or mirrored".into();
    }
    Some(described)
}

/// Scanco's ISQ and RSQ: blocks of 512 bytes, 16-bit samples, sizes in micrometres.
pub(crate) fn isq(path: &Path, head: &[u8]) -> Option<Described> {
    let numbers = Numbers {
        bytes: head,
        big: false,
    };
    let dims = [numbers.size(44)?, numbers.size(48)?, numbers.size(52)?];
    let mut described = Described::new(path.to_path_buf(), dims, Dtype::I16);
    described.offset = (u64::try_from(numbers.i32(508)?).ok()? + 1) * 512;
    let step = |a: usize| Some(numbers.size(56 + 4 * a)? as f64 / dims[a] as f64);
    if let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(step) {
        described.spacing = Some(([x, y, z], "um"));
    }
    if let Some(scale) = numbers.size(88) {
        described.remark = format!("attenuation in 1/cm is the value divided by {scale}");
    }
    Some(described)
}

/// True for the header of an ANALYZE 7.5 image: 348 bytes that say so, and sizes that can be.
pub(crate) fn is_analyze(head: &[u8]) -> bool {
    analyze_numbers(head).is_some()
}

fn analyze_numbers(head: &[u8]) -> Option<Numbers<'_>> {
    let magic = head.get(344..348)?;
    [false, true]
        .map(|big| Numbers { bytes: head, big })
        .into_iter()
        .find(|n| n.i32(0) == Some(348) && (1..=7).contains(&n.i16(40).unwrap_or(0)))
        .filter(|_| !magic.starts_with(b"n+") && !magic.starts_with(b"ni"))
}

/// ANALYZE 7.5: a header beside the samples.
pub(crate) fn analyze(path: &Path, head: &[u8]) -> Option<Described> {
    let numbers = analyze_numbers(head)?;
    let size = |i: usize| {
        u64::try_from(numbers.i16(40 + 2 * i)?)
            .ok()
            .filter(|n| *n > 0)
    };
    let dims = [size(1)?, size(2)?, size(3)?];
    let dtype = match numbers.i16(70)? {
        2 => Dtype::U8,
        4 => Dtype::I16,
        8 => Dtype::I32,
        16 => Dtype::F32,
        64 => Dtype::F64,
        _ => return None,
    };
    let mut described = Described::new(path.with_extension("img"), dims, dtype);
    described.endian = numbers.endian();
    described.offset = numbers.f32(108)?.abs() as u64;
    if let [Some(x), Some(y), Some(z)] = [80, 84, 88].map(|at| numbers.f32(at)) {
        described.spacing = Some(([x, y, z], "mm"));
    }
    described.remark =
        "the format leaves open which side is left: the volume may be mirrored".into();
    let scale = numbers
        .f32(112)
        .filter(|s| *s != 0.0 && *s != 1.0 && s.is_finite());
    if let Some(scale) = scale {
        described.remark += &format!("; SPM means values of {scale} times what is stored");
    }
    Some(described)
}
