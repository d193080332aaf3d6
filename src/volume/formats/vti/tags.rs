//! The tags of a VTK file, and where what follows each of them begins.

use crate::error::{Error, Result};
use crate::volume::formats::vti::Bytes;
use std::io::BufRead;

/// Tags beyond this many bytes in all are no header of a volume.
const MAX_TAGS: usize = 1 << 20;

/// A tag without its brackets.
#[derive(Debug, Clone)]
pub(crate) struct Tag {
    pub(crate) text: String,
    /// Position of the first byte after it.
    pub(crate) end: u64,
}

impl Tag {
    /// Its name, with the slash of a closing one.
    pub(crate) fn name(&self) -> &str {
        self.text.split([' ', '/']).next().unwrap_or_default()
    }

    /// The value of an attribute.
    pub(crate) fn get(&self, key: &str) -> Option<&str> {
        for quote in ['"', '\''] {
            let start = format!(" {key}={quote}");
            if let Some(at) = self.text.find(&start) {
                return self.text[at + start.len()..].split(quote).next();
            }
        }
        None
    }
}

/// Reads the tags up to the appended data, or to the end of the file. Samples between tags are
/// passed by.
///
/// # Errors
/// [`Error::Format`] if the file ends inside a tag or has too many.
pub(crate) fn read(bytes: &Bytes) -> Result<Vec<Tag>> {
    let mut reader = bytes.reader(0, u64::MAX);
    let fail = |e| Error::io(bytes.path(), "read", e);
    let (mut tags, mut position, mut total) = (Vec::<Tag>::new(), 0, 0);
    loop {
        let skipped = reader.skip_until(b'<').map_err(fail)? as u64;
        position += skipped;
        if reader.fill_buf().map_err(fail)?.is_empty() {
            return Ok(tags);
        }
        let mut text = Vec::new();
        let room = (MAX_TAGS - total) as u64 + 1;
        let n = std::io::Read::take(&mut reader, room)
            .read_until(b'>', &mut text)
            .map_err(fail)?;
        position += n as u64;
        total += n;
        if text.pop() != Some(b'>') {
            let found = format!("a tag without an end before byte {position}");
            return Err(Error::format(bytes.path(), found, "a whole VTK file"));
        }
        let text = String::from_utf8_lossy(&text).replace(['\n', '\r', '\t'], " ");
        let last = text.starts_with("AppendedData");
        tags.push(Tag {
            text,
            end: position,
        });
        if last {
            return Ok(tags);
        }
    }
}
