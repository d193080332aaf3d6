//! The files that a checkpoint relies on, and how much of each.

use crate::checkpoint::{SPOOLS, SWEEPS};
use crate::error::{Error, Result};
use crate::sys::spill_file::{Mark, SpillFile};
use crate::sys::state_codec::{Decoder, Encoder};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Where the temporary files of one sweep over the volume lie.
#[derive(Debug, Clone)]
pub struct Scratch {
    dir: PathBuf,
    sweep: &'static str,
}

impl Scratch {
    /// The files of a sweep in the work directory of a conversion.
    pub fn of_sweep(work: &Path, sweep: usize) -> Self {
        Scratch::new(work.join(SPOOLS), SWEEPS[sweep])
    }

    /// The files of the sweep of this name, in `dir`.
    pub fn new(dir: PathBuf, sweep: &'static str) -> Self {
        Scratch { dir, sweep }
    }

    fn name(&self, what: &str) -> String {
        format!("{}.{what}", self.sweep)
    }

    /// One of them.
    pub fn path(&self, what: &str) -> PathBuf {
        self.dir.join(self.name(what))
    }
}

/// How much each file holds, by its name.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Marks(Vec<(String, u64, Option<u32>)>);

impl Marks {
    /// Adds a file that grows at its end only.
    pub fn add(&mut self, files: &Scratch, what: &str, mark: Mark) {
        self.0.push((files.name(what), mark.len, Some(mark.crc)));
    }

    /// Adds a file that has at least this length.
    pub fn add_length(&mut self, files: &Scratch, what: &str, len: u64) {
        self.0.push((files.name(what), len, None));
    }

    /// The marks of one sweep's files.
    pub fn of(&self, files: &Scratch) -> Marks {
        let own = self.0.iter().filter(|m| m.0.starts_with(&files.name("")));
        Marks(own.cloned().collect())
    }

    /// Adds the files of another sweep.
    pub fn extend(&mut self, other: &Marks) {
        self.0.extend(other.0.iter().cloned());
    }

    /// Opens the spool of this name as it was; `None` if there is no mark of it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn reopen(&self, files: &Scratch, what: &str) -> Result<Option<SpillFile>> {
        let mark = self.mark(files, what);
        mark.map(|mark| SpillFile::reopen(&files.path(what), mark))
            .transpose()
    }

    /// Opens the spool of this name to be read, as far as it is marked; `None` if there is no mark of it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn open(&self, files: &Scratch, what: &str) -> Result<Option<SpillFile>> {
        let mark = self.mark(files, what);
        mark.map(|mark| SpillFile::open(&files.path(what), mark))
            .transpose()
    }

    fn mark(&self, files: &Scratch, what: &str) -> Option<Mark> {
        let name = files.name(what);
        let &(_, len, crc) = self.0.iter().find(|m| m.0 == name)?;
        crc.map(|crc| Mark { len, crc })
    }

    /// Removes the files of a sweep that are not marked.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn remove_others(&self, files: &Scratch) -> Result<()> {
        let fail = |e| Error::io(&files.dir, "list", e);
        for entry in std::fs::read_dir(&files.dir).map_err(fail)? {
            let name = entry.map_err(fail)?.file_name();
            let name = name.to_string_lossy();
            let own = name.starts_with(&files.name(""));
            if own && !self.0.iter().any(|mark| mark.0 == name) {
                let path = files.dir.join(&*name);
                std::fs::remove_file(&path).map_err(|e| Error::io(&path, "remove", e))?;
            }
        }
        Ok(())
    }

    /// Names and lengths of the files.
    pub fn lengths(&self) -> impl Iterator<Item = (&str, u64)> {
        self.0.iter().map(|(name, len, _)| (name.as_str(), *len))
    }

    /// True if every file in `dir` still begins with what it held.
    pub fn hold(&self, dir: &Path) -> bool {
        self.first_changed(dir, |_| true).is_none()
    }

    /// The first of the files in `dir` that does not begin with what it held, of those whose names are `asked` for.
    pub fn first_changed(&self, dir: &Path, asked: impl Fn(&str) -> bool) -> Option<&str> {
        let sound = |(name, len, crc): &(String, u64, Option<u32>)| {
            let file = File::open(dir.join(name)).ok()?;
            let long_enough = file.metadata().ok()?.len() >= *len;
            let same = match crc {
                Some(crc) => checksum(file, *len)? == *crc,
                None => true,
            };
            Some(long_enough && same)
        };
        let mut all = self.0.iter().filter(|(name, ..)| asked(name));
        let changed = all.find(|mark| sound(mark) != Some(true));
        changed.map(|(name, ..)| name.as_str())
    }

    /// Writes the marks.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        out.number(self.0.len() as u64)?;
        for (name, len, crc) in &self.0 {
            out.array(name.as_bytes())?;
            out.number(*len)?;
            out.number(crc.map_or(u64::MAX, u64::from))?;
        }
        Ok(())
    }

    /// The marks that were written; `None` if these are none.
    pub fn load(input: &mut Decoder) -> Option<Self> {
        let count = input.number()?;
        let mut marks = Marks::default();
        for _ in 0..count {
            let name = String::from_utf8(input.array()?).ok()?;
            let len = input.number()?;
            let crc = match input.number()? {
                u64::MAX => None,
                crc => Some(crc.try_into().ok()?),
            };
            marks.0.push((name, len, crc));
        }
        Some(marks)
    }
}

/// CRC-32 of the first `len` bytes; `None` if there are fewer.
fn checksum(mut file: File, len: u64) -> Option<u32> {
    let mut hasher = crc32fast::Hasher::new();
    let mut buffer = vec![0; 1 << 18];
    let mut left = len;
    while left > 0 {
        let part = &mut buffer[..left.min(1 << 18) as usize];
        file.read_exact(part).ok()?;
        hasher.update(part);
        left -= part.len() as u64;
    }
    Some(hasher.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_hold_until_they_are_cut_or_changed() {
        let dir = tempfile::tempdir().unwrap();
        let files = Scratch::new(dir.path().to_path_buf(), "tiles");
        let mut spool = SpillFile::create(&files.path("slabs")).unwrap();
        spool.push(&[7u64; 9]).unwrap();
        let mut marks = Marks::default();
        marks.add(&files, "slabs", spool.mark().unwrap());
        std::fs::write(files.path("births"), [0; 16]).unwrap();
        marks.add_length(&files, "births", 16);
        let path = dir.path().join("c");
        let mut out = Encoder::create(&path).unwrap();
        marks.save(&mut out).unwrap();
        out.finish().unwrap();
        let mut input = Decoder::new(std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(Marks::load(&mut input), Some(marks.clone()));

        assert!(marks.hold(dir.path()));
        spool.push(&[1u64]).unwrap();
        spool.mark().unwrap();
        assert!(marks.hold(dir.path()), "longer files are fine");
        for (what, bad) in [
            ("births", vec![0; 15]),
            ("slabs", vec![7; 71]),
            ("slabs", vec![0; 72]),
        ] {
            let good = std::fs::read(files.path(what)).unwrap();
            std::fs::write(files.path(what), bad).unwrap();
            assert!(!marks.hold(dir.path()), "{what}");
            std::fs::remove_file(files.path(what)).unwrap();
            assert!(!marks.hold(dir.path()), "no {what}");
            std::fs::write(files.path(what), good).unwrap();
            assert!(marks.hold(dir.path()));
        }
    }
}
