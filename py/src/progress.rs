//! Long work for Python: in a thread of its own, while the thread that called sees to signals, progress and warnings.

use crate::errors::as_arguments;
use alvis::progress::Progress;
use alvis::{Error, Result};
use pyo3::prelude::*;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// How often signals are looked at and progress is told.
const TURN: Duration = Duration::from_millis(50);

/// What the work says, until the thread that called comes to hear it.
#[derive(Default)]
pub struct Said {
    stage: Mutex<(String, u64)>,
    done: AtomicU64,
    warnings: Mutex<Vec<String>>,
    stop: AtomicBool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Progress for Said {
    fn begin(&self, stage: &str, total: u64) {
        let mut now = lock(&self.stage);
        *now = (stage.to_owned(), total);
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    fn warn(&self, message: &str) {
        lock(&self.warnings).push(message.to_owned());
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// What was told last.
#[derive(Default, PartialEq)]
struct Told {
    stage: String,
    total: u64,
    done: u64,
}

/// Does work without the interpreter's lock. Meanwhile `callback(stage, done, total)` is called in the calling thread,
/// `warnings.warn` for warnings, and signals are handled: whatever these raise asks the work to stop, and is raised once
/// it has.
///
/// # Errors
/// What was raised; the exception of the work's own error.
pub fn run<T: Send>(
    py: Python<'_>,
    callback: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&dyn Progress) -> Result<T> + Send,
) -> PyResult<T> {
    let callback = callback.map(|callback| callback.clone().unbind());
    let said = Said::default();
    let (outcome, raised) = py.detach(|| {
        thread::scope(|scope| {
            let (send, done) = channel::<()>();
            let said = &said;
            let worker = scope.spawn(move || {
                // whether the work returns or panics, the other side hears of it
                let _send = send;
                work(said)
            });
            let mut told = Told::default();
            let mut raised: Option<PyErr> = None;
            while done.recv_timeout(TURN) == Err(RecvTimeoutError::Timeout) {
                if raised.is_none() {
                    raised =
                        Python::attach(|py| turn(py, said, callback.as_ref(), &mut told)).err();
                    said.stop.store(raised.is_some(), Ordering::Relaxed);
                }
            }
            let outcome = worker.join().unwrap_or_else(|panic| resume_unwind(panic));
            (outcome, raised)
        })
    });
    let mut told = Told::default();
    let raised = match raised {
        None => turn(py, &said, callback.as_ref(), &mut told).err(),
        raised => raised,
    };
    match (raised, outcome) {
        (None, Ok(value)) => Ok(value),
        (None, Err(error)) => Err(crate::errors::exception(py, &error)),
        (Some(raised), outcome) => {
            if let Err(error @ Error::Resumable { .. }) = outcome {
                // from Python 3.11 on
                let _ = raised
                    .value(py)
                    .call_method1("add_note", (error.to_string(),));
            }
            Err(raised)
        }
    }
}

/// Hands on what was said, and lets Python handle signals.
fn turn(
    py: Python<'_>,
    said: &Said,
    callback: Option<&Py<PyAny>>,
    told: &mut Told,
) -> PyResult<()> {
    py.check_signals()?;
    let warnings = std::mem::take(&mut *lock(&said.warnings));
    if !warnings.is_empty() {
        let category = py.import("alvis._errors")?.getattr("AlvisWarning")?;
        let warn = py.import("warnings")?.getattr("warn")?;
        for text in warnings {
            warn.call1((as_arguments(&text), &category, WARNED_AT))?;
        }
    }
    let Some(callback) = callback else {
        return Ok(());
    };
    let (stage, total) = lock(&said.stage).clone();
    let done = said.done.load(Ordering::Relaxed);
    let now = Told { stage, total, done };
    if now != *told && !now.stage.is_empty() {
        callback.call1(py, (&now.stage, now.done, now.total))?;
        *told = now;
    }
    Ok(())
}

/// The frame that a warning points at: whoever called the function of the package.
const WARNED_AT: u32 = 2;
