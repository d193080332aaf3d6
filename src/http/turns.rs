//! How much is worked on at once.

use crate::sys::locks::lock;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// How often somebody who waits looks whether it is still needed.
const LOOK: Duration = Duration::from_millis(100);

/// So many may work at once; others wait.
#[derive(Debug)]
pub struct Turns {
    free: Mutex<usize>,
    changed: Condvar,
}

impl Turns {
    /// For so many.
    pub fn new(most: usize) -> Self {
        Turns {
            free: Mutex::new(most.max(1)),
            changed: Condvar::new(),
        }
    }

    /// Waits until it is this one's turn, which ends when what is returned is dropped. `None` if it is not needed any
    /// more before that.
    pub fn take(&self, is_needed: impl Fn() -> bool) -> Option<Turn<'_>> {
        let mut free = lock(&self.free);
        while *free == 0 {
            let waited = self.changed.wait_timeout(free, LOOK);
            (free, _) = waited.unwrap_or_else(PoisonError::into_inner);
            if !is_needed() {
                return None;
            }
        }
        *free -= 1;
        Some(Turn(self))
    }
}

/// A turn.
#[derive(Debug)]
pub struct Turn<'a>(&'a Turns);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        *lock(&self.0.free) += 1;
        self.0.changed.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn so_many_work_at_once() {
        let (turns, working) = (Turns::new(3), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..12 {
                scope.spawn(|| {
                    let _turn = turns.take(|| true).unwrap();
                    assert!(working.fetch_add(1, Ordering::SeqCst) < 3);
                    std::thread::yield_now();
                    working.fetch_sub(1, Ordering::SeqCst);
                });
            }
        });
        let all: Vec<_> = (0..3).map(|_| turns.take(|| true)).collect();
        assert!(all.iter().all(Option::is_some));
        assert!(turns.take(|| false).is_none());
        drop(all);
        assert!(turns.take(|| false).is_some());
    }
}
