//! Checksums that the manifest states: of shards, of the tables, and of itself.

use super::{Layer, LayerRecord, Manifest, TableChecksums, checksum_text};
use crate::error::{Error, Result};
use crate::store::File;
use std::io::{BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// What stands for the manifest's own checksum while that is computed.
const BLANK: &str = "crc32:00000000";

impl Manifest {
    /// Writes the manifest's file, for a tile set whose tables lie in `dir`, to `out`: their checksums are taken,
    /// and the manifest's own is the last member. Its layers are those that `layers` calls with, twice, so that
    /// not all of them have to be in memory.
    ///
    /// # Errors
    /// [`Error::Io`] if a table cannot be read, or of `out`; what `layers` returns.
    pub(crate) fn seal(
        mut self,
        dir: &Path,
        layers: &mut EachLayer,
        out: &mut dyn Write,
    ) -> Result<()> {
        let of = |name: &str| {
            let path = dir.join(name);
            let failed = |e| Error::io(&path, "read back the table", e);
            checksum_of(File::open(&path).map_err(failed)?).map_err(failed)
        };
        let of_all = |[cells, objects, surfaces]: [&String; 3],
                      more: [&Option<String>; 3]|
         -> Result<TableChecksums> {
            let [components, necks, walls] = more.map(|name| name.as_deref().map(of).transpose());
            Ok(TableChecksums {
                cells: of(cells)?,
                objects: of(objects)?,
                surfaces: of(surfaces)?,
                components: components?,
                necks: necks?,
                walls: walls?,
            })
        };
        let tables = &mut self.tables;
        let csv = [&tables.cells, &tables.objects, &tables.surfaces];
        let more = [&tables.components, &tables.necks, &tables.walls];
        tables.checksums = Some(of_all(csv, more)?);
        if let Some(tables) = &mut tables.parquet {
            let parquet = [&tables.cells, &tables.objects, &tables.surfaces];
            let more = [&tables.components, &tables.necks, &tables.walls];
            tables.checksums = Some(of_all(parquet, more)?);
        }
        self.layers = Vec::new();
        self.checksum = Some(BLANK.into());
        let mut crc = crc32fast::Hasher::new();
        self.write(layers, &mut |text| {
            crc.update(text);
            Ok(())
        })?;
        self.checksum = Some(checksum_text(crc.finalize()));
        let failed = |e| Error::io(dir, "write the index", e);
        self.write(layers, &mut |text| out.write_all(text).map_err(failed))
    }

    /// Writes the file to its place in the directory `dir`; returns its bytes. See [`Manifest::seal`].
    ///
    /// # Errors
    /// [`Error::Io`]; what `layers` returns.
    pub(crate) fn write_sealed_with(self, dir: &Path, layers: &mut EachLayer) -> Result<u64> {
        let path = dir.join(super::MANIFEST);
        let failed = |e| Error::io(&path, "write", e);
        let file = std::fs::File::create(&path).map_err(|e| Error::io(&path, "create", e))?;
        let mut out = BufWriter::new(file);
        self.seal(dir, layers, &mut out)?;
        let file = out.into_inner().map_err(|e| failed(e.into_error()))?;
        Ok(file.metadata().map_err(failed)?.len())
    }

    /// Writes the text part by part, as `serde_json` prettily writes all of it, with these layers.
    fn write(
        &self,
        layers: &mut EachLayer,
        put: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let json = serde_json::to_string_pretty(self).expect("plain data serialises");
        // a text in it has no line breaks
        const LIST: &str = "\n  \"layers\": [";
        let (before, after) = json
            .split_once("\n  \"layers\": []")
            .expect("there is one list, and it is empty");
        put(before.as_bytes())?;
        put(LIST.as_bytes())?;
        let mut first = true;
        layers(&mut |layer| {
            let text = serde_json::to_string_pretty(layer).expect("plain data serialises");
            put(if first { b"\n    " } else { b",\n    " })?;
            first = false;
            put(text.replace('\n', "\n    ").as_bytes())
        })?;
        put(if first { b"]" } else { b"\n  ]" })?;
        put(after.as_bytes())?;
        put(b"\n")
    }
}

/// Calls a function with layers, by rising z.
pub(crate) type EachLayer<'a> = dyn FnMut(&mut dyn FnMut(&Layer) -> Result<()>) -> Result<()> + 'a;

impl LayerRecord {
    /// As the manifest has it.
    pub fn layer(&self) -> Layer {
        Layer {
            z: self.z,
            path: super::shard_path(self.z),
            tiles: self.tiles,
            bytes: self.bytes,
            checksum: checksum_text(self.crc),
        }
    }
}

/// The checksum that the manifest in this file should state, if it states `stated`: that of the file with the
/// eight digits of its own checksum, which come last, as zeros.
///
/// # Errors
/// The file's.
pub(crate) fn own_checksum(file: &File, stated: &str) -> std::io::Result<String> {
    let own = match stated.len() == BLANK.len() {
        true => last(file, stated.as_bytes())?,
        false => None,
    };
    let mut hasher = crc32fast::Hasher::new();
    let mut file = file;
    file.seek(SeekFrom::Start(0))?;
    if let Some(at) = own {
        hasher = hash(file.take(at), hasher)?.1;
        hasher.update(BLANK.as_bytes());
        file.seek(SeekFrom::Start(at + BLANK.len() as u64))?;
    }
    Ok(checksum_text(hash(file, hasher)?.1.finalize()))
}

/// Where a text stands last in a file.
fn last(file: &File, text: &[u8]) -> std::io::Result<Option<u64>> {
    let mut block = vec![0; BLOCK];
    let mut end = file.len()?;
    loop {
        let start = end.saturating_sub(BLOCK as u64);
        let part = &mut block[..(end - start) as usize];
        file.read_exact_at(part, start)?;
        let found = part.windows(text.len()).rposition(|w| w == text);
        match found {
            Some(at) => return Ok(Some(start + at as u64)),
            None if start == 0 => return Ok(None),
            // it may lie across
            None => end = start + text.len() as u64 - 1,
        }
    }
}

/// Bytes that are read at a time.
const BLOCK: usize = 1 << 16;

/// Adds all bytes of an input to a hash; returns how many there are, too.
fn hash(
    mut input: impl Read,
    mut hasher: crc32fast::Hasher,
) -> std::io::Result<(u64, crc32fast::Hasher)> {
    let (mut block, mut bytes) = (vec![0; BLOCK], 0);
    loop {
        match input.read(&mut block) {
            Ok(0) => return Ok((bytes, hasher)),
            Ok(n) => {
                bytes += n as u64;
                hasher.update(&block[..n]);
            }
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

/// The checksum text of a file.
///
/// # Errors
/// The file's.
pub(crate) fn checksum_of(file: File) -> std::io::Result<String> {
    sums_of(&file).map(|(_, crc)| checksum_text(crc))
}

/// Bytes and CRC-32 of what is left of a file.
///
/// # Errors
/// The file's.
pub(crate) fn sums_of(file: impl Read) -> std::io::Result<(u64, u32)> {
    let (bytes, hasher) = hash(file, crc32fast::Hasher::new())?;
    Ok((bytes, hasher.finalize()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::{ConvertOptions, convert};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;

    /// The text is that of the whole manifest, its layers among them, with its own checksum.
    #[test]
    fn a_manifest_is_written_as_if_it_were_written_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let dims = crate::grid::Dims([4, 4, 9]);
        let samples: Vec<u8> = (0..dims.voxels()).map(|i| (i * 37 % 251) as u8).collect();
        let volume = MemoryVolume::new(dims, Default::default(), samples).unwrap();
        let options = ConvertOptions {
            threshold: 100.0,
            macrocube: [2, 2, 2],
            source_name: "a \"layers\": [] \n  \"layers\": []".into(),
            ..ConvertOptions::default()
        };
        convert(&volume, &options, dir.path(), &Quiet).unwrap();
        let bytes = std::fs::read(dir.path().join(super::super::MANIFEST)).unwrap();
        let mut manifest: Manifest = serde_json::from_slice(&bytes).unwrap();
        let stated = manifest.checksum.clone().unwrap();
        let own = own_checksum(
            &File::open(dir.path().join(super::super::MANIFEST)).unwrap(),
            &stated,
        );
        assert_eq!((manifest.layers.len(), own.unwrap()), (4, stated.clone()));
        let whole = |m: &Manifest| [&serde_json::to_vec_pretty(m).unwrap()[..], b"\n"].concat();
        assert!(whole(&manifest) == bytes);
        manifest.checksum = Some(BLANK.into());
        assert_eq!(checksum_text(crc32fast::hash(&whole(&manifest))), stated);
        // none, and those of its own again
        let mut empty = manifest.clone();
        empty.layers.clear();
        for mut m in [empty, manifest] {
            m.checksum = None;
            let mut sealed = m.clone();
            let layers = std::mem::take(&mut m.layers);
            let each =
                &mut |each: &mut dyn FnMut(&Layer) -> Result<()>| layers.iter().try_for_each(each);
            let len = m.write_sealed_with(dir.path(), each).unwrap();
            let bytes = std::fs::read(dir.path().join(super::super::MANIFEST)).unwrap();
            sealed.checksum = serde_json::from_slice::<Manifest>(&bytes).unwrap().checksum;
            assert!(whole(&sealed) == bytes && bytes.len() as u64 == len);
        }
    }
}
