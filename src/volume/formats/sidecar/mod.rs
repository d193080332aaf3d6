//! Raw samples in one file and a header of text beside them, as scanners write it: Volume Graphics' `.vgi`, Nikon's
//! `.xtekct`, ESRF's `.vol.info` and GE phoenix's `.pcr`.
//!
//! None of these has a public specification. The keys are those that the programs write, as files in use show them;
//! what a header does not state, the type of samples in most of them, follows from the length of the file with the
//! samples, and is told. Headers that contradict themselves, or state what is not read here, are refused with the
//! options that read the samples as headerless ones.

mod esrf;
mod keys;
mod nikon;
mod pcr;
#[cfg(test)]
mod tests;
mod vgi;

pub(crate) use esrf::FORMAT as ESRF;
pub(crate) use nikon::FORMAT as NIKON;
pub(crate) use pcr::FORMAT as PCR;
pub(crate) use vgi::FORMAT as VGI;

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::formats::foreign::of_width;
use crate::volume::io::data::{self, Data, Encoding, Start};
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::{Dtype, Endian};
use keys::Keys;
use std::path::{Path, PathBuf};

/// A header beside raw samples, and what all formats of that kind ask of it.
struct Sidecar<'a> {
    /// The header.
    path: &'a Path,
    /// The file with the samples.
    file: PathBuf,
    /// Where in it they begin.
    start: Start,
    dims: Dims,
}

/// The file, or the only one beside it whose name differs in the case of letters alone: programs of Windows take both for
/// the same.
fn as_there(file: &Path) -> Option<PathBuf> {
    if file.is_file() {
        return Some(file.to_path_buf());
    }
    let name = file.file_name()?.to_str()?;
    let dir = file.parent().filter(|dir| *dir != Path::new(""));
    let beside = std::fs::read_dir(dir.unwrap_or(Path::new(".")));
    let beside = beside.ok()?.flatten();
    let alike = |entry: &std::fs::DirEntry| {
        let other = entry.file_name();
        other.to_str().is_some_and(|o| o.eq_ignore_ascii_case(name)) && entry.path().is_file()
    };
    let mut alike = beside.filter(alike);
    let only = alike.next()?.path();
    alike.next().is_none().then_some(only)
}

impl<'a> Sidecar<'a> {
    /// Samples in the first of these files that is there, its name in small or large letters.
    ///
    /// # Errors
    /// [`Error::Format`] if none is, or if sizes are out of range.
    fn new(path: &'a Path, files: Vec<PathBuf>, sizes: [u64; 3]) -> Result<Self> {
        let dims = Dims::new(sizes).map_err(|e| e.of_header(path, "a volume"))?;
        let expected = files.first().map(|file| file.display().to_string());
        match files.iter().find_map(|file| as_there(file)) {
            Some(file) => Ok(Sidecar {
                path,
                file,
                start: Start::UNSTATED,
                dims,
            }),
            None => Err(Error::format(
                path,
                "a header without samples",
                "its samples in a file beside it",
            )
            .with_hint(format!("put {} there", expected.unwrap_or_default()))),
        }
    }

    /// The type that the length of the file with the samples gives: unsigned numbers of 8 or 16 bits, or floats of 32 or
    /// 64. The length of one that is packed tells nothing, so none is.
    fn by_length(&self) -> Result<Dtype> {
        let len = data::file_len(&self.file)?;
        of_width(self.dims.0.map(u64::from), len).ok_or_else(|| {
            let voxels = self.dims.voxels();
            let found = format!("{len} bytes in {}", self.file.display());
            let expected = format!("1, 2, 4 or 8 bytes for each of {voxels} voxels");
            Error::format(self.path, found, expected)
                .with_hint("the file is cut short, or belongs to another header")
        })
    }

    /// What to say of a type that follows from the length alone.
    fn told(&self, dtype: Dtype) -> String {
        format!(
            "the header does not state the type of samples, {dtype} by the length of {}: if it is another, read that file \
             with --dims and --dtype",
            self.file.display()
        )
    }

    /// The volume of samples of a type, with steps between voxels as the header states them.
    fn descriptor(
        self,
        format: &'static str,
        dtype: Dtype,
        steps: [Option<Step>; 3],
    ) -> VolumeDescriptor {
        let data = Data {
            files: vec![self.file],
            start: self.start,
            encoding: Encoding::Raw,
        };
        let mut found = VolumeDescriptor::new(format, self.dims, dtype, Samples::Files(data));
        let size = voxel_size(steps);
        size.apply(&mut found.placement, &mut found.provenance);
        found.warnings.extend(size.warning);
        found
    }
}

/// Where a file may be that a header names: beside it under the last part of the name, since folders are often those
/// of another machine, or as the name says.
fn named(header: &Path, name: &str) -> Vec<PathBuf> {
    let name = name.trim().trim_matches('"');
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let inside = name.replace('\\', "/");
    vec![header.with_file_name(last), header.with_file_name(inside)]
}

/// The byte order in words such as `LOWBYTEFIRST`.
fn endian(field: keys::Value) -> Result<Endian> {
    match field.text.to_ascii_lowercase() {
        text if text.starts_with("low") || text.starts_with("little") => Ok(Endian::Little),
        text if text.starts_with("high") || text.starts_with("big") => Ok(Endian::Big),
        _ => Err(field.wrong("LOWBYTEFIRST or HIGHBYTEFIRST")),
    }
}

/// Three numbers under three keys of a section.
fn each<T: std::str::FromStr>(keys: &Keys, section: &str, names: [&str; 3]) -> Result<[T; 3]> {
    let [x, y, z] = names.map(|name| keys.need(section, name)?.one("a number"));
    Ok([x?, y?, z?])
}

/// Steps under three keys of a section; `None` if there is none of them.
fn steps(keys: &Keys, section: &str, names: [&str; 3], unit: &str) -> Result<[Option<Step>; 3]> {
    let step = |name: &str| -> Result<Option<Step>> {
        let found = keys.get(section, name)?;
        Ok(found.map(|field| Step::of_text(field.text, unit)))
    };
    let [x, y, z] = names.map(step);
    Ok([x?, y?, z?])
}
