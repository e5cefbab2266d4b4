//! Long work that Ctrl-C ends.

use crate::fork;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// How often signals are looked at.
const PERIOD: Duration = Duration::from_millis(50);
/// Stack of the working thread, as large as that of a main thread usually is.
const STACK: usize = 8 << 20;

/// Waits for the end of a thread, for a period at most.
fn has_ended(py: Python<'_>, receiver: &mut Receiver<()>) -> bool {
    // A receiver is no `Sync`: the exclusive reference moves into the closure.
    py.detach(move || receiver.recv_timeout(PERIOD)) != Err(RecvTimeoutError::Timeout)
}

/// Runs `work`, which has no way to be told to end, in a thread of its own without the GIL. After a signal the error is
/// returned at once; the thread is left to itself, its answer is dropped, and `left` turns true for work that can look
/// at it between two parts.
pub fn leave<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send + 'static,
) -> PyResult<T> {
    let left = Arc::new(AtomicBool::new(false));
    let (sender, mut receiver) = channel::<()>();
    let seen = Arc::clone(&left);
    let worker = thread::Builder::new()
        .stack_size(STACK)
        .spawn(move || {
            let _sender = sender;
            fork::with_threads(|| work(&seen))
        })
        .map_err(|e| PyRuntimeError::new_err(format!("cannot start a thread: {e}")))?;
    while !has_ended(py, &mut receiver) {
        py.check_signals()
            .inspect_err(|_| left.store(true, Ordering::Relaxed))?;
    }
    match py.detach(|| worker.join()) {
        Ok(value) => Ok(value),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// Runs `work` in a thread of its own without the GIL, while this one answers signals and calls `watch`.
/// After a signal or an error of `watch`, `stop` turns true and the error is returned once `work` has come to its end.
pub fn run<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> T + Send,
    mut watch: impl FnMut(Python<'_>) -> PyResult<()>,
) -> PyResult<T> {
    let stop = AtomicBool::new(false);
    let (sender, receiver) = channel::<()>();
    thread::scope(|scope| {
        let stop = &stop;
        let worker = thread::Builder::new()
            .stack_size(STACK)
            .spawn_scoped(scope, move || {
                // Dropped at the end, also by a panic: that wakes the receiver.
                let _sender = sender;
                fork::with_threads(|| work(stop))
            })
            .map_err(|e| PyRuntimeError::new_err(format!("cannot start a thread: {e}")))?;
        let mut failure = None;
        let mut receiver = receiver;
        while !has_ended(py, &mut receiver) {
            if failure.is_none()
                && let Err(error) = py.check_signals().and_then(|()| watch(py))
            {
                failure = Some(error);
                stop.store(true, Ordering::Relaxed);
            }
        }
        let result = py.detach(|| worker.join());
        match (failure, result) {
            (Some(error), _) => Err(error),
            (None, Ok(value)) => Ok(value),
            (None, Err(panic)) => std::panic::resume_unwind(panic),
        }
    })
}
