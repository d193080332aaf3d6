//! What lies in a folder, and in the folders in it.

use crate::error::{Error, Result};
use crate::volume::format::{Format, Unread, title_of};
use crate::volume::formats::folder::{is_index, is_placed, name, natural};
use crate::volume::formats::foreign;
use crate::volume::io::blob::Blob;
use std::path::{Path, PathBuf};

/// More files than slices can be.
const MAX_FILES: usize = 1 << 20;

/// Folders in folders beyond this are not looked into.
const MAX_DEPTH: u32 = 8;

/// Slices that say where they lie in the folders of a folder, as scanners write DICOM to discs, and what may be damaged slices among it.
pub(crate) fn below(path: &Path, formats: &'static [Format]) -> Result<(Vec<Blob>, Vec<Unread>)> {
    let (mut folders, mut scans) = (vec![(path.to_path_buf(), 0)], Vec::new());
    let mut unread = Vec::new();
    while let Some((folder, depth)) = folders.pop() {
        let fail = |e| Error::io(&folder, "list", e);
        for entry in std::fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            let kind = entry.file_type().map_err(fail)?;
            // links to folders are not followed: they may go round
            if kind.is_dir() && depth < MAX_DEPTH {
                folders.push((entry.path(), depth + 1));
            } else if depth > 0 && !is_index(&entry.path()) && !hidden(&entry.path()) {
                if !entry.path().is_file() {
                    unread.push(Unread::no_file(entry.path()));
                } else {
                    let blob = Blob::file(&entry.path())?;
                    let head = blob.head(400)?;
                    if formats.iter().any(|format| is_placed(format, &head)) {
                        scans.push(blob);
                    } else if title_of(formats, &head).is_none()
                        && !formats.iter().any(|format| (format.starts)(&head))
                        && foreign::named(&entry.path(), &head).is_none()
                    {
                        unread.push(Unread::file(entry.path(), &head));
                    }
                }
            }
            if scans.len() + folders.len() > MAX_FILES {
                let found = format!("a folder of more than {MAX_FILES} files");
                return Err(Error::format(path, found, "slices of a volume"));
            }
        }
    }
    // the order in which a folder lists its files must not matter, not even for messages
    scans.sort_by(|a, b| a.path().cmp(b.path()));
    unread.sort_by(|a, b| a.path.cmp(&b.path));
    Ok((scans, unread))
}

fn hidden(path: &Path) -> bool {
    name(path).starts_with('.')
}

/// The files of a folder, without hidden ones, in natural order, and what else is in it.
pub(crate) fn list(path: &Path) -> Result<(Vec<PathBuf>, Vec<Unread>)> {
    let fail = |e| Error::io(path, "list", e);
    let (mut files, mut unread) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(path).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        if hidden(&entry.path()) {
            continue;
        }
        match entry.path().is_file() {
            true => files.push(entry.path()),
            false => unread.push(Unread::no_file(entry.path())),
        }
        if files.len() + unread.len() > MAX_FILES {
            let found = format!("a folder of more than {MAX_FILES} files");
            return Err(Error::format(path, found, "slices of a volume"));
        }
    }
    files.sort_by(|a, b| natural(&name(a), &name(b)));
    unread.sort_by(|a, b| natural(&name(&a.path), &name(&b.path)));
    Ok((files, unread))
}
