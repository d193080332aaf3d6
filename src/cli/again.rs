//! What goes on with a conversion that was interrupted.

use super::output;
use crate::convert;
use crate::error::Error;
use std::ffi::OsString;
use std::path::Path;

/// How a conversion is asked for again.
#[derive(Clone, Copy)]
pub enum Again<'a> {
    /// By the command line that began it, with `--resume`.
    Typed(&'a [OsString]),
    /// By this call of the program that has the library in its process.
    Called(&'a str),
}

impl Again<'_> {
    /// Adds to an error that a part of the work in `out` is kept, and what goes on with it, if that is so.
    pub fn resumable(self, error: Error, out: &Path) -> Error {
        let refused = matches!(
            error,
            Error::OutputBusy { .. }
                | Error::InputChanged { .. }
                | Error::OutputExists { .. }
                | Error::OutputForeign { .. }
                | Error::OutputInterrupted { .. }
                | Error::OtherConversion { .. }
                | Error::OtherTileSet { .. }
        );
        match convert::interrupted(out).filter(|_| !refused) {
            Some(kept) => Error::Resumable {
                next: self.next(&error),
                error: Box::new(error),
                path: out.to_path_buf(),
                done: kept.done,
                of: kept.of,
            },
            None => error,
        }
    }

    /// What goes on after this error.
    fn next(self, error: &Error) -> String {
        match (error, self) {
            (Error::Interrupted, _) => format!("`{}` goes on", self.line()),
            // the same limit would fail again
            (Error::TooDense { needed, .. }, Again::Typed(typed)) => {
                let line = resuming(&with_memory(typed, 2 * needed));
                format!("`{line}` goes on")
            }
            (Error::TooDense { needed, .. }, Again::Called(line)) => {
                format!("`{line}` with memory of {} goes on", in_mib(2 * needed))
            }
            _ => format!("once the cause is removed, `{}` goes on", self.line()),
        }
    }

    /// The command line or the call.
    fn line(self) -> String {
        match self {
            Again::Typed(typed) => resuming(typed),
            Again::Called(line) => line.to_owned(),
        }
    }
}

/// The command line that goes on with the conversion that this one began.
pub fn resuming(typed: &[OsString]) -> String {
    let words = typed.iter().skip(1).filter(|word| *word != "--resume");
    let mut words: Vec<String> = words.map(|word| output::shell_word(word)).collect();
    // what follows this is no option
    let end = words.iter().position(|word| word == "--");
    words.insert(end.unwrap_or(words.len()), "--resume".to_owned());
    format!("alvis {}", words.join(" "))
}

/// A command line with another limit of memory, in whole MiB.
fn with_memory(typed: &[OsString], bytes: u64) -> Vec<OsString> {
    const OPTION: &str = "--memory";
    let mut words = Vec::new();
    let mut typed = typed.iter();
    while let Some(word) = typed.next() {
        if word == "--" {
            words.push(word.clone());
            break;
        } else if word == OPTION {
            typed.next();
        } else if !word.to_string_lossy().starts_with("--memory=") {
            words.push(word.clone());
        }
    }
    words.extend(typed.cloned());
    let end = words.iter().position(|word| word == "--");
    let place = end.unwrap_or(words.len());
    words.splice(place..place, [OPTION.into(), in_mib(bytes).into()]);
    words
}

/// A limit of memory as `--memory` takes it.
fn in_mib(bytes: u64) -> String {
    format!("{}MiB", bytes.div_ceil(1 << 20))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_that_goes_on_has_another_limit() {
        for (typed, expected) in [
            (
                "alvis convert a b --memory 40MiB --threshold 3",
                "alvis convert a b --threshold 3 --memory 90MiB --resume",
            ),
            (
                "alvis convert --memory=40MiB --threshold 3 -- a b",
                "alvis convert --threshold 3 --memory 90MiB --resume -- a b",
            ),
            (
                "alvis convert a b",
                "alvis convert a b --memory 90MiB --resume",
            ),
        ] {
            let typed: Vec<OsString> = typed.split(' ').map(OsString::from).collect();
            assert_eq!(resuming(&with_memory(&typed, 90 << 20)), expected);
        }
    }

    #[test]
    fn a_call_that_goes_on_is_told_the_limit_beside_it() {
        let dense = Error::TooDense {
            limit: 40 << 20,
            needed: 45 << 20,
            uses: Vec::new(),
        };
        let next = Again::Called("convert(resume=True)").next(&dense);
        assert_eq!(next, "`convert(resume=True)` with memory of 90MiB goes on");
    }
}
