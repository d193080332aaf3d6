//! Decoded chunks that are kept for the next box, up to a limit of their bytes: what came first leaves first.

use crate::sys::locks::lock;
use std::collections::{HashMap, VecDeque};
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard};

/// A cache holds at least this much, or the whole volume.
pub(crate) const LEAST: u64 = 16 << 20;
/// A cache holds no more, unless a single chunk is larger.
pub(crate) const MOST: u64 = 128 << 20;

/// Chunks by `K`, shared between threads.
pub(crate) struct ChunkCache<K> {
    kept: Mutex<Kept<K>>,
    budget: u64,
}

struct Kept<K> {
    chunks: HashMap<K, Arc<Vec<u8>>>,
    order: VecDeque<K>,
    bytes: u64,
}

impl<K> Default for Kept<K> {
    fn default() -> Self {
        Kept {
            chunks: HashMap::new(),
            order: VecDeque::new(),
            bytes: 0,
        }
    }
}

impl<K: Copy + Eq + Hash> ChunkCache<K> {
    /// Will hold chunks of at most `budget` bytes together.
    pub(crate) fn new(budget: u64) -> Self {
        ChunkCache {
            kept: Mutex::default(),
            budget,
        }
    }

    /// The most bytes that it holds.
    pub(crate) fn budget(&self) -> u64 {
        self.budget
    }

    fn lock(&self) -> MutexGuard<'_, Kept<K>> {
        lock(&self.kept)
    }

    /// A chunk that is there.
    pub(crate) fn get(&self, key: K) -> Option<Arc<Vec<u8>>> {
        self.lock().chunks.get(&key).cloned()
    }

    /// Keeps a chunk, if one of its size can be kept at all and no other thread was first.
    pub(crate) fn insert(&self, key: K, chunk: Arc<Vec<u8>>) {
        let len = chunk.len() as u64;
        let mut kept = self.lock();
        if len > self.budget || kept.chunks.contains_key(&key) {
            return;
        }
        kept.chunks.insert(key, chunk);
        kept.order.push_back(key);
        kept.bytes += len;
        while kept.bytes > self.budget {
            let Some(first) = kept.order.pop_front() else {
                return;
            };
            if let Some(old) = kept.chunks.remove(&first) {
                kept.bytes -= old.len() as u64;
            }
        }
    }

    /// Forgets all.
    pub(crate) fn clear(&self) {
        *self.lock() = Kept::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_came_first_leaves_first_and_the_limit_holds() {
        let cache = ChunkCache::new(10);
        let put = |key: u32, bytes: usize| cache.insert(key, Arc::new(vec![key as u8; bytes]));
        let there = || Vec::from_iter((0..6).filter(|&key| cache.get(key).is_some()));
        put(0, 4);
        put(1, 4);
        // twice, as by two threads at once: it counts once
        put(0, 4);
        put(2, 2);
        assert_eq!(there(), [0, 1, 2]);
        put(3, 1);
        assert_eq!(there(), [1, 2, 3]);
        put(4, 11);
        assert_eq!(there(), [1, 2, 3], "it is larger than the limit");
        put(5, 10);
        assert_eq!(there(), [5]);
        assert_eq!(cache.get(5).unwrap()[..], [5; 10]);
        cache.clear();
        assert!(there().is_empty());
        put(1, 10);
        assert_eq!(there(), [1], "bytes of what was forgotten do not count");
    }
}
