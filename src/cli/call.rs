//! Commands for a program that has this library in its process, such as a module of another language.
//!
//! Options are those that can be typed, so that whatever a command can do can be asked for here, and is refused here as it
//! is there. The volume may be one that the program has in memory; progress goes to the program, which decides about
//! signals; what comes back is the JSON object that the command prints with `--json`.

use super::again::Again;
use super::args::Common;
use super::convert::ConvertArgs;
use super::info::InfoArgs;
use super::info_tiles::OpenedTiles;
use super::input::Input;
use super::progress::Console;
use super::verify::VerifyArgs;
use super::{Cli, Command};
use crate::error::{Error, Result};
use crate::progress::Progress;
use clap::Parser;
use clap::error::{ContextKind, ContextValue};
use serde::Serialize;
use std::error::Error as _;
use std::ffi::OsString;

pub use super::input::{Given, MakeVolume};

/// A command that is called.
pub struct Call<'a> {
    /// The words that would be typed behind `alvis`: `convert`, `--threshold=otsu`, `scan.mhd`, `OUT`.
    pub words: Vec<OsString>,
    /// The volume, in place of the file that the words name as INPUT or as that of `--against`.
    pub volume: Option<Given>,
    /// How the program calls the command again to go on with a conversion that was interrupted: what
    /// [`Error::Resumable`] says.
    pub again: &'a str,
    /// Told of what happens, and asked whether to stop.
    pub progress: &'a dyn Progress,
}

/// Runs `info`, `convert` or `verify`, and returns the JSON object that the command prints with `--json`. That the
/// verifier found issues is no error.
///
/// # Errors
/// Those of the command; [`Error::Usage`] for words that it does not know, and for other commands.
///
/// # Examples
/// ```
/// use alvis::cli::call::{Call, Given, call};
/// use alvis::grid::{Dims, Placement};
/// use alvis::progress::Quiet;
/// use alvis::volume::MemoryVolume;
///
/// let given = Given {
///     name: "array".into(),
///     make: Box::new(|place: Placement| {
///         let samples = (0..1000).map(|i| if i % 10 < 5 { 40u8 } else { 200 }).collect();
///         Ok(Box::new(MemoryVolume::new(Dims::new([10; 3])?, place, samples)?))
///     }),
///     identity: vec![("array".into(), "a ramp".into())],
/// };
/// let words = ["info", "--spacing=0.05", "--unit=mm", "array"];
/// let json = call(Call {
///     words: words.map(Into::into).to_vec(),
///     volume: Some(given),
///     again: "",
///     progress: &Quiet,
/// })?;
/// assert!(json.contains("\"dims\":[10,10,10]") && json.contains("\"unit\":\"mm\""));
/// # Ok::<(), alvis::Error>(())
/// ```
pub fn call(call: Call) -> Result<String> {
    let name: OsString = "alvis".into();
    let typed = std::iter::once(&name).chain(&call.words);
    let cli = Cli::try_parse_from(typed).map_err(|refusal| usage(&refusal, &call.words))?;
    let console = Console::Handed(call.progress);
    match cli.command {
        Command::Info(args) => in_threads(&args.common, || info(&args, call.volume, &console)),
        Command::Convert(args) => in_threads(&args.common, || {
            convert(&args, call.volume, call.again, &console)
        }),
        Command::Verify(args) => in_threads(&args.common, || verify(&args, call.volume, &console)),
        _ => {
            let found = call.words.first().map(|word| word.display().to_string());
            let expected = "info, convert or verify";
            Err(Error::usage("command", found.unwrap_or_default(), expected))
        }
    }
}

/// Works in threads of its own, which end with it: those that all work of a process shares are missing in a process that
/// was forked from it, and would be waited for without end.
fn in_threads<R: Send>(common: &Common, work: impl FnOnce() -> Result<R> + Send) -> Result<R> {
    let threads = common.worker_threads();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::usage("--threads", threads.to_string(), e.to_string()))?;
    pool.install(work)
}

fn info(args: &InfoArgs, volume: Option<Given>, console: &Console) -> Result<String> {
    match volume {
        None if args.is_of_tiles()? => json(&OpenedTiles::open(&args.input)?.report()),
        volume => {
            let input = volume.map_or(Input::Path(&args.input), Input::Given);
            json(&args.found(input, console)?.report())
        }
    }
}

fn convert(
    args: &ConvertArgs,
    volume: Option<Given>,
    again: &str,
    console: &Console,
) -> Result<String> {
    let (None, Some(out)) = (&args.out_dir, &args.out) else {
        return Err(Error::usage(
            "--out-dir",
            "several volumes",
            "one volume, and OUT",
        ));
    };
    let input = volume.map_or(Input::Path(&args.input), Input::Given);
    let report = args.convert(input, out, Again::Called(again), console)?;
    json(&args.printed(&report, args.levels(out, console)?.as_ref()))
}

fn verify(args: &VerifyArgs, volume: Option<Given>, console: &Console) -> Result<String> {
    let path = args.against.as_deref().map(Input::Path);
    let against = volume.map(Input::Given).or(path);
    json(&args.verify(against, console)?)
}

fn json(value: &impl Serialize) -> Result<String> {
    serde_json::to_string(value).map_err(|e| Error::io("report", "write", e.into()))
}

/// The parser's complaint, with the option, the value and what it takes.
fn usage(refusal: &clap::Error, words: &[OsString]) -> Error {
    let text = |kind| match refusal.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(texts)) => Some(texts.join(", ")),
        _ => None,
    };
    let option = text(ContextKind::InvalidArg);
    let value = text(ContextKind::InvalidValue);
    let takes = refusal.source().map(ToString::to_string);
    let takes = takes.or(text(ContextKind::ValidValue));
    match (option, value) {
        (Some(option), Some(value)) => {
            let name = option.split([' ', '=']).next().unwrap_or_default();
            let takes = takes.unwrap_or_else(|| "another value".to_owned());
            let takes = match takes.split_once(" is not in ") {
                Some((_, range)) => format!("a number in {range}"),
                None => takes.strip_prefix("expected ").unwrap_or(&takes).to_owned(),
            };
            Error::usage(name, value, takes)
        }
        (option, _) => {
            let command = words.first().map(|word| word.display().to_string());
            let command = command.unwrap_or_default();
            let typed = std::iter::once("alvis".into()).chain(words.iter().cloned());
            let typed: Vec<OsString> = typed.collect();
            let found = super::one_line(refusal, &typed);
            let option = option.unwrap_or_else(|| command.clone());
            Error::usage(option, found, format!("what `alvis {command}` takes"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;
    use std::sync::Mutex;

    const SIZE: u64 = 12;

    /// A ball, which lies in the middle.
    fn samples() -> Vec<u8> {
        let at = |i: u64| [i % SIZE, i / SIZE % SIZE, i / SIZE / SIZE].map(|c| c as f64 - 5.5);
        let square = |i| at(i).iter().map(|c| c * c).sum::<f64>();
        (0..SIZE.pow(3))
            .map(|i| (255.0 - 6.0 * square(i)).max(0.0) as u8)
            .collect()
    }

    fn given() -> Option<Given> {
        Some(Given {
            name: "array".into(),
            make: Box::new(|place: Placement| {
                let volume = MemoryVolume::new(Dims::new([SIZE; 3])?, place, samples())?;
                Ok(Box::new(volume))
            }),
            identity: vec![("array".into(), "ball".into())],
        })
    }

    fn ask(words: &[&str], volume: Option<Given>, progress: &dyn Progress) -> Result<String> {
        call(Call {
            words: words.iter().map(OsString::from).collect(),
            volume,
            again: "convert(resume=True)",
            progress,
        })
    }

    #[test]
    fn a_volume_in_memory_makes_the_tiles_of_its_file() {
        let dir = tempfile::tempdir().unwrap();
        let [file, a, b] =
            ["ball.raw", "a", "b"].map(|name| dir.path().join(name).display().to_string());
        std::fs::write(&file, samples()).unwrap();
        let place = ["--spacing=0.5", "--unit=um", "--threshold=100"];
        let words = [&["convert"][..], &place, &["array", &a]].concat();
        let report: serde_json::Value =
            serde_json::from_str(&ask(&words, given(), &Quiet).unwrap()).unwrap();
        assert_eq!(report["objects"], 1);
        let raw = ["--dims=12,12,12", "--dtype=u8", &file, &b];
        ask(&[&["convert"][..], &place, &raw].concat(), None, &Quiet).unwrap();
        for file in [
            "tiles/z0000/y0000_x0000.glb",
            "cells.csv",
            "objects.csv",
            "surfaces.csv",
        ] {
            let [a, b] = ["a", "b"].map(|set| std::fs::read(dir.path().join(set).join(file)));
            assert_eq!(a.unwrap(), b.unwrap(), "{file}");
        }
        for set in [&a, &b] {
            let words = ["verify", "--against=array", set];
            let report = ask(&words, given(), &Quiet).unwrap();
            assert!(report.contains("\"ok\":true"), "{report}");
        }
        let info = ask(&["info", &a], None, &Quiet).unwrap();
        assert!(info.contains("\"cells\""), "{info}");
    }

    #[test]
    fn what_cannot_be_asked_is_refused_with_the_option() {
        for (words, named, says) in [
            (
                &["convert", "--threshold=high", "array", "x"][..],
                "--threshold",
                "otsu",
            ),
            (
                &[
                    "convert",
                    "--threshold=1",
                    "--ambiguous=maybe",
                    "array",
                    "x",
                ],
                "--ambiguous",
                "separate",
            ),
            (&["convert", "array", "x"], "--threshold", "--threshold"),
            (
                &["convert", "--threshold=1", "--frob", "array", "x"],
                "--frob",
                "--frob",
            ),
            (
                &["info", "--dims=1,2,3", "array"],
                "--dims",
                "an array says this itself",
            ),
            (
                &["info", "--spacing=2", "array"],
                "--unit",
                "the unit of --spacing",
            ),
            (&["demo"], "command", "info, convert or verify"),
        ] {
            match ask(words, given(), &Quiet) {
                Err(error @ Error::Usage { .. }) => {
                    let text = error.to_string();
                    let Error::Usage { option, .. } = error else {
                        unreachable!()
                    };
                    assert!(
                        option.contains(named) && text.contains(says),
                        "{option}: {text}"
                    );
                }
                other => panic!("{words:?}: {other:?}"),
            }
        }
    }

    /// Hears warnings, and stops the work once a number of steps is done.
    #[derive(Default)]
    struct Stops {
        after: u64,
        done: Mutex<u64>,
    }

    impl Progress for Stops {
        fn advance(&self, steps: u64) {
            *self.done.lock().unwrap() += steps;
        }

        fn interrupted(&self) -> bool {
            *self.done.lock().unwrap() >= self.after
        }
    }

    #[test]
    fn a_conversion_that_was_stopped_goes_on_only_with_the_same_samples() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out").display().to_string();
        let words = [
            "convert",
            "--threshold=100",
            "--macrocube=4",
            "--threads=1",
            "array",
            &out,
        ];
        let again = [&words[..1], &["--resume"], &words[1..]].concat();
        let stops = Stops {
            after: 2,
            ..Stops::default()
        };
        let stopped = ask(&words, given(), &stops).unwrap_err();
        assert!(!dir.path().join("out/index.json").exists());
        assert!(matches!(stopped, Error::Resumable { .. }), "{stopped}");
        assert!(
            stopped
                .to_string()
                .contains("`convert(resume=True)` goes on"),
            "{stopped}"
        );
        let other = given().map(|given| Given {
            identity: vec![("array".into(), "cube".into())],
            ..given
        });
        let refused = ask(&again, other, &Quiet).unwrap_err();
        assert!(
            refused.to_string().contains("array was ball and is cube"),
            "{refused}"
        );
        let made = ask(&again, given(), &Quiet).unwrap();
        let made: serde_json::Value = serde_json::from_str(&made).unwrap();
        assert!(made["resumed_layers"].as_u64() > Some(0), "{made}");
    }
}
