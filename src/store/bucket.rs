//! A bucket of S3-compatible storage: each request tried again where that may help, and each answer compared with what
//! was asked for. All that is known of the client stands here; callers wait as for a disk.

use super::said::{self, Fault};
use super::settings;
use crate::sys::locks::lock;
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::path::Path as Key;
use object_store::{GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt};
use object_store::{PutMode, PutPayload};
use std::collections::HashMap;
use std::future::Future;
use std::io::{Error, ErrorKind, Result};
use std::ops::Range;
use std::sync::{Arc, LazyLock, Mutex, OnceLock};
use std::time::Duration;

/// How often a request is made before its fault is told; the pauses between double.
const TRIES: u32 = 8;
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// A bucket, and how it is reached.
pub(super) struct Bucket {
    store: Arc<dyn ObjectStore>,
    /// What must not be told.
    secrets: Vec<String>,
}

impl std::fmt::Debug for Bucket {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bucket").finish_non_exhaustive()
    }
}

/// What a store tells of an object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Known {
    pub len: u64,
    pub etag: Option<String>,
}

/// What lies directly below a key.
#[derive(Debug, Default)]
pub(super) struct Listed {
    pub objects: Vec<String>,
    pub folders: Vec<String>,
}

static BUCKETS: LazyLock<Mutex<HashMap<String, Arc<Bucket>>>> = LazyLock::new(Mutex::default);

/// Waits for what is done in threads that are started once; none before the first request.
fn wait<T>(work: impl Future<Output = T>) -> Result<T> {
    static RUNTIME: OnceLock<std::result::Result<tokio::runtime::Runtime, String>> =
        OnceLock::new();
    let runtime = RUNTIME.get_or_init(|| {
        // another part of the process may have chosen one, which serves as well
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut builder = tokio::runtime::Builder::new_multi_thread();
        let built = builder.worker_threads(2).enable_all().build();
        built.map_err(|e| e.to_string())
    });
    match runtime {
        Ok(runtime) => Ok(runtime.block_on(work)),
        Err(e) => Err(Error::other(e.clone())),
    }
}

impl Bucket {
    /// The bucket of a name, as the environment and the files of the AWS tools say that it is reached.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidInput`] for settings that cannot be.
    pub fn of(name: &str) -> Result<Arc<Bucket>> {
        let mut buckets = lock(&BUCKETS);
        if let Some(bucket) = buckets.get(name) {
            return Ok(bucket.clone());
        }
        // the client is made where its threads are
        let (store, secrets) = wait(async { settings::client(name) })??;
        let bucket = Arc::new(Bucket { store, secrets });
        buckets.insert(name.to_owned(), bucket.clone());
        Ok(bucket)
    }

    /// A bucket that a test has made.
    #[cfg(test)]
    pub fn insert(name: &str, store: Arc<dyn ObjectStore>) {
        let secrets = Vec::new();
        lock(&BUCKETS).insert(name.to_owned(), Arc::new(Bucket { store, secrets }));
    }

    /// Makes a request until it succeeds, or its fault would stay; `asked` says for what, for messages.
    fn tried<T>(
        &self,
        asked: &str,
        once: impl AsyncFn() -> std::result::Result<T, Fault>,
    ) -> Result<T> {
        let mut pause = FIRST_PAUSE;
        for tries in 1.. {
            let fault = match wait(once())? {
                Ok(done) => return Ok(done),
                Err(fault) => fault,
            };
            if tries == TRIES || !fault.may_pass() {
                return Err(said::error(&fault, asked, tries, &self.secrets));
            }
            // many that failed at once do not come back at once
            let some = getrandom::u32().unwrap_or(0) % 128;
            std::thread::sleep(pause * (128 + some) / 256);
            pause *= 2;
        }
        unreachable!("the last try returns")
    }

    /// Bytes of an object, and what is known of it. It must have the ETag, if one is given; `range` may reach beyond its
    /// end where `clipped` is set.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`]; an answer of another length or another object, however often it is asked for.
    pub fn range(
        &self,
        key: &str,
        range: &Range<u64>,
        etag: Option<&str>,
        clipped: bool,
    ) -> Result<(Known, Bytes)> {
        let key = parsed(key)?;
        let asked = format!("bytes {} to {}", range.start, range.end);
        self.tried(&asked, async || {
            let options = GetOptions {
                range: Some(GetRange::Bounded(range.clone())),
                if_match: etag.map(str::to_owned),
                ..GetOptions::default()
            };
            let answer = self.store.get_opts(&key, options).await?;
            let known = known(&answer.meta);
            // a store that ignores the condition
            if etag.is_some() && known.etag.as_deref() != etag {
                return Err(Fault::Changed);
            }
            let end = if clipped {
                range.end.min(known.len)
            } else {
                range.end
            };
            let bytes = answer.bytes().await?;
            let expected = end.saturating_sub(range.start);
            match bytes.len() as u64 == expected {
                true => Ok((known, bytes)),
                false => Err(Fault::Length {
                    found: bytes.len() as u64,
                    expected,
                }),
            }
        })
    }

    /// Several stretches of an object, fetched at once, one behind the other into `out`.
    ///
    /// # Errors
    /// As of [`Bucket::range`].
    pub fn ranges(
        &self,
        key: &str,
        start: u64,
        piece: usize,
        etag: Option<&str>,
        out: &mut [u8],
    ) -> Result<()> {
        std::thread::scope(|scope| {
            let pieces = (0u64..).zip(out.chunks_mut(piece));
            let mut pieces = pieces.map(|(i, out)| (start + i * piece as u64, out));
            let fetch = |(at, out): (u64, &mut [u8])| {
                let (_, bytes) = self.range(key, &(at..at + out.len() as u64), etag, false)?;
                out.copy_from_slice(&bytes);
                Ok(())
            };
            // this thread fetches the first
            let first = pieces.next();
            let others: Vec<_> = pieces.map(|p| scope.spawn(move || fetch(p))).collect();
            let first = first.map_or(Ok(()), fetch);
            let done = others
                .into_iter()
                .map(|o| o.join().expect("it does not panic"));
            done.fold(first, |all, one| all.and(one))
        })
    }

    /// What is known of an object.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`]; what the store answers.
    pub fn head(&self, key: &str) -> Result<Known> {
        let key = parsed(key)?;
        let meta = self.tried("its size", async || Ok(self.store.head(&key).await?))?;
        Ok(known(&meta))
    }

    /// What lies directly below a key, or in the bucket for an empty one.
    ///
    /// # Errors
    /// What the store answers.
    pub fn list(&self, key: &str) -> Result<Listed> {
        let prefix = parsed(key)?;
        let all = self.tried("what lies below", async || {
            Ok(self.store.list_with_delimiter(Some(&prefix)).await?)
        })?;
        let name = |key: &Key| key.filename().unwrap_or_default().to_owned();
        Ok(Listed {
            objects: all.objects.iter().map(|o| name(&o.location)).collect(),
            folders: all.common_prefixes.iter().map(name).collect(),
        })
    }

    /// Calls `each` with all objects below a key.
    ///
    /// # Errors
    /// What the store answers.
    pub fn list_all(&self, key: &str, each: &mut dyn FnMut(&str, Known)) -> Result<()> {
        let prefix = parsed(key)?;
        let all: Vec<ObjectMeta> = self.tried("what lies below", async || {
            Ok(self.store.list(Some(&prefix)).try_collect().await?)
        })?;
        all.iter().for_each(|o| each(o.location.as_ref(), known(o)));
        Ok(())
    }

    /// Puts an object where there is none; false if there is one. A request whose answer was lost, and which is made
    /// again, may find its own.
    ///
    /// # Errors
    /// What the store answers.
    pub fn put_new(&self, key: &str, bytes: Bytes) -> Result<bool> {
        let key = parsed(key)?;
        let asked = format!("to put {} bytes", bytes.len());
        let put = self.tried(&asked, async || {
            let payload = PutPayload::from_bytes(bytes.clone());
            Ok(self
                .store
                .put_opts(&key, payload, PutMode::Create.into())
                .await?)
        });
        match put {
            Ok(_) => Ok(true),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
            Err(e) => Err(e),
        }
    }

    /// Puts an object in parts, whose bytes `next` gives until there are none. What is there is replaced.
    ///
    /// # Errors
    /// What `next` returns, and the store; then there is no object.
    pub fn put_parts(&self, key: &str, next: &mut dyn FnMut() -> Result<Bytes>) -> Result<()> {
        let key = parsed(key)?;
        let begun = self.tried("to put parts", async || {
            Ok(self.store.put_multipart(&key).await?)
        })?;
        let mut parts = begun;
        loop {
            let bytes = next()?;
            if bytes.is_empty() {
                break;
            }
            // a part that fails is the upload's end: the client tries none again by itself
            let put = wait(parts.put_part(PutPayload::from_bytes(bytes)))?;
            if let Err(e) = put {
                let _ = wait(parts.abort());
                return Err(said::error(&e.into(), "to put a part", 1, &self.secrets));
            }
        }
        let ended = wait(parts.complete())?;
        ended
            .map(|_| ())
            .map_err(|e| said::error(&e.into(), "to end its parts", 1, &self.secrets))
    }

    /// Removes an object.
    ///
    /// # Errors
    /// What the store answers.
    pub fn delete(&self, key: &str) -> Result<()> {
        let key = parsed(key)?;
        self.tried("to remove it", async || Ok(self.store.delete(&key).await?))
    }
}

fn known(meta: &ObjectMeta) -> Known {
    Known {
        len: meta.size,
        etag: meta.e_tag.clone(),
    }
}

fn parsed(key: &str) -> Result<Key> {
    Key::parse(key).map_err(|e| Error::new(ErrorKind::InvalidInput, e.to_string()))
}
