//! Chunks that are fetched before anybody asks for them, up to a limit: what lies far away comes late.

use crate::error::Result;
use crate::sys::locks::{lock, wait};
use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex};

/// A chunk that somebody fetches, or that has come and nobody has taken.
enum Chunk {
    Fetching,
    Here(Result<Vec<u8>>),
}

/// Chunks by their place, each fetched by one thread at a time.
pub(crate) struct Ahead {
    chunks: Mutex<HashMap<[u32; 3], Chunk>>,
    changed: Condvar,
    /// No more are fetched or kept at a time, but for those that are waited for.
    most: usize,
}

/// Who fetches a chunk itself: others that ask for it wait until it is dropped.
pub(crate) struct Turn<'a> {
    ahead: &'a Ahead,
    index: [u32; 3],
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        lock(&self.ahead.chunks).remove(&self.index);
        self.ahead.changed.notify_all();
    }
}

impl Ahead {
    pub(crate) fn new(most: usize) -> Self {
        Ahead {
            chunks: Mutex::default(),
            changed: Condvar::new(),
            most,
        }
    }

    /// A chunk that was fetched ahead, waited for if it is on its way; or the turn to fetch it.
    ///
    /// # Errors
    /// Those of whoever fetched it.
    pub(crate) fn take(&self, index: [u32; 3]) -> std::result::Result<Result<Vec<u8>>, Turn<'_>> {
        let mut chunks = lock(&self.chunks);
        loop {
            match chunks.remove(&index) {
                Some(Chunk::Here(chunk)) => return Ok(chunk),
                Some(Chunk::Fetching) => {
                    chunks.insert(index, Chunk::Fetching);
                    chunks = wait(&self.changed, chunks);
                }
                None => {
                    chunks.insert(index, Chunk::Fetching);
                    return Err(Turn { ahead: self, index });
                }
            }
        }
    }

    /// Begins to fetch a chunk in a thread of its own, if nobody does and there is room; those that lie behind `swept` slices
    /// of chunks are dropped, for nobody has taken them.
    pub(crate) fn begin(
        self: &Arc<Self>,
        index: [u32; 3],
        swept: u32,
        fetch: impl FnOnce() -> Result<Vec<u8>> + Send + 'static,
    ) {
        let mut chunks = lock(&self.chunks);
        chunks.retain(|at, chunk| matches!(chunk, Chunk::Fetching) || at[2] >= swept);
        if chunks.len() >= self.most || chunks.contains_key(&index) {
            return;
        }
        chunks.insert(index, Chunk::Fetching);
        drop(chunks);
        let ahead = self.clone();
        let fetch = move || {
            let chunk = fetch();
            lock(&ahead.chunks).insert(index, Chunk::Here(chunk));
            ahead.changed.notify_all();
        };
        let thread = std::thread::Builder::new().name("fetch ahead".into());
        if thread.spawn(fetch).is_err() {
            // whoever needs it fetches it
            drop(Turn { ahead: self, index });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    #[test]
    fn what_is_fetched_ahead_is_taken_once_and_no_more_than_the_limit() {
        let ahead = Arc::new(Ahead::new(2));
        for k in 0..3 {
            ahead.begin([0, 0, k], 0, move || Ok(vec![k as u8]));
        }
        let taken = |k| match ahead.take([0, 0, k]) {
            Ok(chunk) => chunk.ok(),
            Err(_turn) => None,
        };
        assert_eq!(taken(1), Some(vec![1]));
        assert_eq!([taken(0), taken(0)], [Some(vec![0]), None]);
        assert_eq!(taken(2), None, "there was no room");
        ahead.begin([0, 0, 3], 3, || Err(Error::Interrupted));
        let told = ahead.take([0, 0, 3]).ok().unwrap();
        assert!(matches!(told, Err(Error::Interrupted)));
        // what nobody takes makes room
        ahead.begin([0, 0, 4], 4, || Ok(vec![4]));
        ahead.begin([0, 1, 4], 4, || Ok(vec![4]));
        drop(
            (0..2)
                .map(|j| while_fetching(&ahead, [0, j, 4]))
                .collect::<Vec<_>>(),
        );
        ahead.begin([0, 0, 9], 9, || Ok(vec![9]));
        assert_eq!(taken(9), Some(vec![9]));
    }

    /// Waits until a chunk has come.
    fn while_fetching(ahead: &Ahead, index: [u32; 3]) {
        let mut chunks = lock(&ahead.chunks);
        while matches!(chunks.get(&index), Some(Chunk::Fetching)) {
            chunks = wait(&ahead.changed, chunks);
        }
    }

    #[test]
    fn one_thread_fetches_and_others_wait() {
        let ahead = Ahead::new(1);
        let turn = ahead.take([0; 3]).err().unwrap();
        std::thread::scope(|scope| {
            let other = scope.spawn(|| ahead.take([0; 3]).is_err());
            std::thread::yield_now();
            drop(turn);
            assert!(other.join().unwrap(), "it is the other's turn");
        });
    }
}
