//! Errors of the library as exceptions of `alvis._errors`, which keep place, found, expected and hint.

use alvis::Error;
use pyo3::prelude::*;
use std::io::ErrorKind;

/// What an exception keeps of an error.
#[derive(Default)]
struct Kept {
    place: Option<String>,
    found: Option<String>,
    expected: Option<String>,
    hint: Option<String>,
}

/// The exception of an error.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    let made = py.import("alvis._errors").and_then(|module| {
        let kept = kept(error);
        let told = |text: Option<String>| text.map(|text| as_arguments(&text));
        let arguments = (
            as_arguments(&error.to_string()),
            kept.place,
            kept.found,
            told(kept.expected),
            told(kept.hint),
        );
        module.getattr(class(error))?.call1(arguments)
    });
    made.map_or_else(|e| e, PyErr::from_value)
}

/// A text in which options are named as arguments are: `min_voxels` for `--min-voxels`, but in whole command lines.
pub fn as_arguments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    // what is in backticks is every second part
    for (i, part) in text.split('`').enumerate() {
        let is_quoted = i % 2 == 1;
        if i > 0 {
            out.push('`');
        }
        match is_quoted && !part.starts_with("--") {
            true => out.push_str(part),
            false => name_arguments(part, &mut out),
        }
    }
    out
}

fn name_arguments(text: &str, out: &mut String) {
    let mut rest = text;
    while let Some(at) = rest.find("--") {
        let (before, option) = (&rest[..at], &rest[at + 2..]);
        let length = option.find(|c: char| !c.is_ascii_lowercase() && c != '-');
        let name = &option[..length.unwrap_or(option.len())];
        out.push_str(before);
        let begins = before
            .chars()
            .next_back()
            .is_none_or(|c| " (\"'".contains(c));
        match begins && name.starts_with(|c: char| c.is_ascii_lowercase()) {
            true => out.push_str(&name.replace('-', "_")),
            false => {
                out.push_str("--");
                out.push_str(name);
            }
        }
        rest = &option[name.len()..];
    }
    out.push_str(rest);
}

/// The class of the exception.
fn class(error: &Error) -> &'static str {
    match error {
        Error::Io { source, .. } => match source.kind() {
            ErrorKind::NotFound => "MissingFileError",
            _ => "FileError",
        },
        Error::Format { .. } => "FormatError",
        Error::Unsupported { .. } => "UnsupportedError",
        Error::Usage { .. } => "OptionError",
        Error::Memory { .. } | Error::TooDense { .. } => "MemoryLimitError",
        Error::OutputExists { .. }
        | Error::FileExists { .. }
        | Error::OutputInterrupted { .. }
        | Error::OutputForeign { .. }
        | Error::OutputBusy { .. }
        | Error::OtherConversion { .. }
        | Error::OtherTileSet { .. } => "OutputError",
        Error::InputChanged { .. } => "InputChangedError",
        Error::Resumable { error, .. } => class(error),
        Error::Interrupted => "Stopped",
        _ => "Error",
    }
}

fn kept(error: &Error) -> Kept {
    let some = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
    let at = |path: &std::path::Path| Some(path.display().to_string());
    match error {
        Error::Io { path, source, .. } => Kept {
            place: at(path),
            found: Some(source.to_string()),
            ..Kept::default()
        },
        Error::Format {
            path,
            found,
            expected,
            hint,
        } => Kept {
            place: at(path),
            found: some(found),
            expected: some(expected),
            hint: some(hint),
        },
        Error::Unsupported { path, what, hint } => Kept {
            place: at(path),
            found: some(what),
            hint: some(hint),
            ..Kept::default()
        },
        Error::Usage {
            option,
            found,
            expected,
            hint,
        } => Kept {
            place: Some(option.trim_start_matches('-').replace('-', "_")),
            found: some(found),
            expected: some(expected),
            hint: some(hint),
        },
        Error::Memory {
            limit,
            needed,
            hint,
        } => Kept {
            place: Some("memory".into()),
            found: Some(format!("{limit} bytes")),
            expected: Some(format!("at least {needed} bytes")),
            hint: some(hint),
        },
        Error::TooDense { limit, needed, .. } => Kept {
            place: Some("memory".into()),
            found: Some(format!("{limit} bytes")),
            expected: Some(format!("at least {needed} bytes")),
            hint: None,
        },
        Error::OutputExists { path }
        | Error::FileExists { path }
        | Error::OutputInterrupted { path, .. }
        | Error::OutputBusy { path } => Kept {
            place: at(path),
            ..Kept::default()
        },
        Error::OutputForeign { path, entry } => Kept {
            place: at(path),
            found: some(&entry.display().to_string()),
            ..Kept::default()
        },
        Error::OtherConversion { path, differences }
        | Error::OtherTileSet {
            path, differences, ..
        } => Kept {
            place: at(path),
            found: some(differences),
            ..Kept::default()
        },
        Error::InputChanged { path, found } => Kept {
            place: at(path),
            found: some(found),
            ..Kept::default()
        },
        Error::Resumable { error, next, .. } => Kept {
            hint: some(next),
            ..kept(error)
        },
        _ => Kept::default(),
    }
}
