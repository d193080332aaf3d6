//! What lies in a folder, and in the folders in it.

use crate::error::{Error, Result};
use crate::volume::format::{Format, Unread};
use crate::volume::formats::folder::{is_index, is_placed, name, natural};
use crate::volume::formats::foreign;
use crate::volume::io::blob::Blob;
use std::path::{Path, PathBuf};

/// More files than slices can be.
const MAX_FILES: usize = 1 << 20;

/// Folders in folders beyond this are not looked into.
const MAX_DEPTH: u32 = 8;

/// Slices that say where they lie in the folders of a folder, as scanners write DICOM to discs, and what may be damaged
/// ones among them.
pub(crate) fn below(path: &Path, formats: &[Format]) -> Result<(Vec<Blob>, Vec<Unread>)> {
    let (mut folders, mut scans) = (vec![(path.to_path_buf(), 0)], Vec::new());
    let mut unread = Vec::new();
    while let Some((folder, depth)) = folders.pop() {
        let fail = |e| Error::io(&folder, "list", e);
        for entry in std::fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            let own = entry.path();
            // links to folders are not followed: they may go round
            if entry.file_type().map_err(fail)?.is_dir() && depth < MAX_DEPTH {
                folders.push((own, depth + 1));
            } else if depth == 0 || is_index(&own) || hidden(&own) {
                continue;
            } else if !own.is_file() {
                unread.push(Unread::no_file(own));
            } else {
                let blob = Blob::file(&own)?;
                let head = blob.head(400)?;
                let known = |format: &Format| (format.starts)(&head);
                if formats.iter().any(|format| is_placed(format, &head)) {
                    scans.push(blob);
                } else if !formats.iter().any(known) && foreign::named(&own, &head).is_none() {
                    unread.push(Unread::file(own, &head));
                }
            }
            not_too_many(path, scans.len() + folders.len())?;
        }
    }
    // the order in which a folder lists its files must not matter, not even for messages
    scans.sort_by(|a, b| a.path().cmp(b.path()));
    unread.sort_by(|a, b| a.path.cmp(&b.path));
    Ok((scans, unread))
}

/// Refuses a folder of more files than a volume can have slices.
fn not_too_many(path: &Path, count: usize) -> Result<()> {
    if count > MAX_FILES {
        let found = format!("a folder of more than {MAX_FILES} files");
        return Err(Error::format(path, found, "slices of a volume"));
    }
    Ok(())
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
        let own = entry.path();
        if hidden(&own) {
            continue;
        }
        match own.is_file() {
            true => files.push(own),
            false => unread.push(Unread::no_file(own)),
        }
        not_too_many(path, files.len() + unread.len())?;
    }
    files.sort_by(|a, b| natural(&name(a), &name(b)));
    unread.sort_by(|a, b| natural(&name(&a.path), &name(&b.path)));
    Ok((files, unread))
}
