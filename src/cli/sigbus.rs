//! The end of a mapped file: touching a page that is not there any more raises SIGBUS, which would
//! end the process without a word.

use super::FAILED;
use std::path::Path;
use std::sync::atomic::{AtomicPtr, Ordering};

/// What to say. Never freed: the handler may read it at any time.
static MESSAGE: AtomicPtr<String> = AtomicPtr::new(std::ptr::null_mut());

/// From now on SIGBUS ends the process with a message about the mapped file and status 2.
pub fn guard(path: &Path) {
    let message = format!(
        "alvis: {}: found an end of the file where there was none, or a disk that fails, expected \
         the length the file had when it was opened: do not change the input while it is read, or use \
         --io read\n",
        path.display()
    );
    MESSAGE.store(Box::into_raw(Box::new(message)), Ordering::Release);
    let handler: extern "C" fn(libc::c_int) = end;
    // SAFETY: the handler does only what is allowed in one: it reads an atomic and calls write and
    // _exit. `handler` has the type that a handler without SA_SIGINFO must have.
    unsafe {
        libc::signal(libc::SIGBUS, handler as *const () as libc::sighandler_t);
    }
}

extern "C" fn end(_signal: libc::c_int) {
    let message = MESSAGE.load(Ordering::Acquire);
    // SAFETY: the pointer is null or was leaked from a box by `guard` and is never changed; write and
    // _exit may be called in a handler.
    unsafe {
        if let Some(text) = message.as_ref() {
            libc::write(libc::STDERR_FILENO, text.as_ptr().cast(), text.len());
        }
        libc::_exit(FAILED.into());
    }
}
