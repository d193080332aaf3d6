//! MetaImage: `.mhd` with its data in other files, `.mha` with its data behind the header.
//!
//! The format is described at <https://docs.itk.org/en/latest/learn/metaio.html>; where the text is
//! silent this reader does what ITK does. `TransformMatrix` lists the direction of the first axis,
//! then of the second, then of the third.

use super::layout::{Data, Encoding, Recipe, Samples, Start};
use super::text::{self, Field, Lines};
use super::{Dtype, Endian};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Keys with which a header may begin, in lower case.
const FIRST_KEYS: &[&str] = &[
    "anatomicalorientation",
    "binarydata",
    "binarydatabyteordermsb",
    "comment",
    "compresseddata",
    "dimsize",
    "elementbyteordermsb",
    "elementnumberofchannels",
    "elementsize",
    "elementspacing",
    "elementtype",
    "headersize",
    "id",
    "modality",
    "name",
    "ndims",
    "objectsubtype",
    "objecttype",
    "offset",
    "transformmatrix",
    "transformtype",
];

/// True if a file begins as a MetaImage header does.
pub(super) fn is_metaimage(head: &[u8]) -> bool {
    let Some(at) = head.iter().position(|&b| b == b'=' || b == b':') else {
        return false;
    };
    std::str::from_utf8(&head[..at])
        .is_ok_and(|key| FIRST_KEYS.contains(&key.trim().to_ascii_lowercase().as_str()))
}

struct Head<'a> {
    path: &'a Path,
    fields: HashMap<String, String>,
    /// Lines below `ElementDataFile = LIST`.
    list: Vec<String>,
    /// Bytes of the header.
    end: u64,
}

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for a damaged or contradictory header, [`Error::Unsupported`] for what is not
/// three-dimensional, has several channels or an unsupported type, or is stored as text.
pub(super) fn parse(path: &Path) -> Result<Recipe> {
    let head = Head::read(path)?;
    head.check_supported()?;
    let dims = Dims::new(head.need("DimSize")?.values()?)
        .map_err(|e| Error::format(path, format!("`DimSize` with {e}"), "a volume of that size"))?;
    let (placement, provenance) = head.placement()?;
    Ok(Recipe {
        endian: head.endian()?,
        placement,
        provenance,
        ..Recipe::new(
            "metaimage",
            dims,
            head.dtype()?,
            Samples::Files(head.data(dims)?),
        )
    })
}

impl<'a> Head<'a> {
    fn read(path: &'a Path) -> Result<Self> {
        let mut lines = Lines::open(path)?;
        let mut head = Head {
            path,
            fields: HashMap::new(),
            list: Vec::new(),
            end: 0,
        };
        while let Some(line) = lines.next()? {
            if line.trim().is_empty() {
                continue;
            }
            let Some((name, text)) = line.split_once(['=', ':']) else {
                let line: String = line.chars().take(80).collect();
                return Err(Error::format(path, format!("`{line}`"), "`Key = Value`"));
            };
            let key = name.trim().to_ascii_lowercase();
            let last = key == "elementdatafile";
            let text = text.trim().to_owned();
            let list = last && text.split_whitespace().next() == Some("LIST");
            head.fields.insert(key, text);
            if last {
                head.end = lines.position();
                while let Some(name) = if list { lines.next()? } else { None } {
                    if !name.trim().is_empty() {
                        head.list.push(name.trim().to_owned());
                    }
                }
                return Ok(head);
            }
        }
        Err(Error::format(
            path,
            "no field `ElementDataFile`",
            "a MetaImage header that ends with it",
        ))
    }

    fn get(&self, name: &'a str) -> Option<Field<'_>> {
        let text = self.fields.get(&name.to_ascii_lowercase())?;
        Some(Field {
            path: self.path,
            name,
            text,
        })
    }

    fn need(&self, name: &'a str) -> Result<Field<'_>> {
        self.get(name).ok_or_else(|| {
            let found = format!("no field `{name}`");
            Error::format(self.path, found, "a MetaImage header that has it")
        })
    }

    /// A boolean; ITK looks at the first letter only.
    fn flag(&self, name: &'a str) -> Result<Option<bool>> {
        let Some(field) = self.get(name) else {
            return Ok(None);
        };
        match field.text.as_bytes().first() {
            Some(b'T' | b't' | b'1') => Ok(Some(true)),
            Some(b'F' | b'f' | b'0') => Ok(Some(false)),
            _ => Err(field.wrong("True or False")),
        }
    }

    fn check_supported(&self) -> Result<()> {
        let refuse = |what: String, hint: &str| Err(Error::unsupported(self.path, what, hint));
        let ndims: u32 = self.need("NDims")?.one("a number")?;
        if ndims != 3 {
            let what = format!("a MetaImage of {ndims} dimensions");
            return refuse(what, "volumes have 3");
        }
        if let Some(field) = self.get("ElementNumberOfChannels") {
            let channels: u32 = field.one("a number")?;
            if channels != 1 {
                let what = format!("a MetaImage of {channels} channels");
                return refuse(what, "only one number per voxel can be read");
            }
        }
        if self.flag("BinaryData")? == Some(false) {
            return refuse(
                "a MetaImage stored as text".into(),
                "write it with BinaryData = True",
            );
        }
        if let Some(field) = self.get("ObjectType")
            && !field.text.eq_ignore_ascii_case("Image")
        {
            return refuse(
                format!("the MetaIO object `{}`", field.text),
                "only images are",
            );
        }
        Ok(())
    }

    fn dtype(&self) -> Result<Dtype> {
        let field = self.need("ElementType")?;
        Ok(match field.text {
            "MET_UCHAR" => Dtype::U8,
            "MET_CHAR" => Dtype::I8,
            "MET_USHORT" => Dtype::U16,
            "MET_SHORT" => Dtype::I16,
            // MetaIO stores long in 4 bytes on every machine
            "MET_UINT" | "MET_ULONG" => Dtype::U32,
            "MET_INT" | "MET_LONG" => Dtype::I32,
            "MET_FLOAT" => Dtype::F32,
            "MET_DOUBLE" => Dtype::F64,
            name if name.starts_with("MET_") => {
                return Err(Error::unsupported(
                    self.path,
                    format!("the MetaImage type `{name}`"),
                    "convert it to one number of at most 32 bits, or double",
                ));
            }
            _ => return Err(field.wrong("a type such as MET_UCHAR, MET_SHORT or MET_FLOAT")),
        })
    }

    fn endian(&self) -> Result<Option<Endian>> {
        let names = ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"];
        let big = match (self.flag(names[0])?, self.flag(names[1])?) {
            (Some(a), Some(b)) if a != b => {
                let found = format!("{} and {} that differ", names[0], names[1]);
                return Err(Error::format(self.path, found, "one byte order"));
            }
            (a, b) => a.or(b),
        };
        Ok(big.map(|big| if big { Endian::Big } else { Endian::Little }))
    }

    fn placement(&self) -> Result<(Placement, Provenance)> {
        let mut place = Placement::default();
        let mut from = Provenance::default();
        let first_of = |names: &[&'a str]| names.iter().find_map(|name| self.get(name));
        if let Some(field) = first_of(&["TransformMatrix", "Rotation", "Orientation"]) {
            let m: [f64; 9] = field.values()?;
            let rows = std::array::from_fn(|a| std::array::from_fn(|i| m[3 * a + i]));
            let (lengths, directions) = text::axes(field, rows)?;
            // a length other than 1 scales the grid; rounding noise must not change the spacing
            place.spacing = lengths.map(|l| if (l - 1.0).abs() < 1e-6 { 1.0 } else { l });
            place.directions = directions;
            from.origin = Origin::File;
        }
        if let Some(field) = first_of(&["Offset", "Position", "Origin"]) {
            place.origin = field.values()?;
            from.origin = Origin::File;
        }
        if let Some(field) = first_of(&["ElementSpacing", "ElementSize"]) {
            let spacing: [f64; 3] = field.values()?;
            for (axis, s) in spacing.into_iter().enumerate() {
                place.spacing[axis] *= s.abs();
                if s < 0.0 {
                    place.directions[axis] = place.directions[axis].map(|v| -v);
                }
            }
            from.spacing = [Origin::File; 3];
            // the format has no unit of old; ITK means millimetres
            place.unit = Unit::Millimetre;
        }
        if let Some(Ok(unit)) = self.get("DistanceUnits").map(|f| f.text.parse()) {
            place.unit = unit;
            from.unit = Origin::File;
        }
        Ok((place, from))
    }

    fn data(&self, dims: Dims) -> Result<Data> {
        let compressed = self.flag("CompressedData")? == Some(true);
        let encoding = if compressed {
            Encoding::Zlib
        } else {
            Encoding::Raw
        };
        let field = self.need("ElementDataFile")?;
        let local = field.text.eq_ignore_ascii_case("LOCAL");
        let header_size = self
            .get("HeaderSize")
            .map(|f| f.one::<i64>("a number"))
            .transpose()?;
        let base = if local { self.end } else { 0 };
        let start = match header_size {
            None | Some(0) => Start::At {
                base,
                lines: 0,
                bytes: 0,
                stated: local,
            },
            Some(-1) if !compressed => Start::End { spare: 0 },
            // counted from the beginning of the file, also behind a header
            Some(n) if n > 0 && n as u64 >= base => Start::At {
                base: n as u64,
                lines: 0,
                bytes: 0,
                stated: true,
            },
            Some(_) => return Err(self.need("HeaderSize")?.wrong(
                "-1 for uncompressed samples at the file's end, 0, or the bytes before the samples",
            )),
        };
        let files = if local {
            vec![self.path.to_path_buf()]
        } else {
            self.data_files(field, dims)?
        };
        Ok(Data {
            files,
            start,
            encoding,
        })
    }

    fn data_files(&self, field: Field, dims: Dims) -> Result<Vec<PathBuf>> {
        let words: Vec<&str> = field.text.split_whitespace().collect();
        let nz = u64::from(dims.0[2]);
        let names = match &words[..] {
            ["LIST", rest @ ..] => {
                let whole = matches!(rest, ["3" | "3D"]);
                let expected = if whole { 1 } else { nz };
                if self.list.len() as u64 != expected {
                    let found = format!("{} names of data files", self.list.len());
                    return Err(Error::format(self.path, found, format!("{expected}")));
                }
                self.list.clone()
            }
            [pattern, range @ ..] if pattern.contains('%') => {
                let numbers: Option<Vec<i64>> = range.iter().map(|w| w.parse().ok()).collect();
                let range = match numbers.as_deref() {
                    Some([]) => [1, nz as i64, 1],
                    Some([first]) => [*first, first.saturating_add(nz as i64 - 1), 1],
                    Some([first, last]) => [*first, *last, spread(*first, *last, nz)],
                    Some([first, last, step]) => [*first, *last, *step],
                    _ => return Err(field.wrong("a pattern, first and last number and step")),
                };
                text::numbered(field, pattern, range, nz)?
            }
            [] => return Err(field.wrong("a file name, a pattern, LIST or LOCAL")),
            _ => vec![field.text.to_owned()],
        };
        let folder = self.path.parent().unwrap_or(Path::new(""));
        Ok(names.into_iter().map(|name| folder.join(name)).collect())
    }
}

/// The step that leads from `first` to `last` in `count` numbers.
fn spread(first: i64, last: i64, count: u64) -> i64 {
    let span = i128::from(last) - i128::from(first);
    i64::try_from(span / i128::from(count.max(2) - 1)).unwrap_or(0)
}
