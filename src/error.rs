//! The library's error: every message says where, what was found, what was expected and what to do.

use std::path::{Path, PathBuf};

/// Shorthand for results of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Memory that is used for one purpose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MemoryUse {
    /// What uses it: `bands of voxels`.
    pub by: &'static str,
    /// Bytes.
    pub bytes: u64,
}

/// What can go wrong while reading a volume, converting it or reading tiles back.
///
/// The findings of the verifier are not errors: they are [`crate::verify::Issue`]s.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("{}: cannot {action}: {source}{}", path.display(), advice(way_out(source)))]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was tried, as a verb phrase: `read`, `create the directory`.
        action: &'static str,
        /// The system's own reason.
        source: std::io::Error,
    },
    /// A file is not what it says it is, or is damaged.
    #[error("{}: found {found}, expected {expected}{}", path.display(), advice(.hint))]
    Format {
        /// The file.
        path: PathBuf,
        /// What the file holds, with its place if that helps.
        found: String,
        /// What it should hold.
        expected: String,
        /// What the user can do, or empty.
        hint: String,
    },
    /// The file is sound, but of a kind that this program does not read.
    #[error("{}: {what} is not supported{}", path.display(), advice(.hint))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature that is missing.
        what: String,
        /// A way out, or empty.
        hint: String,
    },
    /// An option or argument has a value that cannot be.
    #[error("{option}: found {found}, expected {expected}{}", advice(.hint))]
    Usage {
        /// The option or field as the user of the command spells it, `--dims`; options of the library have the
        /// field of that name.
        option: String,
        /// The value.
        found: String,
        /// The legal values.
        expected: String,
        /// What the user can do, or empty.
        hint: String,
    },
    /// The memory limit is too small for this volume or tile set.
    #[error(
        "--memory: {} is too little: the smallest limit that works is {}{}",
        mib(*limit, f64::floor), mib(*needed, f64::ceil), advice(.hint)
    )]
    Memory {
        /// The limit that was asked for, in bytes.
        limit: u64,
        /// The smallest limit that works, in bytes.
        needed: u64,
        /// What else would help, or empty.
        hint: String,
    },
    /// The volume turned out to have so much surface, or so many components, that the memory limit
    /// cannot be kept.
    #[error(
        "--memory: the volume is denser than planned: {} is too little, at least {} is \
         needed{}: raise the limit beyond that, since what follows may be denser still, or use \
         smaller --macrocubes or a smoother volume",
        mib(*limit, f64::floor), mib(*needed, f64::ceil), listed(.uses)
    )]
    TooDense {
        /// The limit that was asked for, in bytes.
        limit: u64,
        /// A lower bound of what is needed, in bytes.
        needed: u64,
        /// What it is needed for.
        uses: Vec<MemoryUse>,
    },
    /// The output directory holds something already.
    #[error("{}: the directory is not empty: give --force to replace the tile set in it, or another directory", path.display())]
    OutputExists {
        /// The directory.
        path: PathBuf,
    },
    /// The output file is there already.
    #[error("{}: the file exists already: give --force to replace it, or another name", path.display())]
    FileExists {
        /// The file.
        path: PathBuf,
    },
    /// The output directory holds an interrupted conversion, and nobody said what is to become of it.
    #[error(
        "{}: an interrupted conversion is there, {done} of {of} layers are done: give --resume to go on with it, \
         or --force to begin anew",
        path.display()
    )]
    OutputInterrupted {
        /// The directory.
        path: PathBuf,
        /// Layers that need not be done again.
        done: u64,
        /// Layers in all, counted as in [`Error::Resumable`].
        of: u64,
    },
    /// The output directory holds what no tile set has, so that nothing in it is replaced.
    #[error("{}: the directory holds {}, which is no part of a tile set: give another directory", path.display(), entry.display())]
    OutputForeign {
        /// The directory.
        path: PathBuf,
        /// The name of what is in it.
        entry: std::ffi::OsString,
    },
    /// Another run writes into the output directory.
    #[error("{}: another run of alvis is writing there: wait until it is done, or give another directory", path.display())]
    OutputBusy {
        /// The directory.
        path: PathBuf,
    },
    /// The conversion that was interrupted is not the one that is asked for.
    #[error(
        "{}: the interrupted conversion there differs from this one: {differences}: give input and \
         options as they were, or --force instead of --resume to begin anew",
        path.display()
    )]
    OtherConversion {
        /// The output directory.
        path: PathBuf,
        /// What differs, with the old and the new value each.
        differences: String,
    },
    /// The tile set that is to be gone on with is whole, and not the one that is asked for.
    #[error(
        "{}: the tile set there was made otherwise: {differences}: {}",
        path.display(),
        replacing(*begun)
    )]
    OtherTileSet {
        /// The output directory.
        path: PathBuf,
        /// What differs, with the old and the new value each.
        differences: String,
        /// The one that is asked for was begun in place of it and interrupted.
        begun: bool,
    },
    /// The parts of a volume that are worked on there are those of another plan.
    #[error(
        "{}: the plan there differs from this: {differences}: give input, options and program as they were, or make \
         the plan again with --force",
        path.display()
    )]
    OtherPlan {
        /// The output directory.
        path: PathBuf,
        /// What differs, with the old and the new value each.
        differences: String,
    },
    /// The output directory holds a plan, whose parts may be worked on by others.
    #[error(
        "{}: a plan to convert a volume in parts is there: finish it by `alvis work` and `alvis merge`, or give \
         --force to drop it and what its parts have made",
        path.display()
    )]
    OutputPlanned {
        /// The directory.
        path: PathBuf,
    },
    /// The input was changed while it was read: what was made of it may be of neither state.
    #[error(
        "{}: the input was changed while it was read: found {found}: nothing was made of it: do this again when \
         nobody writes to it",
        path.display()
    )]
    InputChanged {
        /// The input.
        path: PathBuf,
        /// What differs from before.
        found: String,
    },
    /// A conversion failed after it had finished layers; these are kept.
    #[error("{error}: {done} of {of} layers are done and kept in {}: {next}", path.display())]
    Resumable {
        /// What went wrong.
        error: Box<Error>,
        /// The output directory.
        path: PathBuf,
        /// Layers that need not be done again.
        done: u64,
        /// Layers in all; a conversion with `min_voxels` counts three times as many.
        of: u64,
        /// How to go on.
        next: String,
    },
    /// Some of several scans could not be converted.
    #[error(
        "{failed} of {of} scans could not be converted{}",
        why_in_table(*failed, *kept, table)
    )]
    ScansFailed {
        /// How many.
        failed: usize,
        /// How many of these have a tile set from before, of which the table still tells.
        kept: usize,
        /// Of how many.
        of: usize,
        /// The table of all scans.
        table: PathBuf,
    },
    /// The caller asked to stop before all of several scans were converted.
    #[error("stopped on request: {done} of {of} scans are done: {next}")]
    ScansStopped {
        /// How many are done.
        done: usize,
        /// Of how many.
        of: usize,
        /// How to go on.
        next: String,
    },
    /// The caller asked to stop.
    #[error("stopped on request")]
    Interrupted,
}

/// Bytes as `--memory` takes them, in whole MiB; below one, as they are.
fn mib(bytes: u64, round: fn(f64) -> f64) -> String {
    match bytes >> 20 {
        0 => format!("{bytes} bytes"),
        _ => format!("{}MiB", round(bytes as f64 / f64::from(1 << 20))),
    }
}

/// The uses of memory, the largest first; nothing of those that are far smaller than others.
fn listed(uses: &[MemoryUse]) -> String {
    let all: u64 = uses
        .iter()
        .map(|each| each.bytes)
        .fold(0, u64::saturating_add);
    let mut uses: Vec<_> = uses.iter().filter(|each| each.bytes > all / 100).collect();
    uses.sort_by_key(|each| std::cmp::Reverse(each.bytes));
    let each = |each: &&MemoryUse| format!("{} for {}", mib(each.bytes, f64::round), each.by);
    match &uses.iter().map(each).collect::<Vec<_>>()[..] {
        [] => String::new(),
        listed => format!(" ({})", listed.join(", ")),
    }
}

/// How to replace a tile set that was made otherwise, in whose place this conversion may have been begun.
fn replacing(begun: bool) -> &'static str {
    match begun {
        true => {
            "what this conversion has done to replace it is kept: give --force beside --resume to go on with that, or \
             another directory"
        }
        false => {
            "give input and options as they were, --force instead of --resume to replace it, or another directory"
        }
    }
}

/// Where it stands why scans failed: in the table, but for those of which it tells something else.
fn why_in_table(failed: usize, kept: usize, table: &Path) -> String {
    let table = table.display();
    let of = match failed - kept {
        _ if kept == 0 => return format!(": the column `error` of {table} says why"),
        0 => ": why is said above and by --json".to_owned(),
        _ => format!(
            ": the column `error` of {table} says why, or else it is said above and by --json"
        ),
    };
    let stay = match kept {
        1 => "one of them has a tile set from before, which stays as it was, as does its row"
            .to_owned(),
        _ => format!(
            "{kept} of them have tile sets from before, which stay as they were, as do their rows"
        ),
    };
    format!("{of}; {stay} in {table}")
}

fn advice(hint: &str) -> String {
    if hint.is_empty() {
        String::new()
    } else {
        format!(": {hint}")
    }
}

/// What the user can do about a system error whose cause is plain.
fn way_out(source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind::{QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    match source.kind() {
        StorageFull | QuotaExceeded => "free some space there, or write to another disk",
        ReadOnlyFilesystem => "write to another place",
        _ => "",
    }
}

impl Error {
    /// Wraps a system error with the file and the verb phrase of what was tried.
    pub fn io(path: impl AsRef<Path>, action: &'static str, source: std::io::Error) -> Self {
        Error::Io {
            path: path.as_ref().to_path_buf(),
            action,
            source,
        }
    }

    /// A damaged or contradictory file: what was found and what was expected.
    pub fn format(
        path: impl AsRef<Path>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Error::Format {
            path: path.as_ref().to_path_buf(),
            found: found.into(),
            expected: expected.into(),
            hint: String::new(),
        }
    }

    /// An option with an impossible value.
    pub fn usage(
        option: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Error::Usage {
            option: option.into(),
            found: found.into(),
            expected: expected.into(),
            hint: String::new(),
        }
    }

    /// A sound file of a kind that is not read, with a way out.
    pub fn unsupported(
        path: impl AsRef<Path>,
        what: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        Error::Unsupported {
            path: path.as_ref().to_path_buf(),
            what: what.into(),
            hint: hint.into(),
        }
    }

    /// A size that is out of range by what a header says, and not by an option; `what` has that size.
    pub(crate) fn of_header(self, path: &Path, what: &str) -> Self {
        match self {
            Error::Usage {
                found, expected, ..
            } => {
                let flat = found.ends_with(" x 1");
                let error = Error::format(path, format!("{what} of {found}"), expected);
                match flat {
                    true => error.with_hint("one slice is no volume: give what holds all slices"),
                    false => error,
                }
            }
            other => other,
        }
    }

    /// Adds advice to a [`Error::Format`], [`Error::Usage`] or [`Error::Unsupported`]; leaves the others as they are.
    pub fn with_hint(mut self, text: impl Into<String>) -> Self {
        if let Error::Format { hint, .. }
        | Error::Usage { hint, .. }
        | Error::Unsupported { hint, .. } = &mut self
        {
            *hint = text.into();
        }
        self
    }
}
