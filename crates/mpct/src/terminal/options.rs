//! Choices of a design, its progress, and where its time goes.

use crate::problem::RowSource;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::ControlFlow;
use std::time::Duration;

/// Which form of (15)/(26) the terminal horizon satisfies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// The first form: the support is taken over the constraints of all steps 0, …, M. Gives the shortest horizon.
    #[default]
    Exact,
    /// The second form: the support is taken over the constraints of step 0 alone. Sufficient, and longer.
    Sufficient,
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Exact => "exact",
            Self::Sufficient => "sufficient",
        })
    }
}

/// How far a search has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Rows and ellipsoids whose first spent step is known.
    pub rows_done: usize,
    /// Rows in all; 0 while K and P are computed.
    pub rows_total: usize,
    /// The row or ellipsoid last asked about; `None` while K and P are computed.
    pub row: Option<RowSource>,
    /// The step at which it was asked; 0 before the first.
    pub step: usize,
    /// A lower bound of the terminal horizon.
    pub terminal_horizon_at_least: usize,
}

/// What is told how far a search has come, and may end it.
pub type OnProgress<'a> = dyn Fn(&Progress) -> ControlFlow<()> + Sync + 'a;

/// Choices of a design.
#[derive(Clone, Copy)]
pub struct DesignOptions<'a> {
    /// Form of the condition.
    pub condition: Condition,
    /// The search gives up beyond this horizon.
    pub max_horizon: usize,
    /// The search gives up after this time.
    pub time_limit: Option<Duration>,
    /// Called now and then; a `Break` ends the search with [`DesignError::Interrupted`](crate::DesignError::Interrupted).
    pub progress: Option<&'a OnProgress<'a>>,
}

/// Largest terminal horizon searched unless stated otherwise.
pub const DEFAULT_MAX_HORIZON: usize = 5000;

impl Default for DesignOptions<'_> {
    fn default() -> Self {
        Self {
            condition: Condition::Exact,
            max_horizon: DEFAULT_MAX_HORIZON,
            time_limit: None,
            progress: None,
        }
    }
}

impl fmt::Debug for DesignOptions<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DesignOptions")
            .field("condition", &self.condition)
            .field("max_horizon", &self.max_horizon)
            .field("time_limit", &self.time_limit)
            .finish_non_exhaustive()
    }
}

/// Where the time of a design goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Phases {
    /// K and P (3). Zero in designs for several λ at once, which share them.
    pub law: Duration,
    /// M_θ (6) and the rows of step 0. Zero as above.
    pub steady_states: Duration,
    /// The rows of all steps along the terminal law, and their layout.
    pub rows: Duration,
    /// Linear programs (20)(29), and with ellipsoids second-order cone programs and their rows.
    pub programs: Duration,
}
