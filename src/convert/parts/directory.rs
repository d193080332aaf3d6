//! Where the work on the parts of a volume lies: a plan, and for each round the attempts at its parts.
//!
//! An attempt writes into a directory that is its own. When all of it is there it says so in a marker, of which there can
//! be one for each part of a round: whoever comes second finds that the part is done. Attempts stay until all is merged, so
//! nobody ever writes where another may be reading. Nothing rests on locks or clocks.

use crate::checkpoint::{Identity, Marks, SPOOLS};
use crate::convert::layers::Layers;
use crate::convert::parts::rounds::Rounds;
use crate::convert::parts::sealed;
use crate::error::{Error, Result};
use crate::labels::LabelSums;
use crate::manifest::{PARTIAL, Region};
use crate::sys::files::make_directory;
use crate::sys::spill_file::{Mark, SpillFile};
use crate::tileset::{PARTS, PLAN};
use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Counts the versions of all these files.
pub const FORMAT: u32 = 5;

/// What all parts are to know.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plan {
    /// [`FORMAT`].
    pub format: u32,
    /// Everything that the tile set depends on, the program's version and the input among it.
    pub identity: Vec<(String, String)>,
    /// The layers of each part: the first one, and the one behind the last.
    pub parts: Vec<[u32; 2]>,
    /// The rounds.
    #[serde(flatten)]
    pub rounds: Rounds,
    /// The caller's: how the same volume and options are had again.
    pub asked: Asked,
}

/// How the volume and the options of a plan are had again.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// The words of the command line behind the command.
    pub words: Vec<String>,
    /// The directory in which it was typed.
    pub directory: String,
    /// The threshold that was found.
    pub threshold: f64,
    /// The region of interest that was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// What all labels tell, if they were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelSums>,
}

/// Who does a piece of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doer {
    /// A part, by its number.
    Part(u32),
    /// Whoever joins what the parts have found.
    Merge,
}

impl Doer {
    fn name(self) -> String {
        match self {
            Doer::Part(part) => format!("part-{part:04}"),
            Doer::Merge => "merge".to_owned(),
        }
    }
}

/// How long a file is, and its CRC-32.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileSum {
    /// Its path in the directory of the attempt.
    pub path: String,
    /// Its length.
    pub bytes: u64,
    /// The checksum of it.
    pub crc: u32,
}

impl FileSum {
    /// Of a file in a directory.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn of(dir: &Path, path: &str) -> Result<Self> {
        let file = dir.join(path);
        let mut hasher = crc32fast::Hasher::new();
        let bytes = each_block(&file, |block| {
            hasher.update(block);
            Ok(())
        })?;
        Ok(FileSum {
            path: path.to_owned(),
            bytes,
            crc: hasher.finalize(),
        })
    }
}

/// Reads a file block by block; returns its length.
///
/// # Errors
/// [`Error::Io`], and what `each` returns.
pub fn each_block(path: &Path, mut each: impl FnMut(&[u8]) -> Result<()>) -> Result<u64> {
    let failed = |e| Error::io(path, "read", e);
    let mut file = File::open(path).map_err(failed)?;
    let (mut block, mut bytes) = (vec![0; 1 << 18], 0);
    loop {
        match file.read(&mut block).map_err(failed)? {
            0 => return Ok(bytes),
            count => {
                each(&block[..count])?;
                bytes += count as u64;
            }
        }
    }
}

/// A marker: says that an attempt is whole, and what came of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Marker<T> {
    /// The checksum of the plan.
    plan: String,
    /// The version of the program.
    version: String,
    round: u32,
    doer: String,
    /// The name of the attempt's directory.
    attempt: String,
    marks: Marks,
    files: Vec<FileSum>,
    result: T,
}

/// A piece of work that is done.
#[derive(Debug)]
pub struct Done<T> {
    /// The directory with its files.
    pub dir: PathBuf,
    /// How much the files of its sweep hold.
    pub marks: Marks,
    /// Its other files.
    pub files: Vec<FileSum>,
    /// What came of it.
    pub result: T,
    marker: PathBuf,
}

/// What an attempt leaves.
pub struct Made<T> {
    /// How much the files of its sweep hold.
    pub marks: Marks,
    /// Its other files.
    pub files: Vec<FileSum>,
    /// What came of it.
    pub result: T,
}

impl<T> Made<T> {
    /// The same with more files.
    pub fn with(mut self, files: Vec<FileSum>) -> Self {
        self.files.extend(files);
        self
    }
}

/// An attempt that is under way.
#[derive(Debug)]
pub struct Attempt {
    /// Its directory.
    pub dir: PathBuf,
    name: String,
    round: u32,
    doer: Doer,
}

/// The work on the parts of a volume.
#[derive(Debug)]
pub struct Directory {
    /// The directory of the tile set.
    pub out: PathBuf,
    /// The one in it where all is made.
    pub work: PathBuf,
    /// The plan.
    pub plan: Plan,
    /// Its checksum.
    id: String,
}

impl Directory {
    /// That in the directory `out` of a tile set; `None` if there is no plan.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the plan is damaged; [`Error::OtherPlan`] if it was made by another version.
    pub fn open(out: &Path) -> Result<Option<Self>> {
        let work = out.join(PARTIAL);
        let Some(read) = sealed::read::<Plan>(&work.join(PLAN))? else {
            return Ok(None);
        };
        let directory = Directory {
            out: out.to_path_buf(),
            work,
            plan: read.value,
            id: read.checksum,
        };
        directory.check_version()?;
        Ok(Some(directory))
    }

    /// Writes a plan where there is none.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(work: &Path, plan: &Plan) -> Result<bool> {
        let parts = work.join(PARTS);
        let rounds = (1..=plan.rounds.count()).map(|round| parts.join(round.to_string()));
        for dir in std::iter::once(parts.clone()).chain(rounds) {
            make_directory(&dir)?;
        }
        let new = work.join(format!("{PLAN}.{}", unique()?));
        let written = sealed::write_once(&new, &work.join(PLAN), plan);
        let _ = std::fs::remove_file(&new);
        written
    }

    fn check_version(&self) -> Result<()> {
        let (was, is) = (self.plan.format, FORMAT);
        let version = self
            .plan
            .identity
            .iter()
            .find(|(name, _)| name == "version");
        let version = version.map_or("nothing", |(_, value)| value);
        let differences = if version != env!("CARGO_PKG_VERSION") {
            format!("version was {version} and is {}", env!("CARGO_PKG_VERSION"))
        } else if was != is {
            format!("format of the work was {was} and is {is}")
        } else {
            return Ok(());
        };
        Err(self.other(differences))
    }

    fn other(&self, differences: String) -> Error {
        Error::OtherPlan {
            path: self.out.clone(),
            differences,
        }
    }

    /// Refuses another input or other options than those of the plan.
    ///
    /// # Errors
    /// [`Error::OtherPlan`].
    pub fn check(&self, identity: &Identity) -> Result<()> {
        let differences = identity.differences(&Identity::new(self.plan.identity.clone()));
        match differences.is_empty() {
            true => Ok(()),
            false => Err(self.other(differences.join("; "))),
        }
    }

    /// How many parts there are.
    pub fn parts(&self) -> u32 {
        self.plan.parts.len() as u32
    }

    /// The layers of a part.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is no such part.
    pub fn layers(&self, part: u32) -> Result<Layers> {
        match self.plan.parts.get(part as usize) {
            Some(&[first, end]) => Ok(Layers { first, end }),
            None => {
                let last = self.parts() - 1;
                let expected = format!(
                    "0 to {last}, the parts of the plan in {}",
                    self.out.display()
                );
                Err(Error::usage("--part", part.to_string(), expected))
            }
        }
    }

    fn round_dir(&self, round: u32) -> PathBuf {
        self.work.join(PARTS).join(round.to_string())
    }

    fn marker(&self, round: u32, doer: Doer) -> PathBuf {
        self.round_dir(round).join(format!("{}.done", doer.name()))
    }

    /// What is done of a piece of work; `None` if it is not done. The lengths of its files are looked at.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if anything is damaged; [`Error::OtherPlan`] if it was done for another plan or by
    /// another version.
    pub fn done<T: DeserializeOwned>(&self, round: u32, doer: Doer) -> Result<Option<Done<T>>> {
        let path = self.marker(round, doer);
        let Some(read) = sealed::read::<Marker<T>>(&path)? else {
            return Ok(None);
        };
        let marker = read.value;
        let is = [
            ("plan", &marker.plan, self.id.as_str()),
            ("version", &marker.version, env!("CARGO_PKG_VERSION")),
        ];
        if let Some((what, was, is)) = is.into_iter().find(|(_, was, is)| was.as_str() != *is) {
            return Err(self.other(format!(
                "{what} of {} was {was} and is {is}",
                path.display()
            )));
        }
        if (marker.round, &marker.doer) != (round, &doer.name()) {
            let found = format!("the marker of {} of round {}", marker.doer, marker.round);
            let expected = format!("that of {} of round {round}", doer.name());
            return Err(Error::format(&path, found, expected));
        }
        let done = Done {
            dir: self.round_dir(round).join(&marker.attempt),
            marks: marker.marks,
            files: marker.files,
            result: marker.result,
            marker: path,
        };
        done.check_lengths()?;
        Ok(Some(done))
    }

    /// What a part has done of a round that it was said to have done.
    ///
    /// # Errors
    /// As of [`Directory::done`]; [`Error::Format`] if it is not done.
    pub fn done_by<T: DeserializeOwned>(&self, round: u32, part: u32) -> Result<Done<T>> {
        let done = self.done(round, Doer::Part(part))?;
        done.ok_or_else(|| self.gone(part))
    }

    /// What was merged of a round after which a part is at work.
    ///
    /// # Errors
    /// As of [`Directory::done_by`].
    pub fn merged<T: DeserializeOwned>(&self, round: u32, part: u32) -> Result<Done<T>> {
        let done = self.done(round, Doer::Merge)?;
        done.ok_or_else(|| self.gone(part))
    }

    /// The error for a part that was done, and is no more.
    pub fn gone(&self, part: u32) -> Error {
        let found = format!("nothing of part {part}");
        Error::format(&self.work, found, "what it has left")
            .with_hint("run `alvis merge`, and what it asks for, again")
    }

    /// True if a piece of work is done, as far as its marker and the lengths of its files tell.
    ///
    /// # Errors
    /// As of [`Directory::done`].
    pub fn is_done(&self, round: u32, doer: Doer) -> Result<bool> {
        let done = self.done::<IgnoredAny>(round, doer)?;
        Ok(done.is_some())
    }

    /// Begins an attempt.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn attempt(&self, round: u32, doer: Doer) -> Result<Attempt> {
        let name = format!("{}.{}", doer.name(), unique()?);
        let dir = self.round_dir(round).join(&name);
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
        Ok(Attempt {
            dir,
            name,
            round,
            doer,
        })
    }

    /// Removes the attempts of a round that do not count, once all of it has been merged: those of others that were as
    /// fast, or were killed. Who still works there finds nothing, and that its part is done.
    pub fn remove_others(&self, round: u32) {
        let dir = self.round_dir(round);
        let doers = (0..self.parts()).map(Doer::Part).chain([Doer::Merge]);
        let counts: Option<HashSet<String>> = doers
            .map(|doer| {
                let read = sealed::read::<Marker<IgnoredAny>>(&self.marker(round, doer));
                Some(read.ok()??.value.attempt)
            })
            .collect();
        let (Some(counts), Ok(entries)) = (counts, std::fs::read_dir(&dir)) else {
            return;
        };
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if entry.path().is_dir() && !counts.contains(&name) {
                // it does no harm where it cannot be removed: the last merge removes all of it
                let _ = std::fs::remove_dir_all(entry.path());
            }
        }
    }

    /// Says that an attempt is whole; false if another one was first.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish<T: Serialize>(&self, attempt: Attempt, made: Made<T>) -> Result<bool> {
        let Attempt {
            dir,
            name,
            round,
            doer,
        } = attempt;
        let marker = Marker {
            plan: self.id.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            round,
            doer: doer.name(),
            attempt: name.clone(),
            marks: made.marks,
            files: made.files,
            result: made.result,
        };
        let path = self.marker(round, doer);
        if sealed::write_once(&dir.join("done"), &path, &marker)? {
            return Ok(true);
        }
        // a network may lose the answer to a call that succeeded, and ask again
        let found = sealed::read::<Marker<IgnoredAny>>(&path)?;
        Ok(found.is_some_and(|read| read.value.attempt == name))
    }
}

impl<T> Done<T> {
    fn damaged(&self, path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
        let marker = self.marker.display();
        Error::format(path, found, expected).with_hint(format!(
            "something has changed the file: remove {marker} and run `alvis merge` and what it asks for again"
        ))
    }

    fn check_lengths(&self) -> Result<()> {
        let marked = self.marks.lengths().map(|(name, bytes)| {
            let path = self.dir.join(SPOOLS).join(name);
            (path, bytes)
        });
        let files = self.files.iter();
        let files = files.map(|file| (self.dir.join(&file.path), file.bytes));
        for (path, bytes) in marked.chain(files) {
            let found = match path.metadata() {
                Ok(found) => found.len(),
                Err(e) if e.kind() == ErrorKind::NotFound => {
                    return Err(self.damaged(&path, "no file", format!("{bytes} bytes")));
                }
                Err(e) => return Err(Error::io(&path, "stat", e)),
            };
            if found != bytes {
                let expected = format!("{bytes} bytes");
                return Err(self.damaged(&path, format!("{found} bytes"), expected));
            }
        }
        Ok(())
    }

    /// Reads all files of its sweep, to see whether they are as they were written.
    ///
    /// # Errors
    /// [`Error::Format`] if one is not.
    pub fn check_marks(&self) -> Result<()> {
        self.check_marks_of(|_| true)
    }

    /// Reads those of the files of its sweep whose names are `asked` for.
    ///
    /// # Errors
    /// As of [`Done::check_marks`].
    pub fn check_marks_of(&self, asked: impl Fn(&str) -> bool) -> Result<()> {
        match self.marks.first_changed(&self.dir.join(SPOOLS), asked) {
            None => Ok(()),
            Some(name) => {
                let path = self.dir.join(SPOOLS).join(name);
                Err(self.damaged(&path, "other bytes", "those that were written"))
            }
        }
    }

    /// One of its other files, once its bytes are known to be those that were written.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if it is damaged.
    pub fn file(&self, name: &str) -> Result<(PathBuf, &FileSum)> {
        let sum = self.sum(name)?;
        let path = self.dir.join(name);
        let found = FileSum::of(&self.dir, name)?;
        self.check_file(&path, &found, sum)?;
        Ok((path, sum))
    }

    /// One of its other files that was written as a spool, in the same way.
    ///
    /// # Errors
    /// As of [`Done::file`].
    pub fn spool(&self, name: &str) -> Result<SpillFile> {
        let (path, sum) = self.file(name)?;
        let mark = Mark {
            len: sum.bytes,
            crc: sum.crc,
        };
        SpillFile::open(&path, mark)
    }

    /// What is known of one of its other files.
    ///
    /// # Errors
    /// [`Error::Format`] if it is not among them.
    pub fn sum(&self, name: &str) -> Result<&FileSum> {
        let known = self.files.iter().find(|file| file.path == name);
        known.ok_or_else(|| self.damaged(&self.marker, format!("no {name}"), "it in the list"))
    }

    /// Refuses a file that is not as it was written.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn check_file(&self, path: &Path, found: &FileSum, expected: &FileSum) -> Result<()> {
        if found == expected {
            return Ok(());
        }
        let text = |sum: &FileSum| format!("{} bytes with CRC-32 {:08x}", sum.bytes, sum.crc);
        Err(self.damaged(path, text(found), text(expected)))
    }
}

/// A name that nobody else has, on any machine.
fn unique() -> Result<String> {
    let mut bytes = [0; 8];
    getrandom::fill(&mut bytes).map_err(|e| {
        let source = std::io::Error::other(e.to_string());
        Error::io("/dev/urandom", "read", source)
    })?;
    Ok(format!(
        "{}-{:016x}",
        std::process::id(),
        u64::from_le_bytes(bytes)
    ))
}
