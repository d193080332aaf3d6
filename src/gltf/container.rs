//! The container of a tile: the two chunks of a GLB, read and written, and why a tile cannot be read.

use std::fmt;

/// What kind of damage a [`ReadError`] speaks of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The GLB's headers and chunks.
    Container,
    /// The JSON chunk is not JSON, or a member has the wrong type.
    Json,
    /// Scene, nodes, meshes and primitives are not laid out as a tile's are.
    Structure,
    /// An accessor, buffer view or buffer is of the wrong type, misaligned or outside the file.
    Accessor,
    /// A compressed buffer view is not what it says, or cannot be decoded.
    Compression,
    /// A node's `extras` are missing, not flat or not whole numbers.
    Extras,
}

/// Why a tile cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadError {
    /// Kind of damage.
    pub fault: Fault,
    /// JSON pointer of the damaged member, or empty.
    pub place: String,
    /// What was found and what was expected.
    pub message: String,
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.place.is_empty() {
            f.write_str(&self.message)
        } else {
            write!(f, "{}: {}", self.place, self.message)
        }
    }
}

impl std::error::Error for ReadError {}

pub(crate) type Result<T> = std::result::Result<T, ReadError>;

pub(crate) fn fail<T>(
    fault: Fault,
    place: impl Into<String>,
    message: impl Into<String>,
) -> Result<T> {
    Err(ReadError {
        fault,
        place: place.into(),
        message: message.into(),
    })
}

/// The two chunks of a GLB.
#[derive(Debug, Clone, Copy)]
pub struct Glb<'a> {
    /// The JSON chunk, padding included.
    pub json: &'a [u8],
    /// The BIN chunk, padding included; empty if there is none.
    pub bin: &'a [u8],
}

impl<'a> Glb<'a> {
    /// Splits the bytes of a GLB (glTF 2.0, section 4) into its chunks.
    ///
    /// # Errors
    /// [`Fault::Container`] if magic, version, lengths or chunk types are not those of one JSON
    /// chunk followed by one BIN chunk that fill the file.
    pub fn split(bytes: &'a [u8]) -> Result<Self> {
        let word = |at: usize| -> Option<u32> {
            let b = bytes.get(at..at.checked_add(4)?)?;
            Some(u32::from_le_bytes(b.try_into().ok()?))
        };
        let bad = |message: String| fail(Fault::Container, "", message);
        let (Some(magic), Some(version), Some(length)) = (word(0), word(4), word(8)) else {
            return bad(format!(
                "found {} bytes, expected a GLB header of 12",
                bytes.len()
            ));
        };
        if magic != 0x4654_6C67 || version != 2 {
            return bad(format!(
                "found magic {magic:#010x} version {version}, expected glTF (0x46546c67) version 2"
            ));
        }
        if u64::from(length) != bytes.len() as u64 {
            return bad(format!(
                "the header states {length} bytes, the file has {}",
                bytes.len()
            ));
        }
        let mut at = 12;
        let mut chunk = |kind: u32, name: &str| -> Result<&'a [u8]> {
            let (Some(len), Some(found)) = (word(at), word(at + 4)) else {
                let message = format!("found the end of the file, expected a {name} chunk");
                return fail(Fault::Container, "", message);
            };
            let body = at + 8;
            let end = body.saturating_add(len as usize);
            if found != kind || len % 4 != 0 || end > bytes.len() {
                let message = format!(
                    "at byte {at}: found a chunk {found:#010x} of {len} bytes, expected a {name} \
                     chunk of a multiple of 4 bytes inside the file"
                );
                return fail(Fault::Container, "", message);
            }
            at = end;
            Ok(&bytes[body..end])
        };
        let json = chunk(0x4E4F_534A, "JSON")?;
        let bin = chunk(0x004E_4942, "BIN")?;
        if at != bytes.len() {
            return bad(format!(
                "found {} bytes after the BIN chunk, expected none",
                bytes.len() - at
            ));
        }
        Ok(Glb { json, bin })
    }
}

/// How many bytes a file has before the BIN chunk's data, with `room` for the JSON. `None` if the file would
/// pass 4 GiB.
pub(crate) fn head_bytes(room: usize, bin_bytes: u64) -> Option<usize> {
    debug_assert!(room.is_multiple_of(4) && bin_bytes.is_multiple_of(4));
    let bytes = 12 + 8 + room + 8;
    (bytes as u64 + bin_bytes <= u64::from(u32::MAX)).then_some(bytes)
}

/// The file's bytes before the BIN chunk's data: both headers and the JSON, padded with spaces to
/// `room` bytes. `None` if the JSON does not fit, or the file would pass 4 GiB.
pub(crate) fn write_head(json: &[u8], room: usize, bin_bytes: u64) -> Option<Vec<u8>> {
    let start = head_bytes(room, bin_bytes).filter(|_| json.len() <= room)?;
    let total = start as u64 + bin_bytes;
    let mut out = Vec::with_capacity(start);
    let word = |out: &mut Vec<u8>, v: u32| out.extend(v.to_le_bytes());
    out.extend(b"glTF");
    word(&mut out, 2);
    word(&mut out, total as u32);
    word(&mut out, room as u32);
    out.extend(b"JSON");
    out.extend(json);
    out.resize(20 + room, b' ');
    word(&mut out, bin_bytes as u32);
    out.extend(b"BIN\0");
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_4_gib_is_refused_before_it_is_written() {
        // 28 bytes are headers; the file's length has 32 bits
        let most = u64::from(u32::MAX) / 4 * 4 - 28 - 8;
        let head = write_head(b"{}", 8, most).expect("it fits");
        assert_eq!(head.len(), 36);
        assert_eq!(head[8..12], (most as u32 + 36).to_le_bytes());
        for more in [4, 1 << 20, 1 << 40] {
            assert!(write_head(b"{}", 8, most + more).is_none(), "{more}");
        }
    }
}
