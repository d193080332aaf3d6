//! What goes to stdout and stderr, and numbers as people read them.

use crate::error::{Error, Result};
use bytesize::ByteSize;
use serde::Serialize;
use std::io::{ErrorKind, IsTerminal, Write};

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

/// A path as a shell takes it.
pub fn shell(path: &std::path::Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) && !text.starts_with('-') {
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

/// Columns of the terminal on stdout, or 80.
pub fn width() -> usize {
    terminal_size::terminal_size().map_or(80, |(w, _)| usize::from(w.0))
}

/// `1.5 GiB`.
pub fn bytes(n: u64) -> String {
    ByteSize(n).display().iec().to_string()
}

/// `12,345,678`.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// `0.5 x 0.5 x 2`.
pub fn times(values: [f64; 3]) -> String {
    values.map(|v| v.to_string()).join(" x ")
}

/// Lines of a name, padded, and a value.
pub fn table(rows: &[(&str, String)]) -> String {
    let wide = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    rows.iter()
        .map(|(name, value)| format!("{name:wide$}  {value}\n"))
        .collect()
}

/// A count with its word: `1 cell`, `1,339 cells`.
pub fn several(n: u64, word: &str) -> String {
    let plural = if n == 1 { "" } else { "s" };
    format!("{} {word}{plural}", count(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped() {
        let texts = [0, 7, 999, 1000, 123_456, 1_234_567].map(count);
        assert_eq!(texts, ["0", "7", "999", "1,000", "123,456", "1,234,567"]);
        assert_eq!(bytes(3 << 29), "1.5 GiB");
    }
}
