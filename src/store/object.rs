//! Objects in buckets, read as files are: a few blocks are kept, longer stretches are fetched in pieces at once.

use super::bucket::{Bucket, Known};
use super::place::Place;
use super::{Entry, Meta, Stamped};
use crate::sys::locks::lock;
use bytes::Bytes;
use std::collections::VecDeque;
use std::io::{Error, ErrorKind, Read, Result};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Short reads fetch an aligned block of this size, of which this many are kept.
const BLOCK: u64 = 1 << 20;
const KEPT: usize = 4;
/// Long reads are cut into pieces of this size, which are fetched at once.
const PIECE: usize = 2 << 20;
/// Longer files are put in parts of this size.
const PART: u64 = 32 << 20;

/// An object that is open for reading.
#[derive(Debug)]
pub(crate) struct Object {
    bucket: Arc<Bucket>,
    key: String,
    known: Known,
    /// Blocks that were read last, by their number; none are kept if few parts are read.
    blocks: Option<Mutex<VecDeque<(u64, Bytes)>>>,
}

/// The bytes of a block of an object of `len` bytes.
fn block_range(number: u64, len: u64) -> Range<u64> {
    let start = number * BLOCK;
    start..(start + BLOCK).min(len)
}

impl Object {
    /// Opens an object; its first block comes with the answer.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`]; what the store answers.
    pub fn open(path: &Path) -> Result<Self> {
        let (bucket, key) = bucket(path)?;
        let (known, first) = match bucket.range(&key, &(0..BLOCK), None, true) {
            Ok((known, first)) => (known, Some(first)),
            // of an object without bytes no range can be had
            Err(e) if e.kind() != ErrorKind::NotFound => match bucket.head(&key)? {
                known if known.len == 0 => (known, None),
                _ => return Err(e),
            },
            Err(e) => return Err(e),
        };
        let blocks = first.map(|first| (0, first)).into_iter().collect();
        let blocks = Some(Mutex::new(blocks));
        Ok(Object {
            bucket,
            key,
            known,
            blocks,
        })
    }

    /// Opens an object of which few parts are read, each once.
    ///
    /// # Errors
    /// As of [`Object::open`].
    pub fn open_for_parts(path: &Path) -> Result<Self> {
        let (bucket, key) = bucket(path)?;
        let known = bucket.head(&key)?;
        Ok(Object {
            bucket,
            key,
            known,
            blocks: None,
        })
    }

    /// Bytes of it.
    pub fn len(&self) -> u64 {
        self.known.len
    }

    /// Fills `out` from byte `position` on; all of it lies in the object.
    ///
    /// # Errors
    /// What the store answers; another object in its place.
    pub fn read(&self, position: u64, out: &mut [u8]) -> Result<()> {
        let Some(blocks) = &self.blocks else {
            return self.fetch(position, out);
        };
        let mut done = 0;
        while done < out.len() {
            let at = position + done as u64;
            let number = at / BLOCK;
            let left = out.len() - done;
            let block = match self.kept(blocks, number) {
                Some(block) => block,
                None if left as u64 >= BLOCK => return self.fetch(at, &mut out[done..]),
                None => {
                    let range = block_range(number, self.known.len);
                    let (_, block) = self.bucket.range(&self.key, &range, self.etag(), false)?;
                    keep(blocks, number, block.clone());
                    block
                }
            };
            let inside = &block[(at % BLOCK) as usize..];
            let count = inside.len().min(left);
            out[done..done + count].copy_from_slice(&inside[..count]);
            done += count;
        }
        Ok(())
    }

    fn fetch(&self, position: u64, out: &mut [u8]) -> Result<()> {
        self.bucket
            .ranges(&self.key, position, PIECE, self.etag(), out)
    }

    fn etag(&self) -> Option<&str> {
        self.known.etag.as_deref()
    }

    fn kept(&self, blocks: &Mutex<VecDeque<(u64, Bytes)>>, number: u64) -> Option<Bytes> {
        let blocks = lock(blocks);
        let found = blocks.iter().find(|(n, _)| *n == number);
        found.map(|(_, block)| block.clone())
    }
}

/// Keeps a block; the one that was kept first goes.
fn keep(blocks: &Mutex<VecDeque<(u64, Bytes)>>, number: u64, block: Bytes) {
    let mut blocks = lock(blocks);
    if blocks.iter().all(|(n, _)| *n != number) {
        blocks.push_back((number, block));
    }
    if blocks.len() > KEPT {
        blocks.pop_front();
    }
}

/// The bucket that a path names, and the key.
fn bucket(path: &Path) -> Result<(Arc<Bucket>, String)> {
    let place = Place::of(path)?;
    Ok((Bucket::of(place.bucket)?, place.key.to_owned()))
}

/// Looks at a path: an object, or what keys begin with.
pub(super) fn metadata(path: &Path) -> Result<Meta> {
    let (bucket, key) = bucket(path)?;
    let found = match key.is_empty() {
        true => Err(ErrorKind::NotFound.into()),
        false => bucket.head(&key),
    };
    match found {
        Ok(known) => Ok(Meta {
            len: known.len,
            is_file: true,
            is_dir: false,
        }),
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let below = bucket.list(&key)?;
            match below.objects.is_empty() && below.folders.is_empty() && !key.is_empty() {
                true => Err(e),
                false => Ok(Meta {
                    len: 0,
                    is_file: false,
                    is_dir: true,
                }),
            }
        }
        Err(e) => Err(e),
    }
}

/// True for an object that is there.
pub(super) fn is_object(path: &Path) -> bool {
    bucket(path).is_ok_and(|(bucket, key)| bucket.head(&key).is_ok())
}

/// What lies directly below a path.
pub(super) fn list(path: &Path) -> Result<Vec<Entry>> {
    let (bucket, key) = bucket(path)?;
    let listed = bucket.list(&key)?;
    if listed.objects.is_empty() && listed.folders.is_empty() {
        return Err(Error::new(ErrorKind::NotFound, "no object lies below"));
    }
    let entry = |is_file: bool| {
        move |name: String| Entry {
            name: name.into(),
            is_file,
            is_dir: !is_file,
            is_link: false,
        }
    };
    let files = listed.objects.into_iter().map(entry(true));
    Ok(files
        .chain(listed.folders.into_iter().map(entry(false)))
        .collect())
}

/// The object at a path, or all below it.
pub(super) fn stamps(path: &Path) -> Result<Vec<Stamped>> {
    let (bucket, key) = bucket(path)?;
    let stamped = |key: &str, known: Known| Stamped {
        path: key.to_owned(),
        bytes: known.len,
        etag: known.etag.unwrap_or_default(),
    };
    match bucket.head(&key) {
        Ok(known) => return Ok(vec![stamped(&key, known)]),
        Err(e) if e.kind() == ErrorKind::NotFound => {}
        Err(e) => return Err(e),
    }
    let mut all = Vec::new();
    bucket.list_all(&key, &mut |key, known| all.push(stamped(key, known)))?;
    match all.is_empty() {
        true => Err(Error::new(
            ErrorKind::NotFound,
            "there is no such object, and none below",
        )),
        false => Ok(all),
    }
}

/// Puts a file where there is no object yet. True if it was put; false if an object of the same bytes is there.
///
/// # Errors
/// [`ErrorKind::AlreadyExists`] if another one is there; what the store answers.
pub(super) fn put_file(file: &Path, to: &Path) -> Result<bool> {
    let (bucket, key) = bucket(to)?;
    let mut local = std::fs::File::open(file)?;
    let len = local.metadata()?.len();
    let put = match len <= PART {
        true => {
            let mut bytes = Vec::with_capacity(len as usize);
            local.read_to_end(&mut bytes)?;
            bucket.put_new(&key, bytes.into())?
        }
        false => match bucket.head(&key) {
            Ok(_) => false,
            Err(e) if e.kind() == ErrorKind::NotFound => {
                bucket.put_parts(&key, &mut || {
                    let mut part = Vec::new();
                    (&mut local).take(PART).read_to_end(&mut part)?;
                    Ok(part.into())
                })?;
                true
            }
            Err(e) => return Err(e),
        },
    };
    if !put && !is_same(file, to)? {
        let text = "another object is there, which is not replaced";
        return Err(Error::new(ErrorKind::AlreadyExists, text));
    }
    Ok(put)
}

/// True if a file and an object have the same bytes.
fn is_same(file: &Path, path: &Path) -> Result<bool> {
    let mut local = std::fs::File::open(file)?;
    let object = Object::open(path)?;
    if local.metadata()?.len() != object.len() {
        return Ok(false);
    }
    let (mut ours, mut theirs) = (vec![0; PIECE], vec![0; PIECE]);
    let mut at = 0;
    while at < object.len() {
        let count = (object.len() - at).min(PIECE as u64) as usize;
        local.read_exact(&mut ours[..count])?;
        object.read(at, &mut theirs[..count])?;
        if ours[..count] != theirs[..count] {
            return Ok(false);
        }
        at += count as u64;
    }
    Ok(true)
}

/// True if the store keeps what it promises of conditions: a small object below `dir` is put twice where there is none,
/// and the second time must be refused.
///
/// # Errors
/// What the store answers.
pub(super) fn probe(dir: &Path) -> Result<bool> {
    let name = format!(
        ".alvis-probe-{:016x}",
        getrandom::u64().map_err(Error::other)?
    );
    let (bucket, key) = bucket(&dir.join(name))?;
    bucket.put_new(&key, Bytes::from_static(b"first"))?;
    let again = bucket.put_new(&key, Bytes::from_static(b"second"));
    bucket.delete(&key)?;
    Ok(!again?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{self, File};
    use object_store::memory::InMemory;
    use object_store::{ObjectStoreExt, PutPayload};
    use std::io::{Seek, SeekFrom};

    /// A bucket in memory, and what waits for it.
    fn memory(name: &str) -> (Arc<InMemory>, tokio::runtime::Runtime) {
        let store = Arc::new(InMemory::new());
        Bucket::insert(name, store.clone());
        let runtime = tokio::runtime::Builder::new_current_thread().build();
        (store, runtime.unwrap())
    }

    fn bytes(len: u64) -> Vec<u8> {
        (0..len).map(|i| (i * 7 + i / 1000) as u8).collect()
    }

    fn put((store, runtime): &(Arc<InMemory>, tokio::runtime::Runtime), key: &str, bytes: Vec<u8>) {
        let payload = PutPayload::from(bytes);
        runtime.block_on(store.put(&key.into(), payload)).unwrap();
    }

    #[test]
    fn reads_of_any_place_and_length_give_the_bytes() {
        let memory = memory("reads");
        let all = bytes(5 * BLOCK + 123);
        put(&memory, "a/b.raw", all.clone());
        let path = Path::new("s3://reads/a/b.raw");
        let len = all.len() as u64;
        let starts = [
            0,
            1,
            BLOCK - 1,
            BLOCK,
            BLOCK + 5,
            3 * BLOCK - 7,
            len - 1,
            len,
        ];
        let lengths = [0, 1, 7, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK + 9, len];
        for for_parts in [false, true] {
            let file = match for_parts {
                true => File::open_for_parts(path).unwrap(),
                false => File::open(path).unwrap(),
            };
            assert_eq!(file.len().unwrap(), len);
            for (start, length) in starts
                .iter()
                .flat_map(|s| lengths.iter().map(move |n| (*s, *n)))
            {
                let mut out = vec![0; length as usize];
                let read = file.read_exact_at(&mut out, start);
                match start + length <= len {
                    true => {
                        assert!(read.is_ok() && out == all[start as usize..][..length as usize])
                    }
                    false => assert_eq!(read.unwrap_err().kind(), ErrorKind::UnexpectedEof),
                }
                let there = (len - start).min(length) as usize;
                assert_eq!(file.read_at(&mut out, start).unwrap(), there);
                assert_eq!(out[..there], all[start as usize..][..there]);
            }
        }
        let (mut file, mut read) = (File::open(path).unwrap(), Vec::new());
        file.read_to_end(&mut read).unwrap();
        assert!(read == all);
        file.seek(SeekFrom::End(-9)).unwrap();
        read.clear();
        file.read_to_end(&mut read).unwrap();
        assert_eq!(read, all[all.len() - 9..]);
        assert_eq!(store::read(path).unwrap(), all);
    }

    #[test]
    fn blocks_end_with_the_object() {
        assert_eq!(block_range(0, 10), 0..10);
        assert_eq!(block_range(1, 2 * BLOCK), BLOCK..2 * BLOCK);
        assert_eq!(block_range(2, 2 * BLOCK + 1), 2 * BLOCK..2 * BLOCK + 1);
    }

    #[test]
    fn another_object_in_its_place_is_an_error() {
        let memory = memory("changed");
        put(&memory, "a", bytes(3 * BLOCK));
        let file = File::open("s3://changed/a").unwrap();
        put(&memory, "a", vec![1; 3 << 20]);
        let mut out = vec![0; 10];
        // what came when it was opened
        file.read_exact_at(&mut out, 0).unwrap();
        for at in [BLOCK, 2 * BLOCK - 5] {
            let told = file.read_exact_at(&mut out, at).unwrap_err().to_string();
            assert!(told.contains("another object"), "{told}");
        }
    }

    #[test]
    fn folders_are_what_keys_begin_with() {
        let memory = memory("folders");
        for key in ["a/b/c", "a/b/d/e", "a/f"] {
            put(&memory, key, vec![1, 2, 3]);
        }
        let meta = |path: &str| store::metadata(Path::new(path)).map_err(|e| e.kind());
        let folder = Ok(Meta {
            len: 0,
            is_file: false,
            is_dir: true,
        });
        assert_eq!(meta("s3://folders/a"), folder);
        assert_eq!(meta("s3://folders"), folder);
        assert_eq!(
            meta("s3://folders/a/f"),
            Ok(Meta {
                len: 3,
                is_file: true,
                is_dir: false
            })
        );
        assert_eq!(meta("s3://folders/a/b/x"), Err(ErrorKind::NotFound));
        let names = store::list(Path::new("s3://folders/a/b")).unwrap();
        let mut names: Vec<_> = names
            .map(|e| e.map(|e| (e.name, e.is_dir)).unwrap())
            .collect();
        names.sort();
        assert_eq!(names, [("c".into(), false), ("d".into(), true)]);
        let stamps = store::stamps(Path::new("s3://folders/a")).unwrap();
        assert_eq!(stamps.iter().map(|s| s.bytes).sum::<u64>(), 9);
    }

    #[test]
    fn objects_are_put_once() {
        memory("puts");
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        assert!(probe(Path::new("s3://puts/set")).unwrap());
        // in one request, and in parts
        for (key, len) in [("small", 1000), ("large", PART + 5)] {
            let to = Path::new("s3://puts/set").join(key);
            std::fs::write(&file, bytes(len)).unwrap();
            assert!(put_file(&file, &to).unwrap());
            assert!(!put_file(&file, &to).unwrap(), "it is there, and the same");
            std::fs::write(&file, vec![9; len as usize]).unwrap();
            assert_eq!(
                put_file(&file, &to).unwrap_err().kind(),
                ErrorKind::AlreadyExists
            );
            assert_eq!(store::read(&to).unwrap(), bytes(len));
        }
        assert_eq!(
            store::list(Path::new("s3://puts/set")).unwrap().count(),
            2,
            "no probe is left"
        );
    }
}
