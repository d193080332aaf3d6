//! NIfTI-1 and NIfTI-2: `.nii`, `.nii.gz` and pairs of `.hdr` and `.img`.
//!
//! Headers are those of <https://nifti.nimh.nih.gov/nifti-1> and
//! <https://nifti.nimh.nih.gov/nifti-2>. The place is that of the sform, else of the qform, else the
//! spacing of `pixdim` alone, each only if it is sound; world coordinates are kept as the file has them (x right, y front,
//! z up). Where `scl_slope` and `scl_inter` say so, samples are the physical values
//! `slope * stored + inter`: f32 for stored types of at most 16 bits and f32, else f64.

mod place;

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::grid::length::shortest;
use crate::volume::adapters::values::Values;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::io::data::{self, Data, Encoding, Start};
use crate::volume::io::word::word;
use crate::volume::options::{Choice, OpenOptions};
use crate::volume::{Dtype, Endian};
use flate2::read::GzDecoder;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "nifti",
    title: "NIfTI",
    extensions: &["nii", "nii.gz", "hdr"],
    takes: &[Choice::Resample, Choice::Channel, Choice::Time],
    starts: |head| recognise(head).is_some(),
    looks: Some(|path, head| {
        start(path, head)
            .is_ok_and(|start| start.is_some_and(|(bytes, _)| recognise(&bytes).is_some()))
    }),
    headers: &["hdr"],
    parse: Some(|input, options| parse(input.path, input.head, options)),
    ..Format::BASE
};

/// Bytes of the longer header.
const LONG: usize = 540;

/// A header of either version, in its byte order.
pub(crate) struct Head<'a> {
    path: &'a Path,
    bytes: Vec<u8>,
    endian: Endian,
    /// NIfTI-2.
    long: bool,
}

/// The first bytes of a file, unpacked if it is a gzip file. `None` if unpacking fails.
fn start(path: &Path, head: &[u8]) -> Result<Option<(Vec<u8>, bool)>> {
    if !head.starts_with(&[0x1f, 0x8b]) {
        return Ok(Some((head[..head.len().min(LONG)].to_vec(), false)));
    }
    let mut bytes = Vec::new();
    let file = data::open_file(path)?;
    let done = GzDecoder::new(file)
        .take(LONG as u64)
        .read_to_end(&mut bytes);
    Ok(done.is_ok().then_some((bytes, true)))
}

/// The version and byte order that the size in the first four bytes and the magic show.
fn recognise(bytes: &[u8]) -> Option<(Endian, bool)> {
    let size = bytes.first_chunk::<4>()?;
    let endian = match (i32::from_le_bytes(*size), i32::from_be_bytes(*size)) {
        (348 | 540, _) => Endian::Little,
        (_, 348 | 540) => Endian::Big,
        _ => return None,
    };
    let magic = |at: usize, names: [&[u8]; 2]| {
        let found = bytes.get(at..at + 4);
        names.into_iter().any(|name| found == Some(name))
    };
    if magic(344, [b"n+1\0", b"ni1\0"]) {
        return Some((endian, false));
    }
    magic(4, [b"n+2\0", b"ni2\0"]).then_some((endian, true))
}

/// Parses a file, plain or packed by gzip.
///
/// # Errors
/// [`Error::Unsupported`] for 64-bit integers and colours; [`Error::Usage`] for one of several times or components
/// that options do not choose; [`Error::Format`] for headers that contradict themselves.
pub(crate) fn parse(path: &Path, head: &[u8], options: &OpenOptions) -> Result<VolumeDescriptor> {
    let other = || Error::format(path, "another header", "one of NIfTI");
    let (bytes, gzip) = start(path, head)?.ok_or_else(other)?;
    let (endian, long) = recognise(&bytes).ok_or_else(other)?;
    if bytes.len() < if long { LONG } else { 348 } {
        let found = format!("a header of {} bytes", bytes.len());
        return Err(Error::format(
            path,
            found,
            "348 bytes (NIfTI-1) or 540 (NIfTI-2)",
        ));
    }
    let head = Head {
        path,
        bytes,
        endian,
        long,
    };
    head.descriptor(gzip, options)
}

impl Head<'_> {
    /// Every place below is inside of the header.
    fn raw<const N: usize>(&self, at: usize) -> [u8; N] {
        word(&self.bytes, at, self.endian)
    }

    fn i16(&self, at: usize) -> i64 {
        i16::from_le_bytes(self.raw(at)).into()
    }

    fn i32(&self, at: usize) -> i64 {
        i32::from_le_bytes(self.raw(at)).into()
    }

    /// A number that is f32 at `short` in NIfTI-1, as its decimals read, and f64 at `long` in NIfTI-2.
    fn real(&self, short: usize, long: usize) -> f64 {
        if self.long {
            f64::from_le_bytes(self.raw(long))
        } else {
            shortest(f32::from_le_bytes(self.raw(short)))
        }
    }

    fn dim(&self, i: usize) -> i64 {
        if self.long {
            i64::from_le_bytes(self.raw(16 + 8 * i))
        } else {
            self.i16(40 + 2 * i)
        }
    }

    fn pixdim(&self, i: usize) -> f64 {
        self.real(76 + 4 * i, 104 + 8 * i)
    }

    fn code(&self, short: usize, long: usize) -> i64 {
        if self.long {
            self.i32(long)
        } else {
            self.i16(short)
        }
    }

    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn descriptor(&self, gzip: bool, options: &OpenOptions) -> Result<VolumeDescriptor> {
        let mut warnings = Vec::new();
        let (placement, provenance) = self.place(&mut warnings);
        let (dims, dtype) = (self.dims()?, self.dtype()?);
        let skip = self.part(options)? * dims.voxels() * dtype.bytes() as u64;
        Ok(VolumeDescriptor {
            endian: Some(self.endian),
            placement,
            provenance,
            values: self.values()?,
            warnings,
            ..VolumeDescriptor::new("nifti", dims, dtype, Samples::Files(self.data(gzip, skip)?))
        })
    }

    /// How many volumes lie before the one of the time and component that are asked for.
    fn part(&self, options: &OpenOptions) -> Result<u64> {
        let size = |axis: i64| match self.dim(0) >= axis {
            true => self.dim(axis as usize).max(1) as u64,
            false => 1,
        };
        let choose = |option: &str, what: &str, wanted: Option<u32>, count: u64| {
            let wanted = match wanted {
                None if count == 1 => return Ok(0),
                Some(n) if u64::from(n) < count => return Ok(u64::from(n)),
                wanted => wanted.map_or("nothing".into(), |n| n.to_string()),
            };
            let expected = format!("0 to {}, one of the file's {count} {what}", count - 1);
            Err(Error::usage(option, wanted, expected))
        };
        let time = choose("--time", "times", options.time, size(4))?;
        let component = choose(
            "--channel",
            "numbers of each voxel",
            options.channel,
            size(5),
        )?;
        Ok(component * size(4) + time)
    }

    fn dims(&self) -> Result<Dims> {
        let axes = self.dim(0);
        if !(1..=7).contains(&axes) {
            return Err(self.wrong(format!("{axes} dimensions"), "1 to 7"));
        }
        let sizes: Vec<i64> = (1..=axes as usize).map(|i| self.dim(i)).collect();
        if axes < 3 || sizes.iter().skip(5).any(|&n| n > 1) {
            let what = format!("a NIfTI image of size {sizes:?}");
            let hint = "volumes have 3 dimensions, besides times and components: extract one";
            return Err(Error::unsupported(self.path, what, hint));
        }
        let positive = [0, 1, 2].map(|i| u64::try_from(sizes[i]).unwrap_or(0));
        Dims::new(positive).map_err(|e| e.of_header(self.path, "an image"))
    }

    fn dtype(&self) -> Result<Dtype> {
        let (code, bits) = if self.long {
            (self.i16(12), self.i16(14))
        } else {
            (self.i16(70), self.i16(72))
        };
        let name = match code {
            2 => Ok(Dtype::U8),
            4 => Ok(Dtype::I16),
            8 => Ok(Dtype::I32),
            16 => Ok(Dtype::F32),
            64 => Ok(Dtype::F64),
            256 => Ok(Dtype::I8),
            512 => Ok(Dtype::U16),
            768 => Ok(Dtype::U32),
            1 => Err("1-bit samples"),
            32 | 1792 | 2048 => Err("complex numbers"),
            128 | 2304 => Err("colours"),
            1024 | 1280 => Err("64-bit integers"),
            1536 => Err("128-bit numbers"),
            _ => return Err(self.wrong(format!("the type code {code}"), "a NIfTI type")),
        };
        let dtype = name.map_err(|name| {
            let hint = "convert it to a type of at most 32 bits or to f64";
            Error::unsupported(self.path, format!("a NIfTI image of {name}"), hint)
        })?;
        if bits != 0 && bits != 8 * dtype.bytes() as i64 {
            let found = format!("{bits} bits per voxel for samples of {dtype}");
            return Err(self.wrong(found, "a type and a size that agree"));
        }
        Ok(dtype)
    }

    /// The scale of samples; `None` if they are the values.
    fn values(&self) -> Result<Option<Values>> {
        let (slope, inter) = (self.real(112, 176), self.real(116, 184));
        // 0 says that nothing was set; some programs leave NaN
        if slope == 0.0 || slope.is_nan() {
            return Ok(None);
        }
        if !slope.is_finite() || !inter.is_finite() {
            let found = format!("scl_slope {slope} and scl_inter {inter}");
            return Err(self
                .wrong(found, "finite numbers")
                .with_hint(self.as_raw()?));
        }
        Ok(Values::linear(slope, inter, "scl_slope and scl_inter"))
    }

    /// How to read stored samples as they are.
    fn as_raw(&self) -> Result<String> {
        let [x, y, z] = self.dims()?.0;
        let data = self.data(false, 0)?;
        let file = data.files[0].display();
        let Start::At { bytes, .. } = data.start else {
            return Ok(String::new());
        };
        let spacing = [1, 2, 3]
            .map(|i| self.pixdim(i).abs().to_string())
            .join(",");
        Ok(format!(
            "set scl_slope to 0 if stored samples are the values, or read {file} as raw samples: --dims {x},{y},{z} \
             --dtype {} --endian {} --offset {bytes} --spacing {spacing} --unit mm",
            self.dtype()?,
            self.endian
        ))
    }

    /// Where the samples are that `skip` bytes of samples lie before.
    fn data(&self, gzip: bool, skip: u64) -> Result<Data> {
        let detached = if self.long {
            self.bytes[4..].starts_with(b"ni2")
        } else {
            self.bytes[344..].starts_with(b"ni1")
        };
        let offset = if self.long {
            i64::from_le_bytes(self.raw(168)) as f64
        } else {
            self.real(108, 0)
        };
        let least = match (detached, self.long) {
            (true, _) => 0.0,
            (false, false) => 348.0,
            (false, true) => 540.0,
        };
        if !(least..=1e15).contains(&offset) || offset.fract() != 0.0 {
            let found = format!("vox_offset {offset}");
            return Err(self.wrong(found, "a whole number behind the header"));
        }
        let (file, gzip) = if detached {
            self.image()?
        } else {
            (self.path.to_path_buf(), gzip)
        };
        Ok(Data {
            files: vec![file],
            start: Start::At {
                base: 0,
                lines: 0,
                bytes: (offset as u64).saturating_add(skip),
                stated: !detached || offset > 0.0 || self.dim(0) > 3,
            },
            encoding: if gzip { Encoding::Gzip } else { Encoding::Raw },
        })
    }

    /// The file with the samples of a detached header.
    fn image(&self) -> Result<(PathBuf, bool)> {
        let name = self.path.to_string_lossy();
        let stem = name.strip_suffix(".gz").unwrap_or(&name);
        let stem = stem.strip_suffix(".hdr").unwrap_or(stem);
        for (ending, gzip) in [(".img", false), (".img.gz", true)] {
            let path = PathBuf::from(format!("{stem}{ending}"));
            if path.is_file() {
                return Ok((path, gzip));
            }
        }
        let found = "a NIfTI header without samples";
        Err(self
            .wrong(found, "its samples in a file beside it")
            .with_hint(format!("put {stem}.img or {stem}.img.gz there")))
    }
}
