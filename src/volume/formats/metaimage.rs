//! MetaImage: `.mhd` with its data in other files, `.mha` with its data behind the header.
//!
//! The format is described at <https://docs.itk.org/en/latest/learn/metaio.html>; where the text is
//! silent this reader does what ITK does. `TransformMatrix` lists the direction of the first axis,
//! then of the second, then of the third. Intensities are `ElementToIntensityFunctionSlope * stored +
//! ElementToIntensityFunctionOffset`. Axes of one entry are left out. What `AnatomicalOrientation` says is not
//! used: the format's text and ITK call the same axes by opposite letters. That it is there tells that places are of a
//! patient, as ITK has them: to the left, to the back and up.

use crate::error::{Error, Result};
use crate::grid::{Dims, Frame, Origin, Placement, Provenance, Unit};
use crate::volume::adapters::values::Values;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::text::{self, Field, Lines};
use crate::volume::options::Choice;
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::stated::warning::{Warning, unapplied_scale};
use crate::volume::{Dtype, Endian};
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

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "metaimage",
    title: "MetaImage",
    extensions: &["mhd", "mha"],
    takes: &[Choice::Resample],
    starts: is_metaimage,
    begins: Some("a MetaImage header, which begins with ObjectType or NDims"),
    headers: &["mhd"],
    parse: Some(|input, _| parse(input.path)),
    in_buckets: true,
    ..Format::BASE
};

/// True if a file begins as a MetaImage header does.
pub(crate) fn is_metaimage(head: &[u8]) -> bool {
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
    /// Number of axes, and the three that have more than one entry.
    count: usize,
    axes: [usize; 3],
    /// Bytes of the header.
    end: u64,
}

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for a damaged or contradictory header, [`Error::Unsupported`] for what is not
/// three-dimensional, has several channels or an unsupported type, or is stored as text.
pub(crate) fn parse(path: &Path) -> Result<VolumeDescriptor> {
    let mut head = Head::read(path)?;
    head.check_supported()?;
    let sizes = head.read_sizes()?;
    let dims = Dims::new(sizes).map_err(|e| e.of_header(path, "`DimSize`"))?;
    let (placement, provenance, warning) = head.placement()?;
    let keys = head
        .fields
        .iter()
        .map(|(key, value)| (key.as_str(), value.as_str()));
    let known = |key: &str| key.starts_with("elementtointensityfunction");
    let unapplied = unapplied_scale(keys.filter(|(key, _)| !known(key)));
    Ok(VolumeDescriptor {
        endian: head.endian()?,
        placement,
        provenance,
        values: head.values()?,
        warnings: warning.into_iter().chain(unapplied).collect(),
        ..VolumeDescriptor::new(
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
            count: 3,
            axes: [0, 1, 2],
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

    /// The sizes of the three axes of the volume.
    fn read_sizes(&mut self) -> Result<[u64; 3]> {
        self.count = self.need("NDims")?.one("a number")?;
        let sizes: Vec<u64> = match self.count {
            // refused; the numbers are for the message
            1 | 2 => self.need("DimSize")?.values(self.count).unwrap_or_default(),
            3..=10 => self.need("DimSize")?.values(self.count)?,
            _ => Vec::new(),
        };
        let Some(axes) = text::kept_axes(&sizes) else {
            let size = sizes.iter().map(u64::to_string).collect::<Vec<_>>();
            let what = format!(
                "a MetaImage of {} dimensions{}",
                self.count,
                text::in_brackets(&size)
            );
            let hint = "volumes have 3: extract one, as with ITK's ExtractImageFilter";
            return Err(Error::unsupported(self.path, what, hint));
        };
        self.axes = axes;
        Ok(axes.map(|axis| sizes[axis]))
    }

    /// The scale of stored samples; `None` if they are the values.
    fn values(&self) -> Result<Option<Values>> {
        let names = [
            "ElementToIntensityFunctionSlope",
            "ElementToIntensityFunctionOffset",
        ];
        let number = |name: &'a str, default: f64| match self.get(name) {
            None => Ok(default),
            Some(field) => match field.one::<f64>("a finite number")? {
                v if v.is_finite() => Ok(v),
                _ => Err(field.wrong("a finite number")),
            },
        };
        let (slope, offset) = (number(names[0], 1.0)?, number(names[1], 0.0)?);
        if slope == 0.0 {
            return Err(self.need(names[0])?.wrong("a number other than 0"));
        }
        Ok(Values::linear(slope, offset, &names.join(" and ")))
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

    /// Spacing, directions, origin and unit, and a warning if the size of a voxel needs one.
    fn placement(&self) -> Result<(Placement, Provenance, Option<Warning>)> {
        let mut place = Placement::default();
        let mut from = Provenance::default();
        // what it says is not used, but programs that write it have patients' axes, to the left, to the back, up
        if self.get("AnatomicalOrientation").is_some() {
            from.frame = Frame::Lps;
        }
        let first_of = |names: &[&'a str]| names.iter().find_map(|name| self.get(name));
        let mut lengths = [1.0; 3];
        if let Some(field) = first_of(&["TransformMatrix", "Rotation", "Orientation"]) {
            let all: Vec<f64> = field.values(self.count * self.count)?;
            let rows = self
                .axes
                .map(|a| self.axes.map(|c| all[self.count * a + c]));
            (lengths, place.directions) = text::axes(field, rows)?;
            // a length other than 1 scales the grid; rounding noise must not change the spacing
            lengths = lengths.map(|l| if (l - 1.0).abs() < 1e-6 { 1.0 } else { l });
            from.origin = Origin::File;
        }
        if let Some(field) = first_of(&["Offset", "Position", "Origin"]) {
            place.origin = field.of_axes(self.count, self.axes)?;
            from.origin = Origin::File;
        }
        let spacing = match first_of(&["ElementSpacing", "ElementSize"]) {
            Some(field) => Some(self.spacing(field)?),
            None => lengths.iter().any(|l| *l != 1.0).then_some([Some(1.0); 3]),
        };
        let Some(spacing) = spacing else {
            return Ok((place, from, None));
        };
        // "?" is how ITK writes that it does not know
        let unit = self.get("DistanceUnits").map_or("", |field| field.text);
        let unit = if unit == "?" { "" } else { unit };
        let mut steps = [None, None, None];
        for (axis, s) in spacing.into_iter().enumerate() {
            let Some(s) = s else { continue };
            let size = lengths[axis] * s.abs();
            if size == 0.0 || !size.is_finite() {
                // refused when options have had their say, as the file states them
                for (place, s) in place.spacing.iter_mut().zip(spacing) {
                    *place = s.unwrap_or(*place);
                }
                return Ok((place, from, None));
            }
            steps[axis] = Some(Step::new(size, unit));
            if s < 0.0 {
                place.directions[axis] = place.directions[axis].map(|v| 0.0 - v);
            }
        }
        let size = voxel_size(steps);
        size.apply(&mut place, &mut from);
        match (size.unit, size.of_file[0]) {
            (Some(unit), Some(length)) => {
                place.origin = place.origin.map(|v| length.convert(v, unit));
            }
            // the format has no unit of old; ITK means millimetres
            _ if size.spacing.is_some() && unit.is_empty() => place.unit = Unit::Millimetre,
            _ => {}
        }
        Ok((place, from, size.warning))
    }

    /// The steps along the axes; that of z may be missing where the file has a number for each of the others.
    fn spacing(&self, field: Field) -> Result<[Option<f64>; 3]> {
        if self.count == 3
            && let Ok(two) = field.values::<f64>(2)
        {
            return Ok([Some(two[0]), Some(two[1]), None]);
        }
        let all: [f64; 3] = field.of_axes(self.count, self.axes)?;
        Ok(all.map(Some))
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
