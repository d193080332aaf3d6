//! NRRD: attached and detached headers, one data file or many.
//!
//! The format is described at <https://teem.sourceforge.net/nrrd/format.html>. World coordinates are
//! kept as the file has them, in whatever space (RAS, LPS, ...) it states. `axis mins` and
//! `axis maxs` are not used.

mod space;

use super::layout::{Data, Encoding, Recipe, Samples, Start};
use super::text::{self, Field, Lines};
use super::{Dtype, Endian};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use space::{is_anatomical, unit, vectors, vectors_in};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// True if a file begins as NRRD does.
pub(super) fn is_nrrd(head: &[u8]) -> bool {
    head.starts_with(b"NRRD0")
}

/// Fields of the format, without spaces. Others are refused, since a misspelt `endian` or
/// `byte skip` would turn the samples into noise.
const FIELDS: &[&str] = &[
    "axismaxs",
    "axismins",
    "blocksize",
    "byteskip",
    "centerings",
    "centers",
    "content",
    "datafile",
    "dimension",
    "encoding",
    "endian",
    "kinds",
    "labels",
    "lineskip",
    "max",
    "measurementframe",
    "min",
    "number",
    "oldmax",
    "oldmin",
    "sampleunits",
    "sizes",
    "space",
    "spacedimension",
    "spacedirections",
    "spaceorigin",
    "spaceunits",
    "spacings",
    "thicknesses",
    "type",
    "units",
];

/// The fields of a header and what follows it.
struct Head<'a> {
    path: &'a Path,
    fields: HashMap<String, String>,
    /// File names below `data file: LIST`.
    list: Vec<String>,
    /// Bytes of the header, its blank line included; `None` if the file ends without one.
    end: Option<u64>,
}

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for a damaged or contradictory header, [`Error::Unsupported`] for what is not
/// three-dimensional, not of a supported type, or not stored as raw or gzip.
pub(super) fn parse(path: &Path) -> Result<Recipe> {
    let head = Head::read(path)?;
    let dimension: u32 = head.need("dimension")?.one("a number")?;
    if dimension != 3 {
        return Err(Error::unsupported(
            path,
            format!("a NRRD of {dimension} dimensions"),
            "volumes have 3: extract one with `unu slice` or ITK",
        ));
    }
    head.check_kinds()?;
    let dims = Dims::new(head.need("sizes")?.values()?).map_err(|e| head.at_sizes(&e))?;
    let dtype = head.dtype()?;
    let endian = match head.get("endian") {
        None => None,
        Some(field) => match field.text.to_ascii_lowercase().as_str() {
            "little" => Some(Endian::Little),
            "big" => Some(Endian::Big),
            _ => return Err(field.wrong("little or big")),
        },
    };
    let (placement, provenance) = head.placement()?;
    Ok(Recipe {
        endian,
        placement,
        provenance,
        ..Recipe::new("nrrd", dims, dtype, Samples::Files(head.data(dims)?))
    })
}

impl<'a> Head<'a> {
    fn read(path: &'a Path) -> Result<Self> {
        let mut lines = Lines::open(path)?;
        let mut head = Head {
            path,
            fields: HashMap::new(),
            list: Vec::new(),
            end: None,
        };
        let magic = lines.next()?.unwrap_or_default();
        if !matches!(
            magic.as_str(),
            "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005"
        ) {
            return Err(Error::format(
                path,
                format!("`{magic}`"),
                "NRRD0001 to NRRD0005",
            ));
        }
        while let Some(line) = lines.next()? {
            if line.is_empty() {
                head.end = Some(lines.position());
                return Ok(head);
            }
            if line.starts_with('#') {
                continue;
            }
            let parts = line.split_once(':');
            let Some((name, text)) = parts else {
                let line: String = line.chars().take(80).collect();
                return Err(Error::format(path, format!("`{line}`"), "`field: value`"));
            };
            if text.starts_with('=') {
                continue; // a key of the user's own
            }
            head.add(name, text.trim())?;
            if name.replace(' ', "").eq_ignore_ascii_case("datafile") && is_list(text) {
                while let Some(name) = lines.next()? {
                    if !name.trim().is_empty() {
                        head.list.push(name.trim().to_owned());
                    }
                }
                return Ok(head);
            }
        }
        Ok(head)
    }

    fn add(&mut self, name: &str, text: &str) -> Result<()> {
        let key = name.replace(' ', "").to_ascii_lowercase();
        let field = Field {
            path: self.path,
            name,
            text,
        };
        if !FIELDS.contains(&key.as_str()) {
            return Err(field.wrong("a field of the NRRD format"));
        }
        match self.fields.insert(key, text.to_owned()) {
            Some(_) => Err(field.wrong("every field once")),
            None => Ok(()),
        }
    }

    fn get(&self, name: &'a str) -> Option<Field<'_>> {
        let text = self.fields.get(&name.replace(' ', ""))?;
        Some(Field {
            path: self.path,
            name,
            text,
        })
    }

    fn need(&self, name: &'a str) -> Result<Field<'_>> {
        self.get(name).ok_or_else(|| {
            Error::format(
                self.path,
                format!("no field `{name}`"),
                "a NRRD header that has it",
            )
        })
    }

    /// A size out of range is the file's fault, not that of an option.
    fn at_sizes(&self, error: &Error) -> Error {
        Error::format(
            self.path,
            format!("`sizes` with {error}"),
            "a volume of that size",
        )
    }

    /// Refuses axes that hold the components of colours or vectors.
    fn check_kinds(&self) -> Result<()> {
        let Some(field) = self.get("kinds") else {
            return Ok(());
        };
        let kinds = field.text.to_ascii_lowercase();
        let components = [
            "color",
            "vector",
            "complex",
            "quaternion",
            "matrix",
            "gradient",
        ];
        if components.iter().any(|c| kinds.contains(c)) {
            return Err(Error::unsupported(
                self.path,
                format!("a NRRD whose samples have components (kinds: {kinds})"),
                "only one number per voxel can be read",
            ));
        }
        Ok(())
    }

    fn dtype(&self) -> Result<Dtype> {
        let field = self.need("type")?;
        Ok(match field.text.to_ascii_lowercase().as_str() {
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => Dtype::U8,
            "char" | "signed char" | "int8" | "int8_t" => Dtype::I8,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
                Dtype::U16
            }
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
                Dtype::I16
            }
            "uint" | "unsigned int" | "uint32" | "uint32_t" => Dtype::U32,
            "int" | "signed int" | "int32" | "int32_t" => Dtype::I32,
            "float" => Dtype::F32,
            "double" => Dtype::F64,
            "block"
            | "longlong"
            | "long long"
            | "long long int"
            | "signed long long"
            | "signed long long int"
            | "int64"
            | "int64_t"
            | "ulonglong"
            | "unsigned long long"
            | "unsigned long long int"
            | "uint64"
            | "uint64_t" => {
                return Err(Error::unsupported(
                    self.path,
                    format!("the NRRD type `{}`", field.text),
                    "convert it to a type of at most 32 bits or to double",
                ));
            }
            _ => return Err(field.wrong("a NRRD type such as uchar, short, uint16 or float")),
        })
    }

    fn encoding(&self) -> Result<Encoding> {
        let field = self.need("encoding")?;
        match field.text.to_ascii_lowercase().as_str() {
            "raw" => Ok(Encoding::Raw),
            "gzip" | "gz" => Ok(Encoding::Gzip),
            name @ ("txt" | "text" | "ascii" | "hex" | "bzip2" | "bz2" | "zrl") => {
                Err(Error::unsupported(
                    self.path,
                    format!("the NRRD encoding `{name}`"),
                    "convert it with `unu save -f nrrd -e raw` (or gzip)",
                ))
            }
            _ => Err(field.wrong("raw or gzip")),
        }
    }

    /// Spacing, directions, origin and unit.
    fn placement(&self) -> Result<(Placement, Provenance)> {
        let mut place = Placement::default();
        let mut from = Provenance::default();
        if let Some(field) = self.get("space directions") {
            let vectors = vectors(field)?;
            (place.spacing, place.directions) = text::axes(field, vectors)?;
            from.spacing = [Origin::File; 3];
            from.origin = Origin::File;
        } else if let Some(field) = self.get("spacings") {
            let spacings: [f64; 3] = field.values()?;
            // NaN is the format's way to say that a spacing is not known
            if !spacings.iter().all(|s| s.is_nan()) {
                for (axis, s) in spacings.into_iter().enumerate() {
                    place.spacing[axis] = s.abs();
                    place.directions[axis][axis] = if s < 0.0 { -1.0 } else { 1.0 };
                }
                from.spacing = [Origin::File; 3];
            }
        }
        if let Some(field) = self.get("space origin") {
            place.origin = match &vectors_in(field.text).unwrap_or_default()[..] {
                [Some(origin)] => *origin,
                _ => return Err(field.wrong("one vector of 3 numbers: (x,y,z)")),
            };
            from.origin = Origin::File;
        }
        for name in ["space units", "units"] {
            if let Some(unit) = self.get(name).map(unit).transpose()?.flatten() {
                place.unit = unit;
                from.unit = Origin::File;
                return Ok((place, from));
            }
        }
        // the anatomical spaces are those of DICOM and its relatives, which measure in millimetres
        if self
            .get("space")
            .is_some_and(|field| is_anatomical(field.text))
        {
            place.unit = Unit::Millimetre;
        }
        Ok((place, from))
    }

    fn data(&self, dims: Dims) -> Result<Data> {
        let encoding = self.encoding()?;
        let skip = |name: &'a str| self.get(name).map(|f| f.one::<i64>("a number")).transpose();
        let (lines, bytes) = (skip("line skip")?, skip("byte skip")?);
        let (files, base) = match self.get("data file") {
            Some(field) => (self.data_files(field, dims)?, 0),
            None => match self.end {
                Some(end) => (vec![self.path.to_path_buf()], end),
                None => {
                    return Err(Error::format(
                        self.path,
                        "a header without an end",
                        "a blank line and the samples, or a field `data file`",
                    ));
                }
            },
        };
        let stated = base > 0 || lines.is_some() || bytes.is_some();
        let lines = u64::try_from(lines.unwrap_or(0))
            .map_err(|_| Error::format(self.path, "a `line skip` below 0", "0 or more"))?;
        let start = match u64::try_from(bytes.unwrap_or(0)) {
            Ok(bytes) => Start::At {
                base,
                lines,
                bytes,
                stated,
            },
            Err(_) if encoding != Encoding::Raw => {
                return Err(Error::format(
                    self.path,
                    "a `byte skip` below 0 with compressed samples",
                    "0 or more",
                ));
            }
            // -1: the samples are the file's last bytes; -2: one byte follows them; ...
            Err(_) => Start::End {
                spare: bytes.unwrap_or(-1).unsigned_abs() - 1,
            },
        };
        Ok(Data {
            files,
            start,
            encoding,
        })
    }

    fn data_files(&self, field: Field, dims: Dims) -> Result<Vec<PathBuf>> {
        let words: Vec<&str> = field.text.split_whitespace().take(6).collect();
        let per_file = |word: Option<&&str>| match word {
            None => Ok(2),
            Some(word) => word
                .parse()
                .map_err(|_| field.wrong("a subdimension of 1 to 3")),
        };
        let names = if is_list(field.text) {
            let subdim: u32 = per_file(words.get(1))?;
            check_count(field, dims, subdim, self.list.len() as u64)?;
            self.list.clone()
        } else if words.len() >= 4 && words[0].contains('%') {
            let subdim: u32 = per_file(words.get(4))?;
            let range = [1, 2, 3].map(|w| words[w].parse::<i64>());
            let [Ok(first), Ok(last), Ok(step)] = range else {
                return Err(field.wrong("a pattern, first and last number and step"));
            };
            let count = match subdim {
                3 if step != 0 => {
                    (i128::from(last) - i128::from(first))
                        .div_euclid(i128::from(step))
                        .clamp(0, i128::from(u32::MAX)) as u64
                        + 1
                }
                1 => u64::from(dims.0[1]) * u64::from(dims.0[2]),
                _ => u64::from(dims.0[2]),
            };
            check_count(field, dims, subdim, count)?;
            text::numbered(field, words[0], [first, last, step], count)?
        } else {
            vec![field.text.to_owned()]
        };
        let folder = self.path.parent().unwrap_or(Path::new(""));
        Ok(names.into_iter().map(|name| folder.join(name)).collect())
    }
}

/// More data files than slices can be are refused before their names take up memory.
const MAX_FILES: u64 = 1 << 20;

/// Checks that `count` files that each have `subdim` dimensions make up the volume: files of a row,
/// of a slice, or slabs of as many slices each.
fn check_count(field: Field, dims: Dims, subdim: u32, count: u64) -> Result<()> {
    let [_, ny, nz] = dims.0.map(u64::from);
    let (fits, expected) = match subdim {
        1 => (count == ny * nz, format!("{} files, one per row", ny * nz)),
        2 => (count == nz, format!("{nz} files, one per slice")),
        3 => (
            count > 0 && nz.is_multiple_of(count),
            format!("a number of files that divides the {nz} slices"),
        ),
        _ => return Err(field.wrong("a subdimension of 1 to 3")),
    };
    if fits && count > MAX_FILES {
        let what = format!("a volume in {count} files");
        return Err(Error::unsupported(
            field.path,
            what,
            "write slices or slabs",
        ));
    }
    if fits {
        return Ok(());
    }
    Err(Error::format(
        field.path,
        format!("{count} data files"),
        expected,
    ))
}

fn is_list(text: &str) -> bool {
    text.split_whitespace().next() == Some("LIST")
}
