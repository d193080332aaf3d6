//! Lines of `key = value` in sections, the text that these headers are.

use crate::error::{Error, Result};
use crate::volume::io::blob::Blob;
use crate::volume::io::text::{Field, decoded};
use std::path::Path;

/// No header is longer.
const MAX_HEADER: u64 = 1 << 20;

/// A value for messages and numbers.
pub(super) type Value<'a> = Field<'a>;

/// One line.
struct Line {
    /// The `{group}` above it in lower case, empty if there is none.
    group: String,
    /// The `[section]` above it, likewise.
    section: String,
    /// As the file spells it.
    key: String,
    value: String,
}

/// The lines of a header.
pub(super) struct Keys<'a> {
    path: &'a Path,
    lines: Vec<Line>,
}

impl<'a> Keys<'a> {
    /// Reads a header. Lines without `=` or `:` and those that begin with `!`, `#` or `;` are passed by.
    pub(super) fn read(path: &'a Path) -> Result<Self> {
        let blob = Blob::file(path)?;
        if blob.len() > MAX_HEADER {
            let found = format!("a header of {} bytes", blob.len());
            return Err(Error::format(path, found, format!("at most {MAX_HEADER}")));
        }
        Ok(Keys::parse(path, &blob.head(MAX_HEADER)?))
    }

    fn parse(path: &'a Path, bytes: &[u8]) -> Self {
        let text = decoded(bytes);
        let (mut group, mut section) = (String::new(), String::new());
        let mut lines = Vec::new();
        for line in text.lines().map(str::trim) {
            if let Some(name) = line.strip_prefix('{').and_then(|l| l.strip_suffix('}')) {
                (group, section) = (name.to_lowercase(), String::new());
            } else if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                section = name.to_lowercase();
            } else if !line.starts_with(['!', '#', ';'])
                && let Some((key, value)) = line.split_once(['=', ':'])
            {
                lines.push(Line {
                    group: group.clone(),
                    section: section.clone(),
                    key: key.trim().to_owned(),
                    value: value.trim().trim_end_matches(';').trim().to_owned(),
                });
            }
        }
        Keys { path, lines }
    }

    /// How many sections, each counted once in every group, have names of this form.
    pub(super) fn distinct(&self, is_one: impl Fn(&str) -> bool) -> usize {
        let mut found: Vec<[&str; 2]> = Vec::new();
        for line in &self.lines {
            let own = [line.group.as_str(), line.section.as_str()];
            if is_one(own[1]) && !found.contains(&own) {
                found.push(own);
            }
        }
        found.len()
    }

    /// The value of a key, in whatever case, of a section; empty ones are none.
    ///
    /// # Errors
    /// [`Error::Format`] if the section has it twice, with values that differ.
    pub(super) fn get(&self, section: &str, key: &str) -> Result<Option<Value<'_>>> {
        let own = |line: &&Line| line.section == section && line.key.eq_ignore_ascii_case(key);
        let mut found = self
            .lines
            .iter()
            .filter(own)
            .filter(|l| !l.value.is_empty());
        let Some(first) = found.next() else {
            return Ok(None);
        };
        if let Some(other) = found.find(|line| line.value != first.value) {
            let found = format!("`{key}` of {} and of {}", first.value, other.value);
            return Err(Error::format(self.path, found, "one value"));
        }
        Ok(Some(Field {
            path: self.path,
            name: &first.key,
            text: &first.value,
        }))
    }

    /// The value of a key that a header has to have.
    pub(super) fn need(&self, section: &str, key: &str) -> Result<Value<'_>> {
        self.get(section, key)?.ok_or_else(|| {
            let place = match section {
                "" => String::new(),
                section => format!(" in [{section}]"),
            };
            let found = format!("no `{key}`{place}");
            Error::format(self.path, found, "a header that states it")
        })
    }
}

/// True for a text that has all of these words, in whatever case.
pub(super) fn has_words(head: &[u8], words: &[&str]) -> bool {
    // binary files, which the most are, need not be searched
    let plain = |b: &u8| *b >= 32 || b"\t\r\n\x0c".contains(b);
    if !head.iter().take(64).all(plain) {
        return false;
    }
    let text = String::from_utf8_lossy(head).to_lowercase();
    words.iter().all(|word| text.contains(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_belong_to_their_sections() {
        let text = b"{volume1}\r\n[file1]\r\nSize = 1 2 3\r\n! x = 7\r\n[Geometry]\r\nsize = 4\r\nsize = 4\r\nunit =\r\n\
                     twice: a\ntwice: b\n";
        let keys = Keys::parse(Path::new("a.vgi"), text);
        let value = |section, key| keys.get(section, key).map(|v| v.map(|v| v.text.to_owned()));
        assert_eq!(value("file1", "size").unwrap().as_deref(), Some("1 2 3"));
        assert_eq!(value("geometry", "SIZE").unwrap().as_deref(), Some("4"));
        assert_eq!(value("geometry", "unit").unwrap(), None);
        assert_eq!(value("file1", "x").unwrap(), None);
        assert!(
            value("geometry", "twice")
                .unwrap_err()
                .to_string()
                .contains("of a and of b")
        );
        let error = keys.need("file1", "name").err().unwrap().to_string();
        assert!(error.contains("no `name` in [file1]"), "{error}");
        assert_eq!(keys.distinct(|section| section.starts_with("file")), 1);
        assert!(has_words(text, &["[file1]", "[geometry]"]) && !has_words(text, &["[file2]"]));
        assert!(!has_words(b"\0\0[file1]", &["[file1]"]));
    }
}
