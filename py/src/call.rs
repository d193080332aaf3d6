//! The commands, called from Python.

use crate::progress::run;
use crate::volume::Source;
use alvis::cli::call::{self as library, Call};
use alvis::{Error, Result};
use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs `info`, `convert` or `verify` with the words that would be typed; returns the JSON object that the command prints
/// with `--json`. `volume` stands for the input of that name: a NumPy array, or whatever gives one when it is sliced.
#[pyfunction]
#[pyo3(signature = (words, volume=None, name="array", again="", progress=None))]
pub fn call(
    py: Python<'_>,
    words: Vec<OsString>,
    volume: Option<&Bound<'_, PyAny>>,
    name: &str,
    again: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let source = volume.map(Source::of).transpose()?;
    let raised = source.as_ref().and_then(Source::raised);
    // what an interrupted conversion is known by: only they are gone on with
    let identified = words.first().is_some_and(|command| command == "convert");
    let made = run(py, progress, move |progress| {
        let given = source.map(|source| in_threads(|| source.given(name, identified)));
        let given = given.transpose()?;
        library::call(Call {
            words,
            volume: given,
            again,
            progress,
        })
    });
    match (made, raised.and_then(|raised| raised.take())) {
        // what reading the volume raised says more than that it could not be read
        (Err(_), Some(raised)) => Err(raised),
        (made, _) => made,
    }
}

/// Works in threads of its own, which end with it: a process that was forked has none of those that its parent had, and
/// would wait for them.
fn in_threads<R: Send>(work: impl FnOnce() -> Result<R> + Send) -> Result<R> {
    let pool = rayon::ThreadPoolBuilder::new().build();
    let pool = pool.map_err(|e| Error::Io {
        path: "threads".into(),
        action: "start",
        source: std::io::Error::other(e),
    })?;
    pool.install(work)
}

/// Runs a whole command line, whose first word is the program's name; returns the exit status.
#[pyfunction]
pub fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| alvis::cli::status(words))
}
