//! NRRD: attached and detached headers, one data file or many.
//!
//! The format is described at <https://teem.sourceforge.net/nrrd/format.html>. World coordinates are
//! kept as the file has them, in whatever space (RAS, LPS, ...) it states, but for left-handed ones, whose x is
//! turned round. Axes of one entry are left out. `axis mins` and `axis maxs` are not used, and samples that were
//! quantized (`old min`, `old max`) stay as they are stored, as ITK and pynrrd have them, with a warning.

mod samples;
mod space;

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::io::text::{self, Field, Lines};
use crate::volume::options::Choice;
use crate::volume::stated::warning::{Warning, unapplied_scale};
use crate::volume::{Dtype, Endian};
use std::collections::HashMap;
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "nrrd",
    title: "NRRD",
    extensions: &["nrrd", "nhdr"],
    takes: &[Choice::Resample],
    starts: is_nrrd,
    begins: Some("a NRRD file, which begins with NRRD000"),
    headers: &["nhdr"],
    parse: Some(|input, _| parse(input.path)),
    in_buckets: true,
    ..Format::BASE
};

/// True if a file begins as NRRD does.
pub(crate) fn is_nrrd(head: &[u8]) -> bool {
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
    /// Keys of the user's own, `key:=value`.
    own: Vec<(String, String)>,
    /// Entries along every axis, and the three axes that have more than one.
    sizes: Vec<u64>,
    axes: [usize; 3],
    /// Bytes of the header, its blank line included; `None` if the file ends without one.
    end: Option<u64>,
}

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for a damaged or contradictory header, [`Error::Unsupported`] for what is not
/// three-dimensional, not of a supported type, or not stored as raw or gzip.
pub(crate) fn parse(path: &Path) -> Result<VolumeDescriptor> {
    let mut head = Head::read(path)?;
    head.read_sizes()?;
    head.check_kinds()?;
    head.check_labels()?;
    let sizes = head.axes.map(|axis| head.sizes[axis]);
    let dims = Dims::new(sizes).map_err(|e| e.of_header(path, "`sizes`"))?;
    let dtype = head.dtype()?;
    let endian = match head.get("endian") {
        None => None,
        Some(field) => match field.text.to_ascii_lowercase().as_str() {
            "little" => Some(Endian::Little),
            "big" => Some(Endian::Big),
            _ => return Err(field.wrong("little or big")),
        },
    };
    let mut place = head.place()?;
    place.warnings.extend(head.quantized().map(Warning::from));
    place.warnings.extend(head.times());
    let own = head
        .own
        .iter()
        .map(|(key, value)| (key.as_str(), value.as_str()));
    place.warnings.extend(unapplied_scale(own));
    Ok(VolumeDescriptor {
        endian,
        placement: place.placement,
        provenance: place.provenance,
        notes: place.notes,
        warnings: place.warnings,
        ..VolumeDescriptor::new("nrrd", dims, dtype, Samples::Files(head.data()?))
    })
}

impl<'a> Head<'a> {
    fn read(path: &'a Path) -> Result<Self> {
        let mut lines = Lines::open(path)?;
        let mut head = Head {
            path,
            fields: HashMap::new(),
            list: Vec::new(),
            own: Vec::new(),
            sizes: Vec::new(),
            axes: [0, 1, 2],
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
            if let Some(value) = text.strip_prefix('=') {
                head.own
                    .push((name.trim().to_owned(), value.trim().to_owned()));
                continue;
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

    fn read_sizes(&mut self) -> Result<()> {
        let dimension: usize = self.need("dimension")?.one("a number")?;
        let sizes = match dimension {
            3 => self.need("sizes")?.values(3)?,
            // refused; the numbers are for the message
            1 | 2 => self
                .get("sizes")
                .and_then(|sizes| sizes.values(dimension).ok())
                .unwrap_or_default(),
            4..=16 if self.get("sizes").is_some() => self.need("sizes")?.values(dimension)?,
            _ => Vec::new(),
        };
        let Some(axes) = text::kept_axes(&sizes) else {
            let size = sizes.iter().map(u64::to_string).collect::<Vec<_>>();
            let what = format!(
                "a NRRD of {dimension} dimensions{}",
                text::in_brackets(&size)
            );
            let hint = "volumes have 3: extract one with `unu slice` or ITK";
            return Err(Error::unsupported(self.path, what, hint));
        };
        (self.sizes, self.axes) = (sizes, axes);
        Ok(())
    }

    /// Words of a field for the three axes; none where it has fewer.
    fn words(&self, name: &'a str) -> Option<[String; 3]> {
        let field = self.get(name)?;
        let words: Vec<&str> = match field.text.contains('"') {
            true => field.text.split('"').skip(1).step_by(2).collect(),
            false => field.text.split_whitespace().collect(),
        };
        let word = |axis: usize| words.get(axis).map(|w| w.trim().to_ascii_lowercase());
        let [x, y, z] = self.axes.map(word);
        Some([x?, y?, z?])
    }

    /// Refuses axes that hold the components of colours or vectors.
    fn check_kinds(&self) -> Result<()> {
        let Some(kinds) = self.words("kinds") else {
            return Ok(());
        };
        let components = [
            "color",
            "vector",
            "complex",
            "quaternion",
            "matrix",
            "gradient",
            "normal",
            "point",
        ];
        let has_components = |kind: &String| {
            // entries of a list, and a few numbers without a meaning, lie no distance apart
            let few = matches!(
                kind.as_str(),
                "list" | "scalar" | "stub" | "2-vector" | "3-vector" | "4-vector"
            );
            few || components.iter().any(|c| kind.contains(c))
        };
        if kinds.iter().any(has_components) {
            return Err(Error::unsupported(
                self.path,
                format!(
                    "a NRRD whose samples have components (kinds: {})",
                    kinds.join(" ")
                ),
                "only one number per voxel can be read",
            ));
        }
        Ok(())
    }

    /// Refuses axes that are called x, y and z, but in another order: they would be read as a mirrored volume.
    fn check_labels(&self) -> Result<()> {
        let Some(labels) = self.words("labels") else {
            return Ok(());
        };
        let mut sorted = labels.clone();
        sorted.sort();
        if sorted == ["x", "y", "z"] && labels != sorted {
            let what = format!("a NRRD whose labels call its axes {}", labels.join(", "));
            let hint = "the fastest axis must be x: `unu permute` changes their order";
            return Err(Error::unsupported(self.path, what, hint));
        }
        Ok(())
    }

    /// What to say of samples that were quantized.
    fn quantized(&self) -> Option<String> {
        let [low, high] = ["old min", "old max"].map(|name| self.get(name));
        let number = |field: Option<Field>| field.and_then(|f| f.text.trim().parse::<f64>().ok());
        let (low, high) = (number(low), number(high));
        (low.is_some() || high.is_some()).then(|| {
            let word = |v: Option<f64>| v.map_or("?".into(), |v| v.to_string());
            format!(
                "samples were quantized from values of {} to {} (old min, old max) and are read as they are stored: \
                 `unu unquantize` restores the values",
                word(low),
                word(high)
            )
        })
    }

    /// What to say of a volume one of whose axes is time.
    fn times(&self) -> Option<Warning> {
        let time = |kinds: [String; 3]| kinds.iter().any(|kind| kind == "time");
        self.words("kinds").is_some_and(time).then(|| {
            Warning::of_size(
                "an axis of the file is time (kinds), which is read as one of space: give --spacing and --unit",
            )
        })
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
}

fn is_list(text: &str) -> bool {
    text.split_whitespace().next() == Some("LIST")
}
