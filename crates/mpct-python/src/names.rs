//! The words that stand for choices, as in problem files.

use crate::errors;
use mpct::analysis::AlphaScope;
use mpct::{CandidateReason, Condition, Formulation, StepStatus, Task, TerminalCost};
use pyo3::prelude::*;

/// A choice with the words for its values.
pub trait Named: Copy + PartialEq + 'static {
    /// What the argument is called.
    const WHAT: &'static str;
    /// Words and values.
    const WORDS: &'static [(&'static str, Self)];
}

impl Named for Task {
    const WHAT: &'static str = "task";
    const WORDS: &'static [(&'static str, Self)] = &[
        ("tracking", Self::Tracking),
        ("regulation", Self::Regulation),
    ];
}

impl Named for Formulation {
    const WHAT: &'static str = "formulation";
    const WORDS: &'static [(&'static str, Self)] = &[
        ("implicit", Self::Implicit),
        ("explicit", Self::Explicit),
        ("no_terminal_constraint", Self::NoTerminalConstraint),
    ];
}

impl Named for TerminalCost {
    const WHAT: &'static str = "terminal_cost";
    const WORDS: &'static [(&'static str, Self)] =
        &[("exact", Self::Exact), ("implicit", Self::Implicit)];
}

impl Named for Condition {
    const WHAT: &'static str = "condition";
    const WORDS: &'static [(&'static str, Self)] =
        &[("exact", Self::Exact), ("sufficient", Self::Sufficient)];
}

impl Named for AlphaScope {
    const WHAT: &'static str = "scope";
    const WORDS: &'static [(&'static str, Self)] = &[
        ("every_equilibrium", Self::EveryEquilibrium),
        ("throughout_region", Self::ThroughoutRegion),
        ("around_set_point", Self::AroundSetPoint),
    ];
}

/// Without reasons: they have words of their own.
impl Named for StepStatus {
    const WHAT: &'static str = "status";
    const WORDS: &'static [(&'static str, Self)] = &[
        ("optimal", Self::Optimal),
        ("candidate", Self::Candidate(CandidateReason::SolverFailed)),
    ];
}

impl Named for CandidateReason {
    const WHAT: &'static str = "reason";
    const WORDS: &'static [(&'static str, Self)] = &[
        ("iteration_limit", Self::IterationLimit),
        ("deadline", Self::Deadline),
        ("solver_failed", Self::SolverFailed),
    ];
}

/// Why a step returned the candidate.
pub fn reason(status: StepStatus) -> Option<&'static str> {
    match status {
        StepStatus::Candidate(reason) => Some(word(reason)),
        _ => None,
    }
}

/// The status that a word stands for, with its reason when that is known.
pub fn status(py: Python<'_>, word: &str, reason: Option<&str>) -> PyResult<StepStatus> {
    match (value(py, word)?, reason) {
        (StepStatus::Candidate(_), Some(reason)) => Ok(StepStatus::Candidate(value(py, reason)?)),
        (status, _) => Ok(status),
    }
}

/// The value that a word stands for.
pub fn value<T: Named>(py: Python<'_>, word: &str) -> PyResult<T> {
    T::WORDS
        .iter()
        .find(|(known, _)| *known == word)
        .map(|(_, value)| *value)
        .ok_or_else(|| {
            let known: Vec<String> = T::WORDS.iter().map(|(w, _)| format!("'{w}'")).collect();
            errors::argument(py, T::WHAT, &known.join(" or "), &format!("'{word}'"))
        })
}

/// The word for a value.
pub fn word<T: Named>(value: T) -> &'static str {
    T::WORDS
        .iter()
        .find(|(_, known)| *known == value)
        .map_or("other", |(word, _)| word)
}
