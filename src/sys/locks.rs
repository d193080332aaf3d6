//! One way to take locks.
//!
//! A thread that panics while it holds a lock poisons it. Who takes it afterwards takes it all the same: threads here
//! are joined, by rayon, by a scope or by who started them, and a panic of one goes on in who waits for it, so nothing
//! that was half changed is used for a result. A second panic in each of the others would hide the first message, and
//! end the process where it meets a `Drop`, before temporary files are removed.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// What a mutex guards, once nobody else has it.
pub fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a mutex guards, of which this is the only user.
pub fn unshared<T: ?Sized>(mutex: &mut Mutex<T>) -> &mut T {
    mutex.get_mut().unwrap_or_else(PoisonError::into_inner)
}

/// What a mutex guarded.
pub fn into_inner<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// Gives up what a mutex guards until somebody says that it has changed.
pub fn wait<'a, T>(changed: &Condvar, guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
    changed.wait(guard).unwrap_or_else(PoisonError::into_inner)
}
