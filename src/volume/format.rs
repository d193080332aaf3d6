//! What a format that is read is: how its files are told from others, which options it takes, how it is parsed.

use crate::error::{Error, Result};
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::io::blob::Blob;
use crate::volume::options::{Choice, OpenOptions};
use std::path::{Path, PathBuf};

/// A format. [`Format::BASE`] has what most of them leave out.
pub(crate) struct Format {
    /// As headers and manifests have it.
    pub(crate) name: &'static str,
    /// As people call it.
    pub(crate) title: &'static str,
    /// Endings of names that are usual, for people: what is in a file decides.
    pub(crate) extensions: &'static [&'static str],
    /// Those of the options that choose a part, or how it is read, that it takes.
    pub(crate) takes: &'static [Choice],
    /// True for the first bytes of a file of it, of which there are 400 at least unless the file is shorter.
    pub(crate) starts: fn(&[u8]) -> bool,
    /// True for a file or folder of it that its first bytes do not tell.
    pub(crate) looks: Option<fn(&Path, &[u8]) -> bool>,
    /// A folder is one volume, and every file in it may be a part of that.
    pub(crate) folder: bool,
    /// How a header of it begins, for people, if that is text: a file whose name ends so must begin so, and
    /// `--dims` and `--dtype` have to agree with it. Of other formats these pick samples out of the file.
    pub(crate) begins: Option<&'static str>,
    /// Endings of headers whose samples lie in another file.
    pub(crate) headers: &'static [&'static str],
    /// Parses a file or folder of it, if that may be a whole volume.
    pub(crate) parse: Option<Parse>,
    /// Parses files of which each may be one slice.
    pub(crate) slices: Option<Slices>,
    /// It is read in few requests, so that it may lie in a bucket.
    pub(crate) in_buckets: bool,
}

/// Parses one input.
pub(crate) type Parse = fn(&Input, &OpenOptions) -> Result<VolumeDescriptor>;

/// Parses the files of a volume, in their order; the path is that of the folder, pattern or archive that has them.
/// What lies beside them under names of slices and is none comes along, if they say where they lie.
pub(crate) type ParseSlices =
    fn(&Path, Vec<Blob>, Vec<Unread>, &OpenOptions) -> Result<VolumeDescriptor>;

/// Slices in files of their own.
#[derive(Clone, Copy)]
pub(crate) struct Slices {
    pub(crate) parse: ParseSlices,
    /// True for a file that is one slice and no more.
    pub(crate) is_single: fn(&Path) -> Result<bool>,
    /// Slices say where they lie, so that the order of their names does not count, and may lie in folders of folders.
    /// No more than one format has such ones.
    pub(crate) placed: bool,
}

/// What stands in a folder under the name of a slice.
#[derive(Debug, Clone)]
pub(crate) struct Unread {
    pub(crate) path: PathBuf,
    /// What it is instead of a slice.
    pub(crate) found: String,
    pub(crate) is_folder: bool,
}

impl Unread {
    pub(crate) fn error(&self) -> Error {
        Error::format(&self.path, &self.found, "a slice, as its name says").with_hint(
            "a slice is cut short or damaged: replace it, or take it out of the folder if it is none",
        )
    }

    /// What a note says of one that is not among the slices that are read.
    #[cfg_attr(not(feature = "dicom"), allow(dead_code))]
    pub(crate) fn note(&self) -> String {
        format!(
            "{} is passed by: it is {} and no slice",
            self.path.display(),
            self.found
        )
    }
}

/// What is opened.
pub(crate) struct Input<'a> {
    pub(crate) path: &'a Path,
    /// The first bytes of a file, of a folder none.
    pub(crate) head: &'a [u8],
    /// All formats, for what holds files of others.
    pub(crate) formats: &'static [Format],
}

impl Format {
    /// A format of which nothing is recognised.
    pub(crate) const BASE: Format = Format {
        name: "",
        title: "",
        extensions: &[],
        takes: &[],
        starts: |_| false,
        looks: None,
        folder: false,
        begins: None,
        headers: &[],
        parse: None,
        slices: None,
        in_buckets: false,
    };

    /// True for a file of it, by its first bytes or, if these do not tell, by more of it.
    pub(crate) fn is_file(&self, path: &Path, head: &[u8]) -> bool {
        let looks = self.looks.filter(|_| !self.folder);
        (self.starts)(head) || looks.is_some_and(|looks| looks(path, head))
    }

    /// True for a folder of it.
    pub(crate) fn is_folder(&self, path: &Path) -> bool {
        let looks = self.looks.filter(|_| self.folder);
        looks.is_some_and(|looks| looks(path, &[]))
    }

    /// Slices in the order of their names.
    pub(crate) fn has_ordered_slices(&self) -> bool {
        self.slices.is_some_and(|slices| !slices.placed)
    }

    /// Slices that say where they lie.
    pub(crate) fn has_placed_slices(&self) -> bool {
        self.slices.is_some_and(|slices| slices.placed)
    }

    /// Parses files of one slice each.
    ///
    /// # Errors
    /// Those of the format; [`Error::Unsupported`] if it has no slices.
    pub(crate) fn parse_slices(
        &self,
        path: &Path,
        blobs: Vec<Blob>,
        unread: Vec<Unread>,
        options: &OpenOptions,
    ) -> Result<VolumeDescriptor> {
        match self.slices {
            Some(slices) => (slices.parse)(path, blobs, unread, options),
            None => {
                let what = format!("slices in files of {}", self.title);
                Err(Error::unsupported(path, what, "give one of the files"))
            }
        }
    }

    /// True for a file that is one slice and no more.
    ///
    /// # Errors
    /// [`Error::Io`] and those of a damaged file.
    pub(crate) fn is_one_slice(&self, path: &Path) -> Result<bool> {
        self.slices
            .map_or(Ok(false), |slices| (slices.is_single)(path))
    }

    /// True if the name of a file ends as is usual.
    pub(crate) fn has_name(&self, path: &Path) -> bool {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        self.extensions
            .contains(&extension.to_ascii_lowercase().as_str())
    }
}

/// The title of the format of volumes in files that begin so.
pub(crate) fn title_of(formats: &'static [Format], head: &[u8]) -> Option<&'static str> {
    let whole = formats.iter().filter(|format| format.parse.is_some());
    let mut found = whole.filter(|format| (format.starts)(head));
    found.next().map(|format| format.title)
}

/// Words as people list them: `A, B or C`.
pub(crate) fn listed(words: &[&str], last: &str) -> String {
    match words {
        [] => String::new(),
        [one] => (*one).to_string(),
        [first @ .., end] => format!("{} {last} {end}", first.join(", ")),
    }
}
