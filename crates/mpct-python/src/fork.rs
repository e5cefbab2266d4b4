//! Work after a fork.
//!
//! A fork copies the process and none of its threads but one. The threads that computations share (rayon's) are then
//! missing, and work handed to them would wait for ever. A forked process therefore works with threads of its own.

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Forks between the process that loaded the module and this one.
static FORKS: AtomicU64 = AtomicU64::new(0);
/// The threads of a forked process, and the number of forks when they were started. Those of the process before are
/// never dropped: they are not there to be ended.
static POOL: Mutex<Option<(u64, &'static ThreadPool)>> = Mutex::new(None);

/// Tells that this process is a fork. Python calls it in the child.
#[pyfunction]
pub fn _after_fork() {
    FORKS.fetch_add(1, Ordering::Relaxed);
}

fn pool(forks: u64) -> Option<&'static ThreadPool> {
    let mut known = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match *known {
        Some((at, pool)) if at == forks => Some(pool),
        _ => {
            let pool: &'static ThreadPool =
                Box::leak(Box::new(ThreadPoolBuilder::new().build().ok()?));
            *known = Some((forks, pool));
            Some(pool)
        }
    }
}

/// Runs `work` where its parallel parts find threads.
pub fn with_threads<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let forks = FORKS.load(Ordering::Relaxed);
    if forks == 0 {
        return work();
    }
    match pool(forks) {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

/// Runs `work` without the GIL.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(|| with_threads(work))
}
