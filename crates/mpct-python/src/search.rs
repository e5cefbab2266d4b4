//! How a terminal horizon is searched: limits, progress, Ctrl-C.

use crate::errors;
use crate::interrupt;
use crate::names;
use mpct::{Condition, DesignOptions, Progress};
use pyo3::prelude::*;
use pyo3::types::PyBool;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// What shows progress: `None` when nothing does.
fn watcher<'py>(
    py: Python<'py>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    match progress {
        Some(p) if p.is_instance_of::<PyBool>() && !p.is_truthy()? => Ok(None),
        Some(p) if p.is_callable() => Ok(Some(p)),
        Some(p) if !p.is_instance_of::<PyBool>() => Err(errors::argument_type(
            py,
            "progress",
            "a function of three numbers, True, False or None",
            &p.get_type().to_string(),
        )),
        choice => {
            let bar = py
                .import("mpct._progress")?
                .call_method1("bar", (choice.is_some(),))?;
            Ok((!bar.is_none()).then_some(bar))
        }
    }
}

pub fn seconds(py: Python<'_>, what: &str, value: Option<f64>) -> PyResult<Option<Duration>> {
    value
        .map(|s| {
            Duration::try_from_secs_f64(s)
                .map_err(|_| errors::argument(py, what, "a number of seconds >= 0", &s.to_string()))
        })
        .transpose()
}

/// How the terminal horizon is searched.
pub struct Search<'py> {
    condition: Condition,
    pub max_horizon: usize,
    time_limit: Option<Duration>,
    watcher: Option<Bound<'py, PyAny>>,
}

impl<'py> Search<'py> {
    pub fn of(
        py: Python<'py>,
        condition: &str,
        max_horizon: usize,
        time_limit: Option<f64>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        Ok(Self {
            condition: names::value(py, condition)?,
            max_horizon,
            time_limit: seconds(py, "time_limit", time_limit)?,
            watcher: watcher(py, progress)?,
        })
    }

    /// Runs a search in a thread of its own, shows how far it is, and ends it after Ctrl-C.
    pub fn run<T: Send>(
        &self,
        py: Python<'py>,
        search: impl FnOnce(&DesignOptions<'_>) -> T + Send,
    ) -> PyResult<T> {
        // Rows done, rows in all, lower bound of the horizon.
        let latest = Mutex::new((0, 0, 0));
        let (condition, max_horizon, time_limit) =
            (self.condition, self.max_horizon, self.time_limit);
        let result = interrupt::run(
            py,
            |stop| {
                let progress = |p: &Progress| {
                    if let Ok(mut known) = latest.lock() {
                        known.0 = p.rows_done;
                        known.1 = known.1.max(p.rows_total);
                        known.2 = p.terminal_horizon_at_least;
                    }
                    if stop.load(Ordering::Relaxed) {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                };
                search(&DesignOptions {
                    condition,
                    max_horizon,
                    time_limit,
                    progress: Some(&progress),
                })
            },
            |_| {
                let known = latest.lock().map_or((0, 0, 0), |known| *known);
                if let Some(watcher) = &self.watcher {
                    watcher.call1(known)?;
                }
                Ok(())
            },
        );
        let close = self
            .watcher
            .as_ref()
            .and_then(|w| w.getattr_opt("close").ok().flatten());
        if let Some(close) = close {
            close.call0()?;
        }
        result
    }
}
