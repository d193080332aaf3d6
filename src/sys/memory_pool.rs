//! The promise of `--memory`: large buffers are reserved before they are made. One pool has all bytes of the limit;
//! consumers, each with a name, take from it and give back. Where it has too little left, the error says who has what.

use crate::error::{Error, MemoryUse, Result};
use crate::sys::locks::lock;
use std::sync::{Arc, Mutex};

/// A part of some bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    parts: u64,
    of: u64,
}

impl Share {
    /// So many `parts`, each of them one of `of` equal ones.
    pub const fn new(parts: u64, of: u64) -> Self {
        assert!(parts <= of && of > 0);
        Share { parts, of }
    }

    /// This part of `bytes`, a little less where they cannot be cut.
    pub const fn of(self, bytes: u64) -> u64 {
        bytes / self.of * self.parts
    }

    /// How many bytes there must be, so that `rest` are left without this part.
    pub fn with_rest(self, rest: u64) -> u64 {
        (rest as f64 * self.of as f64 / (self.of - self.parts) as f64).ceil() as u64
    }
}

/// Bytes that may be used and bytes that are.
#[derive(Debug)]
pub struct MemoryPool {
    limit: u64,
    used: Mutex<Used>,
}

#[derive(Debug, Default)]
struct Used {
    bytes: u64,
    /// By whom, in the order in which they came.
    by: Vec<MemoryUse>,
}

impl Used {
    fn of(&mut self, consumer: &'static str) -> &mut u64 {
        let at = self.by.iter().position(|held| held.by == consumer);
        let at = at.unwrap_or_else(|| {
            self.by.push(MemoryUse {
                by: consumer,
                bytes: 0,
            });
            self.by.len() - 1
        });
        &mut self.by[at].bytes
    }
}

impl MemoryPool {
    /// A pool of `limit` bytes, of which `consumer` uses `fixed` for good.
    pub fn new(limit: u64, consumer: &'static str, fixed: u64) -> Arc<Self> {
        let mut used = Used::default();
        *used.of(consumer) = fixed;
        used.bytes = fixed;
        Arc::new(MemoryPool {
            limit,
            used: Mutex::new(used),
        })
    }

    /// Bytes of the limit.
    pub fn limit(&self) -> u64 {
        self.limit
    }

    /// Bytes that can be taken.
    pub fn left(&self) -> u64 {
        self.limit.saturating_sub(lock(&self.used).bytes)
    }

    /// Takes `bytes` for a consumer.
    ///
    /// # Errors
    /// [`Error::TooDense`] if there are not as many left; nothing is taken then.
    fn take(&self, consumer: &'static str, bytes: u64) -> Result<()> {
        let mut used = lock(&self.used);
        let sum = used.bytes.saturating_add(bytes);
        if sum > self.limit {
            let held = *used.of(consumer);
            let mut uses = used.by.clone();
            drop(used);
            for each in uses.iter_mut().filter(|each| each.by == consumer) {
                each.bytes = held.saturating_add(bytes);
            }
            return Err(Error::TooDense {
                limit: self.limit,
                needed: sum,
                uses,
            });
        }
        used.bytes = sum;
        *used.of(consumer) += bytes;
        Ok(())
    }

    fn give_back(&self, consumer: &'static str, bytes: u64) {
        let mut used = lock(&self.used);
        used.bytes -= bytes;
        *used.of(consumer) -= bytes;
    }
}

/// Bytes that a consumer has taken from a pool until this is dropped.
#[derive(Debug, Default)]
pub struct MemoryReservation {
    taken: Option<Taken>,
    bytes: u64,
}

/// By whom, and where from.
#[derive(Debug)]
struct Taken {
    pool: Arc<MemoryPool>,
    consumer: &'static str,
}

impl MemoryReservation {
    /// Nothing yet.
    pub fn new(pool: &Arc<MemoryPool>, consumer: &'static str) -> Self {
        MemoryReservation {
            taken: Some(Taken {
                pool: pool.clone(),
                consumer,
            }),
            bytes: 0,
        }
    }

    /// Takes what is missing to `bytes`; takes nothing back, as buffers that are reused keep their
    /// size.
    ///
    /// # Errors
    /// [`Error::TooDense`] if the pool has not enough left; nothing is taken then.
    pub fn grow_to(&mut self, bytes: u64) -> Result<()> {
        let Some(Taken { pool, consumer }) = &self.taken else {
            return Ok(());
        };
        if bytes > self.bytes {
            pool.take(consumer, bytes - self.bytes)?;
            self.bytes = bytes;
        }
        Ok(())
    }

    /// Takes what is missing to `bytes`, or what is left if that is less.
    pub fn grow_as_far_as(&mut self, bytes: u64) {
        let left = self.taken.as_ref().map_or(0, |taken| taken.pool.left());
        let most = self.bytes.saturating_add(left);
        // if others take some of it meanwhile, this has nothing
        let _ = self.grow_to(bytes.min(most));
    }

    /// Gives back what is beyond `bytes`, after the buffers have been freed.
    pub fn shrink_to(&mut self, bytes: u64) {
        if let Some(Taken { pool, consumer }) = &self.taken
            && bytes < self.bytes
        {
            pool.give_back(consumer, self.bytes - bytes);
            self.bytes = bytes;
        }
    }

    /// Bytes taken.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl Drop for MemoryReservation {
    fn drop(&mut self) {
        self.shrink_to(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_can_be_taken_again() {
        let pool = MemoryPool::new(100, "program", 10);
        let mut a = MemoryReservation::new(&pool, "a");
        a.grow_to(60).unwrap();
        a.grow_to(50).unwrap();
        let mut b = MemoryReservation::new(&pool, "b");
        b.grow_to(30).unwrap();
        drop(a);
        b.grow_to(90).unwrap();
        assert_eq!((b.bytes(), pool.left()), (90, 0));
        let mut c = MemoryReservation::new(&pool, "c");
        assert!(c.grow_to(20).is_err());
        b.shrink_to(70);
        b.shrink_to(80);
        assert_eq!(pool.left(), 20);
        c.grow_to(20).unwrap();
        assert!(c.grow_to(21).is_err());
        assert!(b.grow_to(u64::MAX).is_err());
        b.shrink_to(40);
        c.grow_as_far_as(200);
        assert_eq!((c.bytes(), pool.left()), (50, 0));
    }

    #[test]
    fn the_error_says_who_has_what_and_wants_more() {
        let pool = MemoryPool::new(100, "program", 10);
        let [mut a, mut b, mut c] =
            ["tiles", "bands", "tiles"].map(|by| MemoryReservation::new(&pool, by));
        a.grow_to(40).unwrap();
        b.grow_to(20).unwrap();
        match c.grow_to(31) {
            Err(Error::TooDense {
                limit: 100,
                needed: 101,
                uses,
            }) => {
                let uses: Vec<_> = uses.iter().map(|u| (u.by, u.bytes)).collect();
                assert_eq!(uses, [("program", 10), ("tiles", 71), ("bands", 20)]);
            }
            other => panic!("{other:?}"),
        }
        c.grow_to(30).unwrap();
    }

    #[test]
    fn shares_are_cut_and_made_whole() {
        let share = Share::new(1, 8);
        assert_eq!(
            (share.of(80), share.of(79), Share::new(3, 4).of(10)),
            (10, 9, 6)
        );
        assert_eq!(share.with_rest(70), 80);
        for rest in 0..100 {
            let bytes = share.with_rest(rest);
            assert!(bytes - share.of(bytes) >= rest);
        }
    }
}
