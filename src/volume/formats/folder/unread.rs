//! Files among slices that look like slices by their names and are none: a volume without them would be shorter
//! than what was scanned.

use crate::error::Result;
use crate::volume::format::Unread;
use crate::volume::formats::folder::name;
use crate::volume::formats::folder::sequence::{parts, texts};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Extensions that nothing but slices have.
const OF_SLICES: [&str; 7] = ["dcm", "dicom", "ima", "tif", "tiff", "png", "bmp"];

impl Unread {
    /// A file of which no format is known, by its first bytes.
    pub(crate) fn file(path: PathBuf, head: &[u8]) -> Unread {
        Unread {
            path,
            found: begins(head),
            is_folder: false,
        }
    }

    /// An entry of a folder that is no file: it is not opened, since a pipe would wait for ever.
    pub(crate) fn no_file(path: PathBuf) -> Unread {
        let kind = std::fs::metadata(&path).map(|m| m.is_dir());
        let found = match kind {
            Ok(true) => "a folder",
            Ok(false) => "a pipe or device",
            Err(_) => "a link that leads nowhere",
        };
        Unread {
            path,
            found: found.into(),
            is_folder: kind.unwrap_or(false),
        }
    }

    /// True if its name is like those of slices: it has their extension, or, without one, their text.
    pub(crate) fn is_named_like(&self, slices: &Names) -> bool {
        let own = extension(&self.path);
        if !own.is_empty() {
            return OF_SLICES.contains(&own.as_str()) || slices.extensions.contains(&own);
        }
        let mine = name(&self.path);
        let mine = parts(&mine);
        !self.is_folder && mine.len() > 1 && slices.texts.contains(&owned(&mine))
    }
}

/// How slices are named.
#[derive(Debug, Default)]
pub(crate) struct Names {
    extensions: HashSet<String>,
    /// Of those without an extension, what stands around their numbers.
    texts: HashSet<Vec<String>>,
}

impl Names {
    pub(crate) fn of<'a>(slices: impl Iterator<Item = &'a Path>) -> Names {
        let mut names = Names::default();
        for slice in slices {
            let extension = extension(slice);
            if extension.is_empty() {
                names.texts.insert(owned(&parts(&name(slice))));
            } else {
                names.extensions.insert(extension);
            }
        }
        names
    }
}

fn owned(parts: &[&str]) -> Vec<String> {
    texts(parts).into_iter().map(str::to_owned).collect()
}

/// What a file begins with, in words.
pub(crate) fn begins(head: &[u8]) -> String {
    match head.is_empty() {
        true => "an empty file".into(),
        false => format!(
            "a file that begins with \"{}\"",
            head[..head.len().min(16)].escape_ascii()
        ),
    }
}

/// Refuses the first of these that is named like a slice.
///
/// # Errors
/// [`Error::Format`] with its name.
pub(crate) fn none_among(unread: &[Unread], slices: &Names) -> Result<()> {
    match unread.iter().find(|u| u.is_named_like(slices)) {
        Some(unread) => Err(unread.error()),
        None => Ok(()),
    }
}

/// An extension in small letters; numbers, as those of UIDs, are none.
fn extension(path: &Path) -> String {
    let text = path.extension().unwrap_or_default().to_string_lossy();
    match text.bytes().all(|b| b.is_ascii_digit()) {
        true => String::new(),
        false => text.to_ascii_lowercase(),
    }
}
