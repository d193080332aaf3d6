//! Volume Graphics' `.vgi`, and `.vgl` if it is the same text, as old versions wrote it: a volume `{volume1}` with
//! its size and type in `[representation]`, its file in `[file1]`, and the size of a voxel in `[geometry]`.
//!
//! Where the two differ in type, VGSTUDIO shows samples that it converts; here they are those of the file. The place of
//! the volume in a scene (`position`, `rotate`) is left out.

use crate::error::{Error, Result};
use crate::volume::Dtype;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::formats::foreign::{Described, of_bits};
use crate::volume::formats::sidecar::keys::{Keys, Value, has_words};
use crate::volume::formats::sidecar::{Sidecar, named};
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::io::text::Field;
use crate::volume::stated::size::Step;
use crate::volume::stated::warning::Warning;
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "vgi",
    title: "VGI",
    extensions: &["vgi"],
    starts: |head| has_words(head, &["{volume", "[representation]"]),
    begins: Some("a VGI header, which has the section [representation]"),
    headers: &["vgi", "vgl"],
    parse: Some(|input, _| parse(input.path)),
    ..Format::BASE
};

const WHOLE: &str = "representation";
const FILE: &str = "file1";
const PLACE: &str = "geometry";

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for what is missing or contradicts itself; [`Error::Unsupported`] for several volumes or files, a
/// part of a file, mirrored volumes and files that are not raw.
fn parse(path: &Path) -> Result<VolumeDescriptor> {
    let keys = Keys::read(path)?;
    refuse_several(path, &keys)?;
    let size = stated(&keys, "size")?;
    let sizes = three::<u64>(size)?;
    let dtype = dtype(path, &keys, [FILE, WHOLE])?;
    let sidecar = Sidecar::new(path, named(path, keys.need(FILE, "Name")?.text), sizes)?;
    let skip = keys.get(FILE, "SkipHeader")?;
    let skip: Option<u64> = skip
        .map(|f| f.one("bytes before the samples"))
        .transpose()?;
    let described = Described {
        offset: skip.unwrap_or(0),
        ..Described::new(sidecar.file.clone(), sizes, dtype)
    };
    refuse_changed(path, &keys, sizes, &described)?;
    let shown = keys
        .get(WHOLE, "datatype")?
        .map(|_| self::dtype(path, &keys, [WHOLE, FILE]));
    let note = match shown.transpose()? {
        Some(shown) if shown != dtype => Some(format!(
            "VGSTUDIO shows samples as {shown}; those of the file are read, which are {dtype}"
        )),
        _ => None,
    };
    let unit = keys.get(PLACE, "unit")?.map_or("", |field| field.text);
    let steps = match keys.get(PLACE, "resolution")? {
        Some(field) => three::<f64>(field)?.map(|size| Some(Step::new(size, unit))),
        None => [None, None, None],
    };
    let files = vec![sidecar.file.clone()];
    let mut found = sidecar.descriptor("vgi", dtype, steps);
    if let Some(bytes) = skip.filter(|n| *n > 0) {
        found.samples = Samples::Files(Data {
            files,
            start: Start::At {
                base: 0,
                lines: 0,
                bytes,
                stated: true,
            },
            encoding: Encoding::Raw,
        });
    }
    found.notes.extend(note);
    found.warnings.extend(scaled(&keys)?);
    Ok(found)
}

/// A value of the file, or of the whole where the file has none.
fn stated<'a>(keys: &'a Keys, name: &str) -> Result<Value<'a>> {
    match keys.get(FILE, name)? {
        Some(value) => Ok(value),
        None => keys.need(WHOLE, name),
    }
}

fn three<T: std::str::FromStr + Copy>(field: Field) -> Result<[T; 3]> {
    let values: Vec<T> = field.values(3)?;
    Ok([values[0], values[1], values[2]])
}

fn refuse_several(path: &Path, keys: &Keys) -> Result<()> {
    let volumes = keys.distinct(|_, section| section == WHOLE);
    let files = keys.distinct(|_, section| {
        let number = section.strip_prefix("file");
        number.is_some_and(|n| n.parse::<u32>().is_ok())
    });
    let hint = "save one volume with its samples in one file, or its slices as TIFF, from VGSTUDIO";
    match (volumes, files) {
        (0 | 1, 0 | 1) => Ok(()),
        (0 | 1, n) => Err(Error::unsupported(
            path,
            format!("a volume in {n} files"),
            hint,
        )),
        (n, _) => Err(Error::unsupported(
            path,
            format!("a header of {n} volumes"),
            hint,
        )),
    }
}

/// The type of samples, of the first of two sections that states it.
fn dtype(path: &Path, keys: &Keys, sections: [&str; 2]) -> Result<Dtype> {
    let of = |name: &str| match keys.get(sections[0], name)? {
        Some(value) => Ok(value),
        None => keys.need(sections[1], name),
    };
    let (kind, bits) = (of("datatype")?, of("bitsperelement")?);
    let known = ["unsigned integer", "signed integer", "float"];
    if !known.contains(&kind.text.to_lowercase().as_str()) {
        return Err(kind.wrong("unsigned integer, signed integer or float"));
    }
    of_bits(kind.text, bits.one("a number of bits")?).ok_or_else(|| {
        let what = format!("samples of type {} of {} bits", kind.text, bits.text);
        let hint = "save it as whole numbers of 8, 16 or 32 bits, or floats of 32 or 64";
        Error::unsupported(path, what, hint)
    })
}

/// Refuses volumes that are not all that the file has, as the file has it, with the way to its samples.
fn refuse_changed(path: &Path, keys: &Keys, sizes: [u64; 3], described: &Described) -> Result<()> {
    let refuse = |what: String| Err(Error::unsupported(path, what, described.advice()));
    let format = keys.get(FILE, "FileFormat")?;
    if let Some(format) = format.filter(|f| !f.text.eq_ignore_ascii_case("raw")) {
        let hint = "give that file, or the folder of its slices";
        let what = format!("a volume in {} files", format.text);
        return Err(Error::unsupported(path, what, hint));
    }
    let part = |name: &str, whole: [u64; 3]| match keys.get(FILE, name)? {
        Some(field) => Ok(three::<u64>(field)? != whole),
        None => Ok(false),
    };
    let last = sizes.map(|n| n.saturating_sub(1));
    if part("RegionOfInterestStart", [0; 3])? || part("RegionOfInterestEnd", last)? {
        return refuse("a region of interest of the file".into());
    }
    if let Some(whole) = keys.get(WHOLE, "size")?
        && three::<u64>(whole)? != sizes
    {
        let [x, y, z] = sizes;
        return Err(whole.wrong(format!("{x} {y} {z}, the size of the file")));
    }
    for (section, name) in [(WHOLE, "mirror"), (FILE, "mirror")] {
        let mirror = keys.get(section, name)?;
        if let Some(field) = mirror.filter(|f| f.text.split_whitespace().any(|w| w != "0")) {
            return refuse(format!(
                "a volume that is turned round (`mirror = {}`)",
                field.text
            ));
        }
    }
    Ok(())
}

/// What to say of a scale of the volume in its scene.
fn scaled(keys: &Keys) -> Result<Option<Warning>> {
    let scale = keys.get(PLACE, "scale")?;
    let other = |f: &Field| three::<f64>(*f).is_ok_and(|scale| scale != [1.0; 3]);
    Ok(scale.filter(other).map(|field| {
        Warning::of_size(format!(
            "the header states a scale of {}, which is not applied to the size of a voxel: give --spacing and --unit if \
             it should be",
            field.text
        ))
    }))
}
