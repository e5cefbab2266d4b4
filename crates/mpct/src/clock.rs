//! How long a computation may go on.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A stopwatch with an alarm, shared by every thread of a design. Long computations ask it now and then.
#[derive(Debug)]
pub(crate) struct Clock {
    started: Instant,
    limit: Option<Duration>,
    stopped: AtomicBool,
}

impl Clock {
    /// Starts now; rings after `limit`.
    pub(crate) fn start(limit: Option<Duration>) -> Self {
        Self {
            started: Instant::now(),
            limit,
            stopped: AtomicBool::new(false),
        }
    }

    /// A clock that never rings.
    pub(crate) fn unlimited() -> Self {
        Self::start(None)
    }

    /// Rings at once.
    pub(crate) fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Whether the time is over, or somebody stopped the clock.
    pub(crate) fn has_stopped(&self) -> bool {
        if self
            .limit
            .is_some_and(|limit| self.started.elapsed() > limit)
        {
            self.stop();
        }
        self.stopped.load(Ordering::Relaxed)
    }

    /// Time since the start.
    pub(crate) fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }
}
