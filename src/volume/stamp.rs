//! What tells one input from another without reading it.

use crate::error::{Error, Result};
use crate::store::{self, is_remote};
use crate::volume::Opened;
use crate::volume::formats::folder;
use crate::volume::io::text::Pattern;
use crate::volume::registry::FORMATS;
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Folders in folders beyond this are not looked into.
const MAX_DEPTH: u32 = 8;

/// Sums over the files of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Sums {
    files: u64,
    bytes: u64,
    /// Seconds and nanoseconds since 1970.
    last_change: (i64, i64),
    /// Sum of a hash of each file's name, size and time: the order of listing does not matter.
    hash: u64,
    /// The same with which file it is, for one may take the place of another.
    which: u64,
    /// The same of the time when anything about it changed last, its name or its rights.
    status: u64,
}

impl Sums {
    fn add(&mut self, path: &Path, meta: &Metadata) {
        let time = (meta.mtime(), meta.mtime_nsec());
        self.files += 1;
        self.bytes += meta.len();
        self.last_change = self.last_change.max(time);
        let name = path.file_name().unwrap_or_default();
        let text = format!("{name:?} {} {time:?}", meta.len());
        let sum = |sum: &mut u64, text: &str| *sum = sum.wrapping_add(spread(text));
        sum(&mut self.hash, &text);
        sum(
            &mut self.which,
            &format!("{text} {} {}", meta.dev(), meta.ino()),
        );
        let status = (meta.ctime(), meta.ctime_nsec());
        sum(&mut self.status, &format!("{text} {status:?}"));
    }

    /// The same of objects in a bucket, which have no time of their own that tells them apart.
    fn add_objects(&mut self, path: &Path) -> Result<()> {
        let objects = store::stamps(path).map_err(|e| Error::io(path, "stat", e))?;
        for object in objects {
            self.files += 1;
            self.bytes += object.bytes;
            let text = format!("{} {} {}", object.path, object.bytes, object.etag);
            self.hash = self.hash.wrapping_add(spread(&text));
        }
        Ok(())
    }

    fn add_file(&mut self, path: &Path) -> Result<()> {
        if is_remote(path) {
            return self.add_objects(path);
        }
        let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "stat", e))?;
        self.add(path, &meta);
        Ok(())
    }

    /// Of what is at `path`, or of the files that a folder or a pattern has, but for those in `out`.
    fn of(path: &Path, out: &Path) -> Result<Self> {
        let mut sums = Sums::default();
        match path.is_file() || is_remote(path) {
            true => sums.add_file(path)?,
            false => walk(path, out, &mut |file| sums.add_file(file))?,
        }
        Ok(sums)
    }

    fn of_files(files: &[PathBuf]) -> Result<Self> {
        let mut sums = Sums::default();
        files.iter().try_for_each(|file| sums.add_file(file))?;
        Ok(sums)
    }
}

/// A hash of a text, spread over all bits.
fn spread(text: &str) -> u64 {
    u64::from(crc32fast::hash(text.as_bytes())).wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// What an input was before it was opened, see [`stamp`].
#[derive(Debug, Clone)]
pub struct Before {
    path: PathBuf,
    out: PathBuf,
    /// `None` if it could not be looked at, which opening it will tell.
    sums: Option<Sums>,
}

impl Before {
    /// Looks at the input at `path`. What lies in the directory `out` is no part of it.
    pub fn of(path: &Path, out: &Path) -> Self {
        Before {
            path: path.to_path_buf(),
            out: out.to_path_buf(),
            sums: Sums::of(path, out).ok(),
        }
    }
}

/// What tells an input from any other.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Stamp {
    /// Names and values, as a user knows them.
    pub values: Vec<(String, String)>,
    /// When it changed last, as far as the system tells.
    pub last_change: Option<SystemTime>,
    /// What [`Stamp::check`] looks at again.
    watched: Option<Watched>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Watched {
    path: PathBuf,
    out: PathBuf,
    /// Of what is at the path, before it was opened; `None` of a folder whose files are known.
    whole: Option<Sums>,
    /// Files that it led to.
    files: Vec<PathBuf>,
    of_files: Sums,
}

/// Names and values that change if the input, which was opened as `opened`, is exchanged or written to: its
/// place, the size of its files, and the times of their last changes. `before` is from before it was opened: so
/// [`Stamp::check`] tells of any change since then.
///
/// # Errors
/// [`Error::Io`] if a file or folder cannot be looked at.
pub fn stamp(before: &Before, opened: &Opened) -> Result<Stamp> {
    let Before { path, out, sums } = before;
    let mut files = opened.files.clone();
    files.retain(|file| file != path);
    let known = is_remote(path) || path.is_file() || opened.files.is_empty();
    let whole = match sums {
        _ if !known => None,
        Some(sums) => Some(*sums),
        None => Some(Sums::of(path, out)?),
    };
    let of_files = Sums::of_files(&files)?;
    let all = [whole.unwrap_or_default(), of_files];
    let place = match is_remote(path) {
        true => path.to_path_buf(),
        false => {
            let place = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
            place.canonicalize().unwrap_or(place)
        }
    };
    let (seconds, nanoseconds) = all
        .map(|sums| sums.last_change)
        .into_iter()
        .max()
        .unwrap_or_default();
    let bytes: u64 = all.iter().map(|sums| sums.bytes).sum();
    let mut values = vec![
        ("input".to_string(), place.display().to_string()),
        ("size of the input".into(), format!("{bytes} bytes")),
    ];
    let count: u64 = all.iter().map(|sums| sums.files).sum();
    let hash = all.iter().fold(0u64, |sum, s| sum.wrapping_add(s.hash));
    if is_remote(path) {
        let text = format!("{count}, {hash:016x} by key, size and ETag");
        values.push(("objects of the input".into(), text));
        return Ok(stamped(values, None, before, whole, files, of_files));
    }
    values.push((
        "last change of the input".into(),
        format!("{seconds}.{nanoseconds:09} s after 1970"),
    ));
    if count > 1 {
        let text = format!("{count} files, {hash:016x} by name, size and time");
        values.push(("files of the input".into(), text));
    }
    let after_1970 = u64::try_from(seconds).ok();
    let last_change =
        after_1970.and_then(|s| UNIX_EPOCH.checked_add(Duration::new(s, nanoseconds as u32)));
    Ok(stamped(values, last_change, before, whole, files, of_files))
}

fn stamped(
    values: Vec<(String, String)>,
    last_change: Option<SystemTime>,
    before: &Before,
    whole: Option<Sums>,
    files: Vec<PathBuf>,
    of_files: Sums,
) -> Stamp {
    let watched = Watched {
        path: before.path.clone(),
        out: before.out.clone(),
        whole,
        files,
        of_files,
    };
    Stamp {
        values,
        last_change,
        watched: Some(watched),
    }
}

impl Stamp {
    /// Of a volume in memory, which may have been changed at any time: its own names and values.
    pub(crate) fn in_memory(values: Vec<(String, String)>) -> Self {
        Stamp {
            values,
            last_change: Some(SystemTime::now()),
            watched: None,
        }
    }

    /// Looks at the input again, after it has been read. Returns a warning if no more than its rights or its name
    /// have changed, or if it was written to and its times were set back.
    ///
    /// # Errors
    /// [`Error::InputChanged`] if it was written to, exchanged, or its time was set.
    pub fn check(&self) -> Result<Option<String>> {
        let Some(watched) = &self.watched else {
            return Ok(None);
        };
        let Watched { path, out, .. } = watched;
        let changed = |found: String| {
            Err(Error::InputChanged {
                path: path.clone(),
                found,
            })
        };
        let whole = watched.whole.map(|_| Sums::of(path, out)).transpose();
        let (whole, of_files) = match (whole, Sums::of_files(&watched.files)) {
            (Ok(whole), Ok(of_files)) => (whole, of_files),
            (Err(e), _) | (_, Err(e)) => return changed(e.to_string()),
        };
        let mut touched = false;
        let of_whole = watched.whole.unwrap_or_default();
        let pairs = [
            (of_whole, whole.unwrap_or_default()),
            (watched.of_files, of_files),
        ];
        for (was, is) in pairs {
            if let Some(found) = difference(&was, &is) {
                return changed(found);
            }
            touched |= was.status != is.status;
        }
        Ok(touched.then(|| {
            format!(
                "{}: something about the input was changed while it was read (its name, its rights, or its times): \
                 if that was its content, do this again",
                path.display()
            )
        }))
    }
}

/// What was changed, for people; `None` if the content can hardly have been.
fn difference(was: &Sums, is: &Sums) -> Option<String> {
    if was.files != is.files {
        return Some(format!("{} files of {}", is.files, was.files));
    }
    if was.bytes != is.bytes {
        return Some(format!("{} bytes, {} before", is.bytes, was.bytes));
    }
    if was.hash != is.hash {
        let found = match was.last_change == is.last_change {
            true => "another file, size or time",
            false => "another time of its last change",
        };
        return Some(found.into());
    }
    (was.which != is.which).then(|| "another file in its place".into())
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
    // every file of a Zarr counts; others may be beside slices, such as notes, and are not read
    let all = pattern.is_some() || FORMATS.iter().any(|format| format.is_folder(path));
    let counts = |file: &Path| all || folder::is_slice(file, FORMATS);
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
            } else if entry.path().is_file() && counts(&entry.path()) {
                add(&entry.path())?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{Dtype, OpenOptions, open};
    use std::fs;
    use std::fs::File;
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;

    fn raw() -> OpenOptions {
        OpenOptions {
            dims: Some([4, 4, 4]),
            dtype: Some(Dtype::U8),
            ..OpenOptions::default()
        }
    }

    /// The stamp of an input that `meanwhile` changes between the first look at it and its opening.
    fn stamped(path: &Path, options: &OpenOptions, meanwhile: impl FnOnce()) -> Stamp {
        let before = Before::of(path, Path::new("out"));
        meanwhile();
        stamp(&before, &open(path, options).unwrap()).unwrap()
    }

    /// Sets the time of the last change, as copying programs do.
    fn set_time(path: &Path, time: SystemTime) {
        let file = File::options().write(true).open(path).unwrap();
        file.set_modified(time).unwrap();
    }

    fn error(stamp: &Stamp) -> String {
        match stamp.check() {
            Err(e @ Error::InputChanged { .. }) => e.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_file_that_is_written_to_or_exchanged_has_changed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.raw");
        let other = dir.path().join("b.raw");
        let ways: [(&str, &dyn Fn()); 7] = [
            ("65 bytes, 64 before", &|| {
                let mut file = File::options().append(true).open(&path).unwrap();
                file.write_all(b"x").unwrap();
            }),
            ("another time", &|| {
                let mut file = File::options().write(true).open(&path).unwrap();
                file.write_all(b"other").unwrap();
            }),
            ("another time", &|| {
                set_time(&path, UNIX_EPOCH + Duration::from_secs(9))
            }),
            // with the time of the one before, as `cp -p` leaves it
            ("another file", &|| {
                let time = fs::metadata(&path).unwrap().modified().unwrap();
                fs::write(&other, [1; 64]).unwrap();
                set_time(&other, time);
                fs::rename(&other, &path).unwrap();
            }),
            ("3 bytes, 64 before", &|| fs::write(&path, "abc").unwrap()),
            ("No such file", &|| fs::remove_file(&path).unwrap()),
            ("0 files of 1", &|| {
                fs::remove_file(&path).unwrap();
                fs::create_dir(&path).unwrap();
            }),
        ];
        for (expected, change) in ways {
            fs::write(&path, [0; 64]).unwrap();
            set_time(&path, UNIX_EPOCH + Duration::from_secs(1_000_000_000));
            let stamp = stamped(&path, &raw(), || {});
            assert_eq!(stamp.check().unwrap(), None);
            change();
            let message = error(&stamp);
            assert!(message.contains(expected), "{expected}: {message}");
        }
    }

    #[test]
    fn what_changed_while_it_was_opened_has_changed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.raw");
        fs::write(&path, [0; 64]).unwrap();
        let stamp = stamped(&path, &raw(), || {
            set_time(&path, UNIX_EPOCH + Duration::from_secs(5));
        });
        error(&stamp);
    }

    #[test]
    fn a_file_whose_rights_or_times_alone_differ_is_warned_of() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.raw");
        fs::write(&path, [0; 64]).unwrap();
        let time = UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        set_time(&path, time);
        let stamp = stamped(&path, &raw(), || {});
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        let warning = stamp.check().unwrap().unwrap();
        assert!(warning.contains("a.raw"), "{warning}");
        // other bytes, and the time set back
        let stamp = stamped(&path, &raw(), || {});
        fs::write(&path, [1; 64]).unwrap();
        set_time(&path, time);
        assert!(stamp.check().unwrap().is_some());
    }

    #[test]
    fn headers_and_the_files_that_they_name_both_count() {
        let dir = tempfile::tempdir().unwrap();
        let [header, data] = ["a.mhd", "a.raw"].map(|name| dir.path().join(name));
        for changed in [&header, &data] {
            let text =
                "NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = a.raw\n";
            fs::write(&header, text).unwrap();
            fs::write(&data, [0; 64]).unwrap();
            let stamp = stamped(&header, &OpenOptions::default(), || {});
            assert_eq!(stamp.check().unwrap(), None);
            assert_eq!(stamp.values.len(), 4, "{:?}", stamp.values);
            set_time(changed, UNIX_EPOCH);
            error(&stamp);
        }
    }

    #[test]
    fn of_a_folder_slices_count_and_notes_do_not() {
        let dir = tempfile::tempdir().unwrap();
        let slice = |k: u8| dir.path().join(format!("s{k}.png"));
        let write = |k: u8| {
            let picture = image::GrayImage::from_pixel(4, 4, image::Luma([k]));
            picture.save(slice(k)).unwrap();
        };
        (0..4).for_each(write);
        let folder = || stamped(dir.path(), &OpenOptions::default(), || {});
        let stamp = folder();
        fs::write(dir.path().join("notes.txt"), "while it runs").unwrap();
        assert_eq!(stamp.check().unwrap(), None);
        write(4);
        assert!(error(&stamp).contains("5 files of 4"));
        let stamp = folder();
        set_time(&slice(2), UNIX_EPOCH);
        error(&stamp);
    }

    #[test]
    fn what_has_no_file_never_changes() {
        assert_eq!(Stamp::default().check().unwrap(), None);
    }
}
