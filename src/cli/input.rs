//! What a command reads: a file, or a volume that the program which calls the command has.

use super::sigbus;
use crate::error::{Error, Result};
use crate::grid::{Part, Placement, Provenance};
use crate::progress::Progress;
use crate::volume::{self, Before, Io, OpenOptions, Opened, Stamp, Volume, file_name};
use std::path::Path;

/// Makes a volume that lies in this place.
pub type MakeVolume = dyn FnOnce(Placement) -> Result<Box<dyn Volume>> + Send;

/// A volume that the calling program has, such as an array in memory.
pub struct Given {
    /// What it is called in the manifest and in messages.
    pub name: String,
    /// Makes it, when spacing and unit are known.
    pub make: Box<MakeVolume>,
    /// Names and values that differ whenever its samples do: what was made of a part of another volume is never gone on
    /// with.
    pub identity: Vec<(String, String)>,
}

impl std::fmt::Debug for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Given")
            .field("name", &self.name)
            .field("identity", &self.identity)
            .finish_non_exhaustive()
    }
}

/// What a command reads.
pub enum Input<'a> {
    /// The file or folder at this path.
    Path(&'a Path),
    /// A volume of the calling program.
    Given(Given),
}

impl Input<'_> {
    /// What messages call it.
    pub fn path(&self) -> &Path {
        match self {
            Input::Path(path) => path,
            Input::Given(given) => Path::new(&given.name),
        }
    }

    /// Its name without a directory.
    pub fn name(&self) -> String {
        file_name(self.path())
    }

    /// Opens it, with what tells any change to it from then on. What lies in the directory `out` is no part of it.
    ///
    /// # Errors
    /// Those of [`volume::open`]; [`Error::Usage`] for options that say something of a file where there is none.
    pub fn open(self, options: &OpenOptions, out: &Path) -> Result<(Opened, Stamp)> {
        match self {
            Input::Path(path) => {
                if options.io == Io::Mmap {
                    sigbus::guard(path);
                }
                let before = Before::of(path, out);
                let opened = volume::open(path, options)?;
                let stamp = volume::stamp(&before, &opened)?;
                Ok((opened, stamp))
            }
            Input::Given(given) => given.open(options),
        }
    }
}

/// Opens a file that is given beside the input, with what tells any change to it from then on.
///
/// # Errors
/// What `open` returns; [`Error::Io`].
pub fn open_beside(path: &Path, open: impl FnOnce() -> Result<Opened>) -> Result<(Opened, Stamp)> {
    let before = Before::of(path, Path::new(""));
    let opened = open()?;
    let stamp = volume::stamp(&before, &opened)?;
    Ok((opened, stamp))
}

/// Warns if something about a file was changed while it was read.
///
/// # Errors
/// [`Error::InputChanged`] if it was written to or exchanged.
pub fn check_read(stamp: &Stamp, progress: &dyn Progress) -> Result<()> {
    if let Some(warning) = stamp.check()? {
        progress.warn(&warning);
    }
    Ok(())
}

impl Given {
    fn open(self, options: &OpenOptions) -> Result<(Opened, Stamp)> {
        if let Some(option) = options.of_files() {
            let expected = "a file, which it says something of: an array says this itself";
            return Err(Error::usage(option, "it with an array", expected));
        }
        let path = Path::new(&self.name);
        let (placement, provenance) =
            volume::place(path, Placement::default(), Provenance::default(), options)?;
        let opened = Opened {
            volume: (self.make)(placement)?,
            filtered: None,
            provenance,
            name: self.name,
            offset: 0,
            part: Part::default(),
            files: Vec::new(),
            values: None,
            scaled: false,
            notes: Vec::new(),
            warnings: Vec::new(),
        };
        Ok((opened, Stamp::in_memory(self.identity)))
    }
}
