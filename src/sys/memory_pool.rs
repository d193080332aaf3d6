//! The promise of `--memory`: large buffers are reserved before they are made.

use crate::error::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that may be used and bytes that are.
#[derive(Debug)]
pub struct MemoryPool {
    limit: u64,
    used: AtomicU64,
}

impl MemoryPool {
    /// A budget of `limit` bytes, of which `fixed` are used for good.
    pub fn new(limit: u64, fixed: u64) -> Arc<Self> {
        Arc::new(MemoryPool {
            limit,
            used: AtomicU64::new(fixed),
        })
    }

    /// Bytes that can be taken.
    pub fn left(&self) -> u64 {
        self.limit.saturating_sub(self.used.load(Ordering::Relaxed))
    }

    fn take(&self, bytes: u64) -> Result<()> {
        let fits = |used: u64| used.checked_add(bytes).filter(|&sum| sum <= self.limit);
        self.used
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, fits)
            .map(|_| ())
            .map_err(|used| Error::TooDense {
                limit: self.limit,
                needed: used.saturating_add(bytes),
            })
    }
}

/// Bytes taken from a budget until this is dropped.
#[derive(Debug, Default)]
pub struct MemoryReservation {
    budget: Option<Arc<MemoryPool>>,
    bytes: u64,
}

impl MemoryReservation {
    /// Nothing yet.
    pub fn new(budget: &Arc<MemoryPool>) -> Self {
        MemoryReservation {
            budget: Some(budget.clone()),
            bytes: 0,
        }
    }

    /// Takes what is missing to `bytes`; takes nothing back, as buffers that are reused keep their
    /// size.
    ///
    /// # Errors
    /// [`Error::TooDense`] if the budget has not enough left; nothing is taken then.
    pub fn grow_to(&mut self, bytes: u64) -> Result<()> {
        let Some(budget) = &self.budget else {
            return Ok(());
        };
        if bytes > self.bytes {
            budget.take(bytes - self.bytes)?;
            self.bytes = bytes;
        }
        Ok(())
    }

    /// Bytes that it has, and half of what it could take: others may need the rest.
    pub fn at_hand(&self) -> u64 {
        let left = self.budget.as_ref().map_or(u64::MAX, |b| b.left());
        self.bytes.saturating_add(left / 2)
    }

    /// Gives back what is beyond `bytes`, after the buffers have been freed.
    pub fn shrink_to(&mut self, bytes: u64) {
        if let Some(budget) = &self.budget
            && bytes < self.bytes
        {
            budget.used.fetch_sub(self.bytes - bytes, Ordering::Relaxed);
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
        if let Some(budget) = &self.budget {
            budget.used.fetch_sub(self.bytes, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_can_be_taken_again() {
        let budget = MemoryPool::new(100, 10);
        let mut a = MemoryReservation::new(&budget);
        a.grow_to(60).unwrap();
        a.grow_to(50).unwrap();
        let mut b = MemoryReservation::new(&budget);
        assert!(matches!(
            b.grow_to(31),
            Err(Error::TooDense {
                limit: 100,
                needed: 101,
                ..
            })
        ));
        b.grow_to(30).unwrap();
        drop(a);
        b.grow_to(90).unwrap();
        assert_eq!((b.bytes(), budget.left()), (90, 0));
        assert_eq!(b.at_hand(), 90);
        let mut c = MemoryReservation::new(&budget);
        assert!(c.grow_to(20).is_err());
        b.shrink_to(70);
        b.shrink_to(80);
        assert_eq!((b.at_hand(), c.at_hand()), (80, 10));
        c.grow_to(20).unwrap();
        assert!(c.grow_to(21).is_err());
        assert!(b.grow_to(u64::MAX).is_err());
    }
}
