//! What tells one input from another without reading it.

use super::Opened;
use super::text::Pattern;
use crate::error::{Error, Result};
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Folders in folders beyond this are not looked into.
const MAX_DEPTH: u32 = 8;

/// Sums over the files of an input.
#[derive(Default)]
struct Sums {
    files: u64,
    bytes: u64,
    /// Seconds and nanoseconds since 1970.
    last_change: (i64, i64),
    /// Sum of a hash of each file's name, size and time: the order of listing does not matter.
    hash: u64,
}

impl Sums {
    fn add(&mut self, path: &Path, meta: &Metadata) {
        let time = (meta.mtime(), meta.mtime_nsec());
        self.files += 1;
        self.bytes += meta.len();
        self.last_change = self.last_change.max(time);
        let name = path.file_name().unwrap_or_default();
        let text = format!("{name:?} {} {time:?}", meta.len());
        let crc = u64::from(crc32fast::hash(text.as_bytes()));
        self.hash = self
            .hash
            .wrapping_add(crc.wrapping_mul(0x9E37_79B9_7F4A_7C15));
    }
}

/// What tells an input from any other.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Stamp {
    /// Names and values, as a user knows them.
    pub values: Vec<(String, String)>,
    /// When it changed last, as far as the system tells.
    pub last_change: Option<SystemTime>,
}

/// Names and values that change if the input at `path`, which was opened as `opened`, is exchanged or
/// written to: its place, the size of its files, and the times of their last changes. What lies in the
/// directory `out` is no part of it.
///
/// # Errors
/// [`Error::Io`] if a file or folder cannot be looked at.
pub fn stamp(path: &Path, opened: &Opened, out: &Path) -> Result<Stamp> {
    let mut sums = Sums::default();
    let mut add = |file: &Path| -> Result<()> {
        let meta = std::fs::metadata(file).map_err(|e| Error::io(file, "stat", e))?;
        sums.add(file, &meta);
        Ok(())
    };
    opened.files.iter().try_for_each(|file| add(file))?;
    if path.is_file() {
        if !opened.files.iter().any(|file| file == path) {
            add(path)?;
        }
    } else if opened.files.is_empty() {
        walk(path, out, &mut add)?;
    }
    let place = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let place = place.canonicalize().unwrap_or(place);
    let (seconds, nanoseconds) = sums.last_change;
    let mut values = vec![
        ("input".to_string(), place.display().to_string()),
        ("size of the input".into(), format!("{} bytes", sums.bytes)),
        (
            "last change of the input".into(),
            format!("{seconds}.{nanoseconds:09} s after 1970"),
        ),
    ];
    if sums.files > 1 {
        let files = format!(
            "{} files, {:016x} by name, size and time",
            sums.files, sums.hash
        );
        values.push(("files of the input".into(), files));
    }
    let after_1970 = u64::try_from(seconds).ok();
    let last_change =
        after_1970.and_then(|s| UNIX_EPOCH.checked_add(Duration::new(s, nanoseconds as u32)));
    Ok(Stamp {
        values,
        last_change,
    })
}

/// Calls `add` for the files of a folder, or for those that a pattern takes.
fn walk(path: &Path, out: &Path, add: &mut impl FnMut(&Path) -> Result<()>) -> Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let pattern = if path.is_dir() {
        None
    } else {
        Pattern::parse(&name)
    };
    let first = match (&pattern, path.parent()) {
        (None, _) => path.to_path_buf(),
        (Some(_), Some(parent)) if parent != Path::new("") => parent.to_path_buf(),
        (Some(_), _) => PathBuf::from("."),
    };
    let out = out.canonicalize().ok();
    let mut folders = vec![(first, 0)];
    while let Some((folder, depth)) = folders.pop() {
        if out.is_some() && folder.canonicalize().ok() == out {
            continue;
        }
        let fail = |e| Error::io(&folder, "list", e);
        for entry in std::fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            let kind = entry.file_type().map_err(fail)?;
            if kind.is_dir() {
                if pattern.is_none() && depth < MAX_DEPTH {
                    folders.push((entry.path(), depth + 1));
                }
            } else if let Some(pattern) = &pattern {
                if pattern.matches(&entry.file_name().to_string_lossy()) {
                    add(&entry.path())?;
                }
            } else if entry.path().is_file() {
                add(&entry.path())?;
            }
        }
    }
    Ok(())
}
