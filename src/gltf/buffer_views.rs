//! The bytes of buffer views: parts of the BIN chunk, or what these were decompressed to.

use crate::gltf::container::{Fault, Result, fail};
use crate::gltf::read_json::Document;
use std::ops::Range;
use std::sync::Arc;

/// Part of the file, or of what was decompressed from it.
#[derive(Debug, Clone)]
pub(crate) struct Bytes<'a> {
    source: Source<'a>,
    range: Range<usize>,
}

#[derive(Debug, Clone)]
enum Source<'a> {
    File(&'a [u8]),
    Own(Arc<Vec<u8>>),
}

impl<'a> Bytes<'a> {
    fn new(source: Source<'a>) -> Self {
        let mut all = Bytes {
            source,
            range: 0..0,
        };
        all.range.end = all.source.get().len();
        all
    }

    /// The bytes.
    pub fn get(&self) -> &[u8] {
        &self.source.get()[self.range.clone()]
    }

    /// The bytes in pieces of N; what is left over is dropped.
    pub fn chunks<const N: usize>(&self) -> &[[u8; N]] {
        self.get().as_chunks::<N>().0
    }

    /// The `length` bytes from `start` on, if there are as many.
    pub fn part(&self, start: u64, length: u64) -> Option<Self> {
        let end = start.checked_add(length)?;
        let whole = self.range.len() as u64;
        (end <= whole).then(|| Bytes {
            source: self.source.clone(),
            range: self.range.start + start as usize..self.range.start + end as usize,
        })
    }
}

impl Source<'_> {
    fn get(&self) -> &[u8] {
        match self {
            Source::File(bytes) => bytes,
            Source::Own(bytes) => bytes,
        }
    }
}

/// The BIN chunk with the views that had to be decompressed.
pub(crate) struct Buffers<'a> {
    bin: &'a [u8],
    /// What each view decodes to; nothing for plain views.
    decoded: Vec<Option<Bytes<'a>>>,
}

impl<'a> Buffers<'a> {
    /// The chunk, and what compressed views decode to by their numbers, nothing for plain ones, which are looked at
    /// when they are used.
    pub fn new(bin: &'a [u8], decoded: Vec<Option<Vec<u8>>>) -> Self {
        let own = |bytes| Bytes::new(Source::Own(Arc::new(bytes)));
        let decoded = decoded.into_iter().map(|bytes| bytes.map(own));
        Buffers {
            bin,
            decoded: decoded.collect(),
        }
    }

    /// The chunk without its compressed views, for the table, which is never compressed.
    pub fn plain(bin: &'a [u8]) -> Self {
        Buffers::new(bin, Vec::new())
    }

    /// The bytes of view `index`.
    ///
    /// # Errors
    /// [`Fault::Accessor`] if there is no such view, or it does not lie in the BIN chunk.
    pub fn view(&self, doc: &Document, index: usize) -> Result<Bytes<'a>> {
        if let Some(Some(bytes)) = self.decoded.get(index) {
            return Ok(bytes.clone());
        }
        let place = format!("/bufferViews/{index}");
        let Some(v) = doc.buffer_views.get(index) else {
            return fail(Fault::Accessor, place, "it does not exist");
        };
        let length = self.chunk_length(doc)?;
        let chunk = Bytes::new(Source::File(&self.bin[..length]));
        match chunk.part(v.byte_offset, v.byte_length) {
            Some(part) if v.buffer == 0 => Ok(part),
            _ => fail(
                Fault::Accessor,
                place,
                format!(
                    "{} bytes at byte {} of buffer {} do not lie in the buffer of {length} bytes",
                    v.byte_length, v.byte_offset, v.buffer
                ),
            ),
        }
    }

    /// The length of buffer 0, which is the BIN chunk.
    fn chunk_length(&self, doc: &Document) -> Result<usize> {
        let length = match doc.buffers.first() {
            Some(b) if b.uri.is_none() && doc.buffers.len() <= 2 => b.byte_length,
            _ => {
                return fail(
                    Fault::Accessor,
                    "/buffers",
                    "expected the BIN chunk, and behind it a fallback buffer at most",
                );
            }
        };
        // the chunk is padded to a multiple of 4, the buffer need not be
        if length > self.bin.len() as u64 || self.bin.len() as u64 - length > 3 {
            return fail(
                Fault::Accessor,
                "/buffers/0",
                format!(
                    "states {length} bytes, the BIN chunk has {}",
                    self.bin.len()
                ),
            );
        }
        Ok(length as usize)
    }
}
