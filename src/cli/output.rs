//! What goes to stdout and stderr, and numbers as people read them.

use crate::error::{Error, Result};
use crate::manifest::Totals;
pub use crate::words::{count, things};
use bytesize::ByteSize;
use serde::Serialize;
use std::ffi::OsStr;
use std::io::{ErrorKind, IsTerminal, Write};
use std::os::fd::AsFd;
use std::path::Path;

/// Writes text to stdout. That nobody reads it any more (`alvis info x | head`) is no error.
pub fn print(text: &str) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    let written = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
    match written {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Error::io("stdout", "write", e)),
        _ => Ok(()),
    }
}

/// Gathers a long text for stdout. Nothing is written before [`LongText::finish`] or the first
/// [`HELD`] bytes, so that what fails early says nothing there.
#[derive(Debug, Default)]
pub struct LongText(String);

/// Bytes that a [`LongText`] gathers.
const HELD: usize = 1 << 20;

impl LongText {
    /// Adds text.
    pub fn push(&mut self, text: &str) -> Result<()> {
        self.0.push_str(text);
        if self.0.len() >= HELD {
            print(&self.0)?;
            self.0.clear();
        }
        Ok(())
    }

    /// Writes what is left.
    pub fn finish(self) -> Result<()> {
        print(&self.0)
    }
}

/// Writes one JSON object to stdout. Numbers that are not finite become null.
pub fn print_json(value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)
        .map_err(|e| Error::io("stdout", "write JSON", e.into()))?;
    text.push('\n');
    print(&text)
}

/// How many cells there are and, where they are parts of components, of how many of these; and the walls between them.
pub fn cells_of(totals: &Totals) -> String {
    let cells = things(totals.cells, "cell");
    let walls = things(totals.walls, "wall");
    match (totals.components, totals.walls) {
        (0, 0) => cells,
        (0, _) => format!("{cells} with {walls}"),
        (components, count) => format!(
            "{cells} of {} with {}{}",
            things(components, "component"),
            things(totals.necks, "opening"),
            if count > 0 {
                format!(" and {walls}")
            } else {
                String::new()
            }
        ),
    }
}

/// A path as a shell takes it; one that begins as an option does is given a directory.
pub fn shell(path: &Path) -> String {
    match path.to_string_lossy().starts_with('-') {
        true => shell_word(Path::new(".").join(path).as_os_str()),
        false => shell_word(path.as_os_str()),
    }
}

/// A word of a command line as a shell takes it.
pub fn shell_word(word: &OsStr) -> String {
    let text = word.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text;
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Writes a line to stderr; if that fails there is nobody to tell.
pub fn note(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// True if stdout is a terminal whose user wants colours (<https://no-color.org>).
pub fn stdout_has_colour() -> bool {
    let refused = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
    std::io::stdout().is_terminal() && !refused
}

/// Columns of the terminal on stdout, see [`columns_of`].
pub fn width() -> usize {
    columns_of(std::io::stdout())
}

/// Columns of a stream's terminal, or those that COLUMNS says, or 80.
pub fn columns_of(stream: impl AsFd) -> usize {
    let stated = || std::env::var("COLUMNS").ok()?.parse().ok();
    let terminal = terminal_size::terminal_size_of(stream);
    let width = terminal.map(|(w, _)| usize::from(w.0)).or_else(stated);
    width.filter(|w| *w > 0).unwrap_or(80)
}

/// `1.5 GiB`.
pub fn bytes(n: u64) -> String {
    ByteSize(n).display().iec().to_string()
}

/// `1.5 s, 64.0 MiB of memory at most`, of a whole command.
pub fn took(seconds: f64, peak_rss_bytes: u64) -> String {
    format!(
        "{seconds:.1} s, {} of memory at most",
        bytes(peak_rss_bytes)
    )
}

/// `0.5 x 0.5 x 2`.
pub fn times(values: [f64; 3]) -> String {
    values.map(|v| v.to_string()).join(" x ")
}

/// Text broken between words at `width` columns; lines after the first begin `indent` columns in, as the first is
/// taken to.
pub fn wrapped(text: &str, width: usize, indent: usize) -> String {
    let mut lines = String::new();
    let mut at = indent;
    for word in text.split_whitespace() {
        let long = word.chars().count();
        if at > indent && at + 1 + long > width {
            lines += &format!("\n{:indent$}", "");
            at = indent;
        } else if at > indent {
            lines.push(' ');
            at += 1;
        }
        lines += word;
        at += long;
    }
    lines
}

/// Lines of a name, padded, and a value.
pub fn table(rows: &[(&str, String)]) -> String {
    let wide = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    rows.iter()
        .map(|(name, value)| format!("{name:wide$}  {value}\n"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_a_unit() {
        assert_eq!(bytes(3 << 29), "1.5 GiB");
    }

    #[test]
    fn text_is_broken_between_words() {
        assert_eq!(wrapped("aa bb cc", 7, 2), "aa bb\n  cc");
        assert_eq!(wrapped("toolong a", 4, 2), "toolong\n  a");
        assert_eq!(wrapped("", 9, 2), "");
    }

    #[test]
    fn words_are_as_a_shell_takes_them() {
        for (word, typed) in [
            ("a/b.mhd", "a/b.mhd"),
            ("--where", "--where"),
            ("volume > 3", "'volume > 3'"),
            ("it's", r"'it'\''s'"),
            ("", "''"),
        ] {
            assert_eq!(shell_word(OsStr::new(word)), typed);
        }
        assert_eq!(shell(Path::new("-x.mhd")), "./-x.mhd");
    }
}
