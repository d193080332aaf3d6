//! JSON files that tell when they are damaged, and that appear whole or not at all.

use crate::error::{Error, Result};
use crate::manifest::checksum_text;
use crate::sys::files::remove_if_there;
use rustix::fs::{CWD, RenameFlags, renameat_with};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::io::ErrorKind;
use std::path::Path;

/// What a file holds, and the checksum of that as it stands there.
#[derive(Serialize, Deserialize)]
struct Sealed {
    checksum: String,
    body: Box<RawValue>,
}

/// A value with its checksum, as the file has it.
pub struct Read<T> {
    /// What the file says.
    pub value: T,
    /// The checksum of that.
    pub checksum: String,
}

/// Reads a file; `None` if there is none.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if it is damaged.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<Read<T>>> {
    let bytes = match std::fs::read(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        bytes => bytes.map_err(|e| Error::io(path, "read", e))?,
    };
    let read = serde_json::from_slice::<Sealed>(&bytes)
        .ok()
        .filter(|sealed| checksum_of(sealed.body.get()) == sealed.checksum)
        .and_then(|sealed| {
            let value = serde_json::from_str(sealed.body.get()).ok()?;
            let checksum = sealed.checksum;
            Some(Read { value, checksum })
        });
    read.map(Some).ok_or_else(|| {
        Error::format(
            path,
            "other bytes than were written",
            "JSON with its checksum",
        )
        .with_hint("remove the file; what it stood for is done again")
    })
}

/// Gives a new file its name, unless there is a file of that name; true if it did. Whoever looks at `path` finds nothing or
/// the whole file.
///
/// # Errors
/// [`Error::Io`].
pub fn write_once<T: Serialize>(new: &Path, path: &Path, value: &T) -> Result<bool> {
    let body = serde_json::value::to_raw_value(value).expect("plain data serialises");
    let checksum = checksum_of(body.get());
    let sealed = Sealed { checksum, body };
    let text = serde_json::to_vec(&sealed).expect("plain data serialises");
    // a link of an earlier call may have this name, too: what it leads to is not to be written into
    remove_if_there(new)?;
    std::fs::write(new, text).map_err(|e| Error::io(new, "write", e))?;
    let published = match std::fs::hard_link(new, path) {
        // not every file system has links
        Err(e) if e.kind() == ErrorKind::Unsupported || e.kind() == ErrorKind::PermissionDenied => {
            renameat_with(CWD, new, CWD, path, RenameFlags::NOREPLACE).map_err(Into::into)
        }
        linked => linked,
    };
    match published {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(e) => Err(Error::io(path, "create", e)),
    }
}

fn checksum_of(text: &str) -> String {
    checksum_text(crc32fast::hash(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_one_stays_and_whatever_is_changed_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let [new, path] = ["new", "value"].map(|name| dir.path().join(name));
        let value = |path: &Path| read::<Vec<f64>>(path).map(|read| read.map(|r| r.value));
        assert_eq!(value(&path).unwrap(), None);
        assert!(write_once(&new, &path, &vec![1.5, 0.1]).unwrap());
        assert!(!write_once(&new, &path, &vec![2.5]).unwrap());
        assert_eq!(value(&path).unwrap(), Some(vec![1.5, 0.1]));
        let whole = std::fs::read(&path).unwrap();
        let damaged = dir.path().join("damaged");
        for bit in 0..8 * whole.len() {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(&damaged, &bytes).unwrap();
            // capitals in the names of the two members are no longer those
            assert!(value(&damaged).is_err(), "bit {bit}");
        }
        for len in 0..whole.len() {
            std::fs::write(&damaged, &whole[..len]).unwrap();
            assert!(value(&damaged).is_err(), "{len}");
        }
    }
}
