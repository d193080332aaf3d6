//! Threads that do what a queue hands out, until it has nothing left.

use crate::error::Error;
use crate::progress::Progress;
use crate::sys::locks::{into_inner, lock, wait};
use std::sync::{Condvar, Mutex, MutexGuard};

/// What a thread does next.
pub enum Next<T> {
    /// This.
    Do(T),
    /// Wait until something changes.
    Wait,
    /// Nothing is left, or something failed.
    Finished,
}

/// Decides what is done next; a state machine that does nothing itself.
pub trait Queue {
    /// What there is to do.
    type Task;

    /// What the thread that asks is to do. It tells so when it has done it.
    fn next(&mut self, interrupted: bool) -> Next<Self::Task>;

    /// Something has failed; nothing new is begun.
    fn fail(&mut self, error: Error);
}

/// A queue that threads share.
pub struct SharedQueue<Q> {
    queue: Mutex<Q>,
    changed: Condvar,
}

impl<Q: Queue> SharedQueue<Q> {
    /// Of a queue that nobody has asked yet.
    pub fn new(queue: Q) -> Self {
        SharedQueue {
            queue: Mutex::new(queue),
            changed: Condvar::new(),
        }
    }

    /// The queue, to tell it something.
    pub fn lock(&self) -> MutexGuard<'_, Q> {
        lock(&self.queue)
    }

    /// Wakes those that wait.
    pub fn wake(&self) {
        self.changed.notify_all();
    }

    /// The queue, once nobody else has it.
    pub fn into_inner(self) -> Q {
        into_inner(self.queue)
    }

    /// What each thread does: takes what comes next, wakes those that wait, and does what is to follow.
    pub fn work(
        &self,
        progress: &dyn Progress,
        mut take: impl FnMut(Q::Task),
        mut then: impl FnMut(),
    ) {
        let _guard = WakeOnPanic(self);
        let mut queue = self.lock();
        loop {
            let next = queue.next(progress.interrupted());
            queue = match next {
                Next::Finished => break,
                Next::Wait => wait(&self.changed, queue),
                Next::Do(task) => {
                    drop(queue);
                    take(task);
                    self.wake();
                    then();
                    self.lock()
                }
            };
        }
        drop(queue);
        self.wake();
    }
}

/// Lets threads that wait see that another one has panicked.
struct WakeOnPanic<'a, Q: Queue>(&'a SharedQueue<Q>);

impl<Q: Queue> Drop for WakeOnPanic<'_, Q> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.lock().fail(Error::Interrupted);
            self.0.wake();
        }
    }
}
