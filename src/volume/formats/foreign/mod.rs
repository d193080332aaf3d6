//! Formats that are not read: each by its name, with a way to its samples. Where the header is easy to read, the way
//! is the exact options that read the samples as headerless ones; they are offered, never taken.

mod described;
mod lines;
mod name;
mod table;

use crate::error::{Error, Result};
use crate::volume::descriptor::Samples;
use crate::volume::format::{Format, Input, title_of};
use crate::volume::io::blob::Blob;
use crate::volume::options::OpenOptions;
pub(crate) use described::{Described, dtype_of, of_bits, of_width};
use std::io::Read;
use std::path::{Path, PathBuf};
use table::KINDS;

/// Bytes of a header that are looked at.
const HEAD: u64 = 64 << 10;

/// A format, how it is recognised, and the way to its samples.
struct Kind {
    name: &'static str,
    /// By the first bytes, or by a name that nothing else has.
    is: fn(&Path, &[u8]) -> bool,
    /// What its header says of samples that lie in one uncompressed piece.
    read: fn(&Path, &[u8]) -> Option<Described>,
    way: &'static str,
}

/// The format of another program that a file is of, by its content or its name.
fn kind(path: &Path, head: &[u8]) -> Option<&'static Kind> {
    KINDS.iter().find(|kind| (kind.is)(path, head))
}

/// The name of the format of another program that a file is of.
pub(crate) fn named(path: &Path, head: &[u8]) -> Option<&'static str> {
    kind(path, head).map(|kind| kind.name)
}

/// The way from files of a format, one slice in each, to a volume.
pub(crate) fn way_of(name: &str) -> &'static str {
    let kind = KINDS.iter().find(|kind| kind.name == name);
    kind.map_or("", |kind| kind.way)
}

/// Refuses a file of a known format that is not read, with the way to its samples.
///
/// # Errors
/// [`Error::Unsupported`] by name.
pub(crate) fn refuse(path: &Path, head: &[u8], formats: &'static [Format]) -> Result<()> {
    if let Some(inside) = unpacked(path, head, formats)? {
        let what = format!("{inside} packed by gzip");
        let way = match inside {
            "tar" => "unpack it, as with `tar -xf`, and give the file or folder that is in it",
            _ => "unpack it, as with `gunzip -k`",
        };
        return Err(Error::unsupported(path, what, way));
    }
    if head.is_empty() {
        return Err(Error::format(path, "an empty file", "a volume")
            .with_hint("it was never written, or cut short: get it again"));
    }
    let Some(kind) = kind(path, head) else {
        return no_false_name(path, head);
    };
    let long = Blob::file(path)?.head(HEAD)?;
    let hint = match (kind.read)(path, &long) {
        Some(described) => format!("{}; or {}", described.advice(), kind.way),
        None => kind.way.to_owned(),
    };
    Err(Error::unsupported(
        path,
        format!("the {} format", kind.name),
        hint,
    ))
}

/// Refuses a file that does not begin as its name says: it is cut short or damaged.
fn no_false_name(path: &Path, head: &[u8]) -> Result<()> {
    const NAMES: [(&str, &str); 11] = [
        ("tif", "a TIFF"),
        ("tiff", "a TIFF"),
        ("h5", "HDF5"),
        ("hdf5", "HDF5"),
        ("nii", "NIfTI"),
        ("npy", "a NumPy array"),
        ("vti", "VTK image data"),
        ("zip", "a zip"),
        ("dcm", "DICOM"),
        ("mnc", "MINC"),
        ("ims", "Imaris"),
    ];
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let Some((_, name)) = NAMES.iter().find(|(e, _)| extension == *e) else {
        return Ok(());
    };
    let begin = head[..head.len().min(16)].escape_ascii();
    let long = Blob::file(path)?.len();
    let found = format!("a file of {long} bytes that begins with \"{begin}\"");
    Err(Error::format(path, found, format!("{name}, as its name says")).with_hint(
        "it is cut short or damaged: get it again; raw samples under such a name need --dims and --dtype",
    ))
}

/// The name of what a gzip stream holds, if that is not raw samples.
fn unpacked(path: &Path, head: &[u8], formats: &'static [Format]) -> Result<Option<&'static str>> {
    if !head.starts_with(&[0x1f, 0x8b]) {
        return Ok(None);
    }
    let file = crate::volume::io::data::open_file(path)?;
    let mut inside = Vec::new();
    let done = flate2::read::GzDecoder::new(file)
        .take(4096)
        .read_to_end(&mut inside);
    let stem = path.with_extension("");
    Ok(match done {
        Ok(_) => title_of(formats, &inside).or_else(|| named(&stem, &inside)),
        Err(_) => None,
    })
}

/// What a file beside a headerless one, or its name, says of its size and type: words to give to a user.
pub(crate) fn suggestion(path: &Path, formats: &'static [Format]) -> Option<String> {
    let endings = formats.iter().flat_map(|format| format.headers);
    let endings: Vec<&str> = endings.copied().collect();
    let len = Blob::file(path).ok()?.len();
    for beside in beside(path, &endings) {
        let Ok(head) = Blob::file(&beside).and_then(|b| b.head(HEAD)) else {
            continue;
        };
        if is_header_of(&beside, &head, path, formats) {
            return Some(format!(
                "give {}, which says size and type",
                beside.display()
            ));
        }
        let described = kind(&beside, &head).and_then(|kind| (kind.read)(&beside, &head));
        let own = |d: &Described| d.file.file_name() == path.file_name();
        if let Some(described) = described.filter(own) {
            return Some(format!(
                "{} beside it says: {}",
                beside.display(),
                described.advice()
            ));
        }
    }
    let described = name::read(path, len)?;
    Some(format!(
        "its name suggests: {} (nothing else tells the order of the sizes)",
        described.advice()
    ))
}

/// True if a header that is read names this file as the one with its samples.
fn is_header_of(header: &Path, head: &[u8], path: &Path, formats: &'static [Format]) -> bool {
    let mut with_headers = formats.iter().filter(|format| !format.headers.is_empty());
    let format = with_headers.find(|format| (format.starts)(head));
    let Some(parse) = format.and_then(|format| format.parse) else {
        return false;
    };
    let input = Input {
        path: header,
        head,
        formats,
    };
    let parsed = parse(&input, &OpenOptions::default()).map(|found| found.samples);
    match parsed {
        Ok(Samples::Files(data)) => data.files.iter().any(|file| {
            file.file_name() == path.file_name()
                && file.canonicalize().ok() == path.canonicalize().ok()
        }),
        _ => false,
    }
}

/// Headers that may lie beside the samples: with these endings, and those of other programs.
fn beside(path: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let others = ["dat", "ini"];
    let endings = endings.iter().chain(&others);
    let mut all: Vec<PathBuf> = Vec::new();
    for ending in endings {
        all.push(path.with_extension(ending));
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{ending}"));
        all.push(name.into());
    }
    all.retain(|p| p != path && p.is_file());
    all
}

/// Refuses a folder of a known format that is not read.
///
/// # Errors
/// [`Error::Unsupported`] by name.
pub(crate) fn refuse_folder(path: &Path) -> Result<()> {
    let info = path.join("info");
    if info.is_file() {
        let head = Blob::file(&info)?.head(4096)?;
        if let Some(kind) = kind(&info, &head) {
            let what = format!("the {} format", kind.name);
            return Err(Error::unsupported(path, what, kind.way));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
