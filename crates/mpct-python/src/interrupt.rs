//! Long work that Ctrl-C ends.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// How often signals are looked at.
const PERIOD: Duration = Duration::from_millis(50);
/// Stack of the working thread, as large as that of a main thread usually is.
const STACK: usize = 8 << 20;

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
                work(stop)
            })
            .map_err(|e| PyRuntimeError::new_err(format!("cannot start a thread: {e}")))?;
        let mut failure = None;
        let mut receiver = receiver;
        loop {
            let (back, answer) = py.detach(move || {
                let answer = receiver.recv_timeout(PERIOD);
                (receiver, answer)
            });
            receiver = back;
            if answer != Err(RecvTimeoutError::Timeout) {
                break;
            }
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
