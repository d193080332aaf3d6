//! Checksums that the manifest states: of shards, of the tables, and of itself.

use super::{Layer, Manifest, Shard, TableChecksums, checksum_text};
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

/// What stands for the manifest's own checksum while that is computed.
const BLANK: &str = "crc32:00000000";

impl Manifest {
    /// The manifest's file, for a tile set whose tables lie in `dir`: their checksums are taken, and the
    /// manifest's own is the last member.
    ///
    /// # Errors
    /// [`Error::Io`] if a table cannot be read.
    pub fn sealed(mut self, dir: &Path) -> Result<Vec<u8>> {
        let of = |name: &str| {
            let path = dir.join(name);
            let failed = |e| Error::io(&path, "read back the table", e);
            checksum_of(File::open(&path).map_err(failed)?).map_err(failed)
        };
        self.tables.checksums = Some(TableChecksums {
            cells: of(&self.tables.cells)?,
            objects: of(&self.tables.objects)?,
            surfaces: of(&self.tables.surfaces)?,
        });
        self.checksum = Some(BLANK.into());
        let failed = |e: serde_json::Error| Error::io(dir, "write the index", e.into());
        let mut json = serde_json::to_vec_pretty(&self).map_err(failed)?;
        json.push(b'\n');
        let own = checksum_text(crc32fast::hash(&json));
        if let Some(at) = last(&json, BLANK.as_bytes()) {
            json[at..at + own.len()].copy_from_slice(own.as_bytes());
        }
        Ok(json)
    }
}

impl Shard {
    /// Writes the shard to its place in the tile set in `dir`; returns its layer's entry.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn write(&self, dir: &Path) -> Result<Layer> {
        let path = format!("index/z{:04}.json", self.z);
        let file = dir.join(&path);
        let failed = |e: std::io::Error| Error::io(&file, "write", e);
        let mut json = serde_json::to_vec(self).map_err(|e| failed(e.into()))?;
        json.push(b'\n');
        std::fs::write(&file, &json).map_err(failed)?;
        Ok(Layer {
            z: self.z,
            path,
            tiles: self.tiles.len() as u64,
            bytes: json.len() as u64,
            checksum: checksum_text(crc32fast::hash(&json)),
        })
    }
}

/// The checksum that a manifest with these bytes should state, if it states `stated`: that of the file
/// with the eight digits of its own checksum, which come last, as zeros.
pub(crate) fn own_checksum(bytes: &[u8], stated: &str) -> String {
    let mut hasher = crc32fast::Hasher::new();
    match last(bytes, stated.as_bytes()) {
        Some(at) if stated.len() == BLANK.len() => {
            hasher.update(&bytes[..at]);
            hasher.update(BLANK.as_bytes());
            hasher.update(&bytes[at + BLANK.len()..]);
        }
        _ => hasher.update(bytes),
    }
    checksum_text(hasher.finalize())
}

fn last(bytes: &[u8], text: &[u8]) -> Option<usize> {
    bytes.windows(text.len().max(1)).rposition(|w| w == text)
}

/// The checksum text of a file.
///
/// # Errors
/// The file's.
pub(crate) fn checksum_of(mut file: File) -> std::io::Result<String> {
    let mut hasher = crc32fast::Hasher::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(checksum_text(hasher.finalize())),
            Ok(n) => hasher.update(&buffer[..n]),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}
