//! How long-running work tells what it is doing.

/// Receives progress; called from any thread.
pub trait Progress: Sync {
    /// A stage of the work begins, of `total` steps (0 if unknown).
    fn begin(&self, _stage: &str, _total: u64) {}
    /// `steps` more steps of the current stage are done.
    fn advance(&self, _steps: u64) {}
    /// Something the user should know that is not an error.
    fn warn(&self, _message: &str) {}
    /// True once the work should stop at the next safe place, with [`crate::Error::Interrupted`].
    fn interrupted(&self) -> bool {
        false
    }
}

/// Says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Quiet;

impl Progress for Quiet {}
