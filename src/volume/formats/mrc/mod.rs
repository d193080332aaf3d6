//! MRC and CCP4 maps: `.mrc`, `.map`, `.rec`.
//!
//! The header is that of MRC2014 (<https://www.ccpem.ac.uk/mrc_format/mrc2014.php>): 1024 bytes, an extended header of the
//! stated length, samples. Lengths are in angstrom. `MAPC`, `MAPR` and `MAPS` say which of x, y and z columns, rows and
//! sections are, and volumes are handed out with x the fastest. Of IMOD's additions
//! (<https://bio3d.colorado.edu/imod/doc/mrc_format.txt>) those that change values or the place are taken: unsigned bytes
//! and the sign of the origin.

mod place;

use crate::error::{Error, Result};
use crate::grid::length::shortest;
use crate::grid::{Dims, MAX_DIM};
use crate::volume::adapters::permute::stored_dims;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::formats::foreign::Described;
use crate::volume::io::blob::Blob;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::options::Choice;
use crate::volume::{Dtype, Endian};
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "mrc",
    title: "MRC",
    extensions: &["mrc", "map", "rec", "ccp4"],
    takes: &[Choice::Resample],
    starts: is_mrc,
    looks: Some(looks),
    parse: Some(|input, _| parse(input.path, input.head)),
    ..Format::BASE
};

const HEAD: usize = 1024;

/// True for the mark that headers have since 2000, beside numbers that can be those of a header.
fn is_mrc(head: &[u8]) -> bool {
    head.get(208..211) == Some(b"MAP") && orders(head).next().is_some()
}

/// True for an old header without the mark: of a file with such a name, whose length is the one that it states.
fn looks(path: &Path, head: &[u8]) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let named = ["mrc", "map", "rec", "st", "ali", "ccp4"]
        .iter()
        .any(|e| extension == *e);
    let len = || Blob::file(path).map(|blob| blob.len());
    let fits = |endian| {
        let head = Head {
            path,
            bytes: head,
            endian,
        };
        let stored = head.kind().ok().map(|kind| kind.bytes());
        let need = stored.and_then(|bytes| head.start().ok()?.checked_add(head.voxels()? * bytes));
        need.is_some() && need == len().ok()
    };
    named && head.len() >= HEAD && orders(head).any(fits)
}

/// The byte orders in which a header has a mode, sizes and axes that can be.
fn orders(head: &[u8]) -> impl Iterator<Item = Endian> + '_ {
    let fits = |endian: &Endian| {
        let head = Head {
            path: Path::new(""),
            bytes: head,
            endian: *endian,
        };
        let sizes = [0, 4, 8]
            .iter()
            .all(|at| (1..=MAX_DIM as i32).contains(&head.i32(*at)));
        let modes = [0, 1, 2, 3, 4, 6, 12, 16, 17, 101];
        sizes && modes.contains(&head.i32(12)) && head.axes().is_ok()
    };
    [Endian::Little, Endian::Big].into_iter().filter(fits)
}

/// A header in its byte order.
struct Head<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    endian: Endian,
}

/// The type of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Kind {
    dtype: Dtype,
    half: bool,
}

impl Kind {
    fn bytes(self) -> u64 {
        if self.half {
            2
        } else {
            self.dtype.bytes() as u64
        }
    }
}

/// Parses a file.
///
/// # Errors
/// [`Error::Unsupported`] for complex numbers, colours, 4-bit samples and stacks of volumes; [`Error::Format`] for headers
/// that contradict themselves.
fn parse(path: &Path, head: &[u8]) -> Result<VolumeDescriptor> {
    if head.len() < HEAD {
        let found = format!("a header of {} bytes", head.len());
        return Err(Error::format(path, found, "1024 bytes of MRC"));
    }
    let head = Head {
        path,
        bytes: head,
        endian: endian(path, head)?,
    };
    let axes = head.axes()?;
    let sizes = head.three(0).map(|n| u64::try_from(n).unwrap_or(0));
    let mut along = sizes;
    for (size, axis) in sizes.into_iter().zip(axes) {
        along[axis] = size;
    }
    let dims = Dims::new(along).map_err(|e| e.of_header(path, "a volume"))?;
    let kind = head.kind()?;
    head.refuse_several()?;
    let mut notes = Vec::new();
    notes.extend(head.bytes_told(kind));
    let mut warnings = Vec::new();
    let (placement, provenance) = head.place(axes, &mut warnings)?;
    let samples = Samples::Files(Data {
        files: vec![path.to_path_buf()],
        start: Start::At {
            base: 0,
            lines: 0,
            bytes: head.start()?,
            stated: true,
        },
        encoding: Encoding::Raw,
    });
    debug_assert_eq!(stored_dims(axes, dims).0.map(u64::from), sizes);
    Ok(VolumeDescriptor {
        endian: Some(head.endian),
        placement,
        provenance,
        stored_axes: axes,
        half: kind.half,
        notes,
        warnings,
        ..VolumeDescriptor::new("mrc", dims, kind.dtype, samples)
    })
}

/// The byte order by the machine stamp, or, where that is none, the only one in which the header makes sense.
fn endian(path: &Path, head: &[u8]) -> Result<Endian> {
    let stated = match head[212..214] {
        [0x44, 0x44 | 0x41] => Some(Endian::Little),
        [0x11, 0x11] => Some(Endian::Big),
        _ => None,
    };
    let sound: Vec<Endian> = orders(head).collect();
    let stamp = head[212..216].escape_ascii();
    match (stated, &sound[..]) {
        (Some(stated), sound) if sound.contains(&stated) => Ok(stated),
        (None, [one]) => Ok(*one),
        (Some(stated), [other]) => {
            let found = format!("the machine stamp of {stated}-endian (\"{stamp}\")");
            let expected = format!("that of {other}-endian, in which sizes and mode make sense");
            Err(Error::format(path, found, expected))
        }
        _ => {
            let found = format!("the machine stamp \"{stamp}\"");
            Err(Error::format(path, found, "one that tells the byte order"))
        }
    }
}

impl Head<'_> {
    fn word(&self, at: usize) -> [u8; 4] {
        let mut word = [0; 4];
        if let Some(bytes) = self.bytes.get(at..at + 4) {
            word.copy_from_slice(bytes);
        }
        if self.endian == Endian::Big {
            word.reverse();
        }
        word
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.word(at))
    }

    /// A number as its decimals read.
    fn f32(&self, at: usize) -> f64 {
        shortest(f32::from_le_bytes(self.word(at)))
    }

    fn three(&self, at: usize) -> [i32; 3] {
        [0, 4, 8].map(|by| self.i32(at + by))
    }

    fn reals(&self, at: usize) -> [f64; 3] {
        [0, 4, 8].map(|by| self.f32(at + by))
    }

    fn wrong(&self, found: String, expected: &str) -> Error {
        Error::format(self.path, found, expected)
    }

    fn voxels(&self) -> Option<u64> {
        let sizes = self.three(0).map(|n| u64::try_from(n).ok());
        sizes
            .into_iter()
            .try_fold(1u64, |n, size| n.checked_mul(size?))
    }

    /// Bytes before the first sample.
    fn start(&self) -> Result<u64> {
        let bytes = self.i32(92);
        let extended = u64::try_from(bytes)
            .map_err(|_| self.wrong(format!("an extended header of {bytes} bytes"), "0 or more"))?;
        Ok(HEAD as u64 + extended)
    }

    /// Which of x, y and z columns, rows and sections are. Old headers have zeros for the order of these.
    fn axes(&self) -> Result<[usize; 3]> {
        let stated = self.three(64);
        let mut sorted = stated;
        sorted.sort_unstable();
        match (stated, sorted) {
            ([0, 0, 0], _) => Ok([0, 1, 2]),
            (_, [1, 2, 3]) => Ok(stated.map(|n| n as usize - 1)),
            _ => {
                let [c, r, s] = stated;
                Err(self.wrong(
                    format!("MAPC {c}, MAPR {r} and MAPS {s}"),
                    "1, 2 and 3 in some order",
                ))
            }
        }
    }

    /// IMOD's flags, if it wrote the file.
    fn imod(&self) -> Option<i32> {
        (self.i32(152) == i32::from_le_bytes(*b"IMOD")).then(|| self.i32(156))
    }

    fn kind(&self) -> Result<Kind> {
        let plain = |dtype| Ok(Kind { dtype, half: false });
        let name = match self.i32(12) {
            0 => return plain(self.of_bytes()?),
            1 => return plain(Dtype::I16),
            2 => return plain(Dtype::F32),
            6 => return plain(Dtype::U16),
            12 => {
                return Ok(Kind {
                    dtype: Dtype::F32,
                    half: true,
                });
            }
            3 | 4 => "complex numbers",
            16 | 17 => "colours",
            101 => "4-bit samples",
            other => return Err(self.wrong(format!("mode {other}"), "a mode of MRC")),
        };
        let hint = "save it with samples of 8 or 16 bits, or f32, as with IMOD's newstack";
        Err(Error::unsupported(
            self.path,
            format!("an MRC of {name}"),
            hint,
        ))
    }

    /// The least and the largest value, if the header states them.
    fn range(&self) -> Option<[f64; 2]> {
        let range = [self.f32(76), self.f32(80)];
        (range[0] <= range[1] && range != [0.0; 2]).then_some(range)
    }

    /// The type of bytes: signed in MRC2014, unsigned in many files before it, which states the largest value or IMOD's
    /// flags tell.
    fn of_bytes(&self) -> Result<Dtype> {
        if let Some(flags) = self.imod() {
            return Ok(if flags & 1 == 1 { Dtype::I8 } else { Dtype::U8 });
        }
        let new = self.i32(108) >= 20140;
        match self.range() {
            Some([low, high]) if high > 127.0 && (new || low < 0.0) => {
                let found = format!("values from {low} to {high} of signed bytes");
                let Some(described) = self.described(Dtype::U8) else {
                    return Err(self.wrong(found, "values from -128 to 127"));
                };
                let hint = format!("if they are unsigned, {}", described.advice());
                Err(self.wrong(found, "values from -128 to 127").with_hint(hint))
            }
            Some([_, high]) if high > 127.0 => Ok(Dtype::U8),
            _ => Ok(Dtype::I8),
        }
    }

    /// What to say of the sign of bytes.
    fn bytes_told(&self, kind: Kind) -> Option<String> {
        let unclear = self.i32(12) == 0 && self.imod().is_none() && self.i32(108) < 20140;
        unclear.then(|| {
            let by = match self.range() {
                Some([low, high]) => format!("since the header states values from {low} to {high}"),
                None => "as MRC2014 has it".into(),
            };
            format!(
                "bytes are read as {}, {by}: many files before MRC2014 have unsigned ones",
                kind.dtype
            )
        })
    }

    /// The samples as headerless ones, where the axes are in order.
    fn described(&self, dtype: Dtype) -> Option<Described> {
        let sizes = self.three(0).map(|n| u64::try_from(n).unwrap_or(0));
        let sorted = self.axes().ok() == Some([0, 1, 2]);
        let offset = self.start().ok().filter(|_| sorted)?;
        Some(Described {
            offset,
            endian: self.endian,
            ..Described::new(self.path.to_path_buf(), sizes, dtype)
        })
    }

    /// Refuses several volumes in one file, whose sections are counted on.
    fn refuse_several(&self) -> Result<()> {
        let (group, sections, of_each) = (self.i32(88), self.i32(8), self.i32(36));
        if !(401..=630).contains(&group) || of_each == sections {
            return Ok(());
        }
        let what = format!("a stack of volumes of {of_each} sections each, {sections} in all");
        Err(Error::unsupported(
            self.path,
            what,
            "save one of them in a file of its own",
        ))
    }
}

#[cfg(test)]
mod tests;
