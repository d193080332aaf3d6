//! How much is worked on at once.

use crate::sys::locks::{lock, wait};
use std::sync::{Condvar, Mutex};

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

    /// Waits until it is this one's turn, which ends when what is returned is dropped.
    pub fn take(&self) -> Turn<'_> {
        let mut free = lock(&self.free);
        while *free == 0 {
            free = wait(&self.changed, free);
        }
        *free -= 1;
        Turn(self)
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
