//! AmiraMesh (Amira, Avizo): a header of text, then arrays of samples behind `@1`, `@2`, ..., as they are, in run lengths
//! of bytes (`HxByteRLE`) or packed by zlib (`HxZip`).
//!
//! The format is that of the Amira user's guide, "AmiraMesh format". `BoundingBox` reaches from the centre of the first
//! voxel to that of the last. `TransformationMatrix` lists the images of the three axes, then that of the origin, four
//! numbers each. Coordinates that are not uniform are refused.

mod header;

use crate::error::{Error, Result};
use crate::grid::length::shortest;
use crate::grid::{Dims, Origin, Placement, Provenance};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::{Format, listed};
use crate::volume::formats::foreign::{Described, dtype_of};
use crate::volume::io::blob::Blob;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::text::{self, Field, decoded};
use crate::volume::options::{Choice, OpenOptions};
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::stated::warning::Warning;
use crate::volume::{Dtype, Endian};
use header::{Array, Header, Packing};
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "amiramesh",
    title: "AmiraMesh",
    extensions: &["am"],
    takes: &[Choice::Resample, Choice::Dataset],
    starts: |head| head.starts_with(b"# AmiraMesh") || head.starts_with(b"# Avizo"),
    parse: Some(|input, options| parse(input.path, options)),
    ..Format::BASE
};

const MATRIX: &str = "Parameters/TransformationMatrix";

/// No header is longer: those of many materials have some hundred kilobytes.
const MAX_HEADER: u64 = 4 << 20;

/// Parses a file.
///
/// # Errors
/// [`Error::Unsupported`] for files without a regular grid, text, vectors and types that are not read; [`Error::Usage`] for
/// one of several arrays that options do not choose; [`Error::Format`] for headers that contradict themselves.
fn parse(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let blob = Blob::file(path)?;
    let head = blob.head(MAX_HEADER)?;
    let mark = ["\n@1\n", "\n@1\r\n"].into_iter().filter_map(|mark| {
        let at = head
            .windows(mark.len())
            .position(|w| w == mark.as_bytes())?;
        Some((at, at + mark.len()))
    });
    let Some((end, first)) = mark.min() else {
        let expected = "a header of text, and samples behind a line `@1`";
        return Err(Error::format(path, "no samples", expected)
            .with_hint("the file is cut short, or holds no grid"));
    };
    let text = decoded(&head[..end + 1]);
    let header = Header::parse(&text);
    let dims = header.lattice(path)?;
    let endian = endian(path, &text)?;
    let array = chosen(path, &header, options)?;
    let dtype = dtype(path, array)?;
    let start = start(&blob, &header, array, first as u64, dims)?;
    let encoding = match array.packing {
        Packing::None => Encoding::Raw,
        Packing::Zip(_) => Encoding::Zlib,
        Packing::ByteRle(packed) => Encoding::ByteRle { packed },
    };
    if array.packing == Packing::None {
        all_there(&blob, start, dims, dtype)?;
    }
    let described = Described {
        offset: start,
        endian,
        ..Described::new(path.to_path_buf(), dims.0.map(u64::from), dtype)
    };
    let way = match array.packing {
        Packing::None => format!("; {}, as if voxels were of one size", described.advice()),
        _ => String::new(),
    };
    let (placement, provenance, warnings) = place(path, &header, dims, &way)?;
    Ok(VolumeDescriptor {
        endian: Some(endian),
        placement,
        provenance,
        warnings,
        ..VolumeDescriptor::new(
            "amiramesh",
            dims,
            dtype,
            Samples::Files(Data {
                files: vec![path.to_path_buf()],
                start: Start::At {
                    base: start,
                    lines: 0,
                    bytes: 0,
                    stated: true,
                },
                encoding,
            }),
        )
    })
}

/// Checks that samples as they are reach to their end.
fn all_there(blob: &Blob, start: u64, dims: Dims, dtype: Dtype) -> Result<()> {
    let end = start.saturating_add(dims.voxels() * dtype.bytes() as u64);
    match blob.len() < end {
        true => Err(Error::format(
            blob.path(),
            format!("{} bytes", blob.len()),
            format!("{end} for {dims} of {dtype}"),
        )
        .with_hint("the file is cut short, or the size is wrong")),
        false => Ok(()),
    }
}

/// The byte order, in the first line.
fn endian(path: &Path, text: &str) -> Result<Endian> {
    let first = text.lines().next().unwrap_or_default();
    let has = |word: &str| first.split_whitespace().any(|w| w == word);
    match (has("BINARY-LITTLE-ENDIAN"), has("BINARY")) {
        (true, _) => Ok(Endian::Little),
        (false, true) => Ok(Endian::Big),
        _ if has("ASCII") => Err(Error::unsupported(
            path,
            "an AmiraMesh whose samples are text",
            "save it as `AmiraMesh binary`",
        )),
        _ => Err(Error::format(
            path,
            format!("`{first}`"),
            "BINARY-LITTLE-ENDIAN or BINARY",
        )),
    }
}

/// The array of the lattice that is asked for, or the only one.
fn chosen<'a>(path: &Path, header: &'a Header, options: &OpenOptions) -> Result<&'a Array<'a>> {
    let own = || header.arrays.iter().filter(|array| array.of == "Lattice");
    let names: Vec<&str> = own().map(|array| array.name).collect();
    let listed = listed(&names, "or");
    let mut found =
        own().filter(|array| options.dataset.as_deref().is_none_or(|d| d == array.name));
    match (found.next(), found.next()) {
        (Some(array), None) => Ok(array),
        (None, _) if names.is_empty() => Err(Error::unsupported(
            path,
            "an AmiraMesh without samples on a lattice",
            "give the file of the volume",
        )),
        (None, _) => {
            let given = options.dataset.clone().unwrap_or_default();
            Err(Error::usage("--dataset", given, listed))
        }
        (Some(_), Some(_)) => Err(Error::usage("--dataset", "nothing", listed)
            .with_hint(format!("{} holds several arrays", path.display()))),
    }
}

fn dtype(path: &Path, array: &Array) -> Result<Dtype> {
    let found = match array.components {
        1 => dtype_of(array.kind),
        _ => None,
    };
    found.ok_or_else(|| {
        let what = match array.components {
            1 => format!("the AmiraMesh type `{}`", array.kind),
            n => format!("an array of {n} numbers for each voxel"),
        };
        let hint = "save one number of at most 32 bits, or double, for each voxel";
        Error::unsupported(path, what, hint)
    })
}

/// Where the samples of an array begin, from where those of `@1` do. Others lie behind those before them.
fn start(blob: &Blob, header: &Header, array: &Array, first: u64, dims: Dims) -> Result<u64> {
    let bytes = blob.open()?;
    let mut start = first;
    for mark in 1..array.mark {
        let before = header.arrays.iter().find(|other| other.mark == mark);
        let size = before.and_then(|other| match other.packing {
            Packing::Zip(packed) | Packing::ByteRle(packed) => Some(packed),
            Packing::None if other.of == "Lattice" => {
                let sample = dtype_of(other.kind)?.bytes() as u64 * u64::from(other.components);
                dims.voxels().checked_mul(sample)
            }
            Packing::None => None,
        });
        let unknown = || {
            let what = format!("an array behind one of unknown length (`@{mark}`)");
            Error::unsupported(blob.path(), what, "save it in a file of its own")
        };
        let end = start.saturating_add(size.ok_or_else(unknown)?);
        let expected = ["\n", "\r\n"].map(|end| format!("@{}{end}", mark + 1));
        // a line may end behind the samples
        let mut next = vec![0; 16.min(bytes.len().saturating_sub(end)) as usize];
        bytes.read_at(end, &mut next)?;
        let blank = next.iter().take_while(|b| b"\r\n".contains(b)).count();
        let found = expected
            .iter()
            .find(|mark| next[blank..].starts_with(mark.as_bytes()));
        let Some(expected) = found else {
            let found = format!("no `@{}` at byte {end}", mark + 1);
            return Err(Error::format(
                blob.path(),
                found,
                "arrays one behind the other",
            ));
        };
        start = end + (blank + expected.len()) as u64;
    }
    Ok(start)
}

/// Spacing, origin and directions, with warnings. `way` is said to those whose lattice is refused.
fn place(
    path: &Path,
    header: &Header,
    dims: Dims,
    way: &str,
) -> Result<(Placement, Provenance, Vec<Warning>)> {
    let mut place = Placement::default();
    let mut from = Provenance::default();
    let mut warnings = Vec::new();
    if let Some([kind]) = header.get("Parameters/CoordType")
        && *kind != "uniform"
    {
        let what = format!("a lattice of {kind} coordinates");
        let hint = format!("resample it to uniform ones{way}");
        return Err(Error::unsupported(path, what, hint));
    }
    let Some(ends) = numbers::<6>(path, header, "Parameters/BoundingBox")? else {
        return Ok((place, from, warnings));
    };
    let mut lengths = [0, 1, 2].map(|a| {
        // bounds have few digits, and quotients noise
        shortest(((ends[2 * a + 1] - ends[2 * a]) / f64::from(dims.0[a] - 1)) as f32)
    });
    let mut origin = [ends[0], ends[2], ends[4]];
    if let Some(matrix) = numbers::<16>(path, header, MATRIX)? {
        let text = header.get(MATRIX).unwrap_or_default().join(" ");
        let field = Field {
            path,
            name: "TransformationMatrix",
            text: &text,
        };
        place.directions = moved(field, matrix, &mut lengths, &mut origin)?;
    }
    let unit = header
        .get("Parameters/Units/Coordinates")
        .and_then(|u| u.first().copied());
    let size = voxel_size(lengths.map(|length| Some(Step::new(length, unit.unwrap_or("")))));
    size.apply(&mut place, &mut from);
    if size.spacing.is_some() {
        place.origin = match (size.unit, size.of_file[0]) {
            (Some(unit), Some(length)) => origin.map(|v| length.convert(v, unit)),
            _ => origin,
        };
        from.origin = Origin::File;
    }
    warnings.extend(size.warning);
    Ok((place, from, warnings))
}

/// Moves steps and an origin by a matrix, and returns the directions of the axes.
fn moved(
    field: Field,
    m: [f64; 16],
    lengths: &mut [f64; 3],
    origin: &mut [f64; 3],
) -> Result<[[f64; 3]; 3]> {
    if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
        return Err(field.wrong("a map without perspective"));
    }
    let rows = [0, 1, 2].map(|r| [m[4 * r], m[4 * r + 1], m[4 * r + 2]]);
    let (scales, directions) = text::axes(field, rows)?;
    let along = |r: usize| (0..3).map(|a| origin[a] * rows[a][r]).sum::<f64>();
    *origin = [0, 1, 2].map(|r| along(r) + m[12 + r]);
    for (length, scale) in lengths.iter_mut().zip(scales) {
        // rounding noise must not change the size of a voxel
        if (scale - 1.0).abs() >= 1e-6 {
            *length *= scale;
        }
    }
    Ok(directions)
}

/// The numbers under a key.
fn numbers<const N: usize>(path: &Path, header: &Header, key: &str) -> Result<Option<[f64; N]>> {
    let Some(words) = header.get(key) else {
        return Ok(None);
    };
    let found: Option<Vec<f64>> = words.iter().map(|w| w.parse().ok()).collect();
    let finite = |v: &[f64; N]| v.iter().all(|v| v.is_finite());
    let found = found
        .and_then(|v| <[f64; N]>::try_from(v).ok())
        .filter(finite);
    found.map(Some).ok_or_else(|| {
        let (name, text) = (key.rsplit('/').next().unwrap_or(key), words.join(" "));
        Field {
            path,
            name,
            text: &text,
        }
        .wrong(format!("{N} numbers"))
    })
}

#[cfg(test)]
mod tests;
