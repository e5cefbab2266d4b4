//! Terminal ingredients: K, P, the steady-state basis and the terminal horizon.

mod augmented;
mod bank;
mod boxes;
mod conic;
mod explicit_set;
mod horizon;
mod options;
mod program;
mod proofs;
mod simplex;
mod support;
#[cfg(test)]
mod tests;

pub(crate) use augmented::LawRows;
pub(crate) use conic::ConicMultiplier;
pub use explicit_set::MaximalAdmissibleSet;
pub use options::{Condition, DEFAULT_MAX_HORIZON, DesignOptions, OnProgress, Phases, Progress};
pub(crate) use proofs::Proofs;
pub(crate) use support::RowId;

use crate::clock::Clock;
use crate::error::DesignError;
use crate::lqr::{self, Law, TerminalLaw};
use crate::matrix::SparseMatrix;
use crate::problem::{Problem, RowSource, Task};
use crate::steady_state::SteadyStates;
use augmented::Augmented;
use bank::Bank;
use boxes::Boxes;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Everything the guarantees of a controller rest on. Only a design makes one.
///
/// ```
/// use mpct::{Constraints, DesignOptions, Matrix, Plant, Problem, TerminalIngredients, Weights};
/// let plant = Plant::discrete(
///     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
///     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// )?;
/// let constraints = Constraints::new(2, 2)
///     .state_bounds(&[-3.0; 2], &[3.0; 2])?
///     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
/// let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?.with_scaling(0.9)?;
/// let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
/// // Section 4.1 of the paper: M̃ = 5 at λ = 0.9.
/// assert_eq!(ingredients.terminal_horizon(), 5);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug)]
pub struct TerminalIngredients {
    problem: Problem,
    law: Law,
    /// The law once more, for computations with full matrices.
    dense_law: OnceLock<TerminalLaw>,
    steady_states: SteadyStates,
    condition: Condition,
    terminal_horizon: usize,
    /// First spent step of each constraint row, in the order of `problem.rows()`.
    spent: Vec<usize>,
    /// The same for each ellipsoid.
    spent_norms: Vec<usize>,
    /// Whether it was shown that one step less is too few.
    minimal: bool,
    linear_programs: usize,
    phases: Phases,
    elapsed: Duration,
}

/// What a check of Assumption 1 finds.
#[derive(Clone, Debug)]
pub struct Assumption {
    /// Spectral radius of A + B K.
    pub spectral_radius: f64,
    /// The basis of the steady states.
    pub steady_states: SteadyStates,
}

/// Checks Assumption 1 without searching the horizon: (A, B) stabilizable, A + B K Schur, no direction free of
/// constraints. Definite weights and an interior origin were checked with the problem.
///
/// # Errors
/// [`DesignError::NotStabilizable`], [`DesignError::NotSchur`], [`DesignError::Unbounded`], [`DesignError::Solver`].
pub fn check_assumption(problem: &Problem) -> Result<Assumption, DesignError> {
    let clock = Clock::unlimited();
    let law = lqr::terminal_law(problem, &clock)?;
    let steady_states = SteadyStates::of(problem)?;
    if problem.norms().is_empty() {
        let mut system = Augmented::new(problem, &law.gain, &law.closed_loop, &steady_states);
        Boxes::of(&mut system, &clock)?;
    } else {
        conic::ConicSystem::new(problem, &law.to_dense(), &steady_states)?;
    }
    Ok(Assumption {
        spectral_radius: law.spectral_radius,
        steady_states,
    })
}

impl TerminalIngredients {
    /// Computes K, P, M_θ and the terminal horizon.
    ///
    /// # Errors
    /// [`DesignError::NotStabilizable`], [`DesignError::NotSchur`], [`DesignError::Unbounded`],
    /// [`DesignError::HorizonNotDetermined`], [`DesignError::Interrupted`], [`DesignError::Solver`].
    pub fn design(problem: &Problem, options: &DesignOptions<'_>) -> Result<Self, DesignError> {
        let clock = Clock::start(options.time_limit);
        let law = terminal_law(problem, options, &clock)?;
        let of_law = clock.elapsed();
        let steady_states = SteadyStates::of(problem)?;
        let mut system = Augmented::new(problem, &law.gain, &law.closed_loop, &steady_states);
        let of_steady_states = clock.elapsed() - of_law;
        let mut design = Self::search(problem, law, steady_states, &mut system, options, &clock)?;
        design.phases.law = of_law;
        design.phases.steady_states = of_steady_states;
        Ok(design)
    }

    /// The same for several scalings λ, in their order. K, P, M_θ and the rows along the terminal law are computed
    /// once; the time limit holds for each scaling.
    ///
    /// # Errors
    /// As [`design`](Self::design) for everything that does not depend on λ; what fails for one λ fails in its place.
    pub fn design_all(
        problem: &Problem,
        scalings: &[f64],
        options: &DesignOptions<'_>,
    ) -> Result<Vec<Result<Self, DesignError>>, DesignError> {
        let law = terminal_law(problem, options, &Clock::start(options.time_limit))?;
        let steady_states = SteadyStates::of(problem)?;
        let mut system = Augmented::new(problem, &law.gain, &law.closed_loop, &steady_states);
        // The largest λ first: its box is the widest, and what it drops from a row is negligible for the others too.
        let mut order: Vec<usize> = (0..scalings.len()).collect();
        order.sort_by(|&i, &j| scalings[j].total_cmp(&scalings[i]));
        let mut designs: Vec<Option<Result<Self, DesignError>>> = vec![None; scalings.len()];
        for i in order {
            let clock = Clock::start(options.time_limit);
            let one = problem
                .clone()
                .with_scaling(scalings[i])
                .and_then(|problem| {
                    system.scale_to(problem.scaling());
                    let (law, steady_states) = (law.clone(), steady_states.clone());
                    Self::search(&problem, law, steady_states, &mut system, options, &clock)
                });
            designs[i] = Some(one);
        }
        Ok(designs.into_iter().flatten().collect())
    }

    /// The horizon, when everything else is known.
    fn search(
        problem: &Problem,
        law: Law,
        steady_states: SteadyStates,
        system: &mut Augmented,
        options: &DesignOptions<'_>,
        clock: &Clock,
    ) -> Result<Self, DesignError> {
        if options.max_horizon == 0 {
            return Err(DesignError::OutOfRange {
                what: "max_horizon".into(),
                expected: "a whole number of steps >= 1".into(),
                found: "0".into(),
            });
        }
        if !problem.norms().is_empty() {
            return Self::search_with_ellipsoids(
                problem,
                law,
                steady_states,
                system,
                options,
                clock,
            );
        }
        let before = clock.elapsed();
        let mut bank = within_a_box(system, Room::AsIs, clock)?;
        let of_box = clock.elapsed() - before;
        let found = horizon::search(problem, system, &mut bank, options, clock)?;
        let phases = Phases {
            rows: of_box + found.rows,
            programs: (clock.elapsed() - before).saturating_sub(of_box + found.rows),
            ..Phases::default()
        };
        Ok(Self {
            problem: problem.clone(),
            law,
            dense_law: OnceLock::new(),
            steady_states,
            condition: options.condition,
            terminal_horizon: found.horizon,
            spent: spent_by_row(problem, system, &found),
            spent_norms: Vec::new(),
            minimal: options.condition == Condition::Exact || found.horizon == 1,
            linear_programs: found.programs,
            phases,
            elapsed: clock.elapsed(),
        })
    }

    /// The same with ellipsoids. Where the rows alone bound the set, they are searched first: what they imply is spent.
    fn search_with_ellipsoids(
        problem: &Problem,
        law: Law,
        steady_states: SteadyStates,
        system: &mut Augmented,
        options: &DesignOptions<'_>,
        clock: &Clock,
    ) -> Result<Self, DesignError> {
        let before = clock.elapsed();
        let dense = law.to_dense();
        let mut conic = conic::ConicSystem::new(problem, &dense, &steady_states)?;
        let mut of_rows = clock.elapsed() - before;
        let mut programs = 0;
        let mut polytope = None;
        if options.condition == Condition::Exact
            && let Ok(boxes) = Boxes::of(system, clock)
            && boxes.valid.iter().all(|&v| v)
        {
            let mut bank = within_a_box(system, Room::AsIs, clock)?;
            let found = horizon::search(problem, system, &mut bank, options, clock)?;
            programs = found.programs;
            of_rows += found.rows;
            polytope = Some(spent_by_row(problem, system, &found));
        }
        let mut found = conic::search(problem, &mut conic, polytope.as_deref(), options, clock)?;
        let spent_norms = found.spent.split_off(problem.rows().len());
        let dense_law = OnceLock::new();
        let _ = dense_law.set(dense);
        Ok(Self {
            problem: problem.clone(),
            law,
            dense_law,
            steady_states,
            condition: options.condition,
            terminal_horizon: found.horizon,
            spent: found.spent,
            spent_norms,
            minimal: found.minimal,
            linear_programs: programs + found.programs,
            phases: Phases {
                rows: of_rows,
                programs: (clock.elapsed() - before).saturating_sub(of_rows),
                ..Phases::default()
            },
            elapsed: clock.elapsed(),
        })
    }

    /// The problem.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// K of the terminal law u = K x + L θ, m × n.
    pub fn gain(&self) -> &SparseMatrix {
        &self.law.gain
    }

    /// P, the solution of (3) for this K, n × n.
    pub fn terminal_weight(&self) -> &SparseMatrix {
        &self.law.weight
    }

    /// The basis M_θ of the steady states (6).
    pub fn steady_states(&self) -> &SteadyStates {
        &self.steady_states
    }

    /// The spectral radius of A + B K, less than 1.
    pub fn spectral_radius(&self) -> f64 {
        self.law.spectral_radius
    }

    /// M (20) for regulation, M̃ (29) for tracking: the smallest integer ≥ 1 that satisfies the condition. With ellipsoids,
    /// the smallest for which proofs were found; see [`is_minimal`](Self::is_minimal).
    pub fn terminal_horizon(&self) -> usize {
        self.terminal_horizon
    }

    /// Whether it was shown that one step less is too few: always for the exact condition without ellipsoids. With
    /// ellipsoids, when a point was found that satisfies one step less and breaks a constraint afterwards.
    pub fn is_minimal(&self) -> bool {
        self.minimal
    }

    /// The form of the condition that the horizon satisfies.
    pub fn condition(&self) -> Condition {
        self.condition
    }

    /// The first step at which each constraint row, then each ellipsoid, is implied by the steps before it. With the
    /// sufficient condition, one more than the horizon for all.
    pub fn spent_steps(&self) -> Vec<(RowSource, usize)> {
        let rows = self.problem.rows().source.iter().copied();
        let norms = self.problem.norms().iter().map(|b| b.source);
        rows.chain(norms)
            .zip(self.spent.iter().chain(&self.spent_norms).copied())
            .collect()
    }

    /// Number of rows of X_aug,t (22), or of X_t (14) for regulation.
    pub fn constraint_rows(&self) -> usize {
        let p = self.problem.rows().len();
        match self.problem.task() {
            Task::Regulation => p,
            Task::Tracking => {
                let w = self.equilibrium_rows();
                p + (0..p).filter(|&i| w.row(i).len() > 0).count()
            }
        }
    }

    /// Linear programs, and with ellipsoids second-order cone programs, solved for the horizon.
    pub fn linear_programs(&self) -> usize {
        self.linear_programs
    }

    /// Where that time went.
    pub fn phases(&self) -> Phases {
        self.phases
    }

    /// How long the design took.
    pub fn elapsed(&self) -> Duration {
        self.elapsed
    }

    /// The explicit set (16)/(27) without redundant rows.
    ///
    /// # Errors
    /// [`DesignError::Solver`] when a redundancy cannot be decided with a checked answer; [`DesignError::OutOfRange`] with
    /// ellipsoids: the set is no polytope then.
    pub fn maximal_admissible_set(&self) -> Result<MaximalAdmissibleSet, DesignError> {
        if !self.problem.norms().is_empty() {
            return Err(DesignError::OutOfRange {
                what: "the explicit terminal set".into(),
                expected: "polytopic constraints; with ellipsoids the set is no polytope, and the formulation is \"implicit\"".into(),
                found: format!("{} ellipsoids", self.problem.norms().len()),
            });
        }
        let mut system = self.augmented();
        let mut bank = within_a_box(&mut system, Room::Doubled, &Clock::unlimited())?;
        explicit_set::irredundant(&mut system, &mut bank, &self.steady_states, &self.spent)
    }

    /// C M_θx + D M_θu, rows × m.
    pub(crate) fn equilibrium_rows(&self) -> SparseMatrix {
        let rows = self.problem.rows();
        rows.c.mul(self.steady_states.state_basis()).combine(
            1.0,
            &rows.d.mul(self.steady_states.input_basis()),
            1.0,
        )
    }

    /// K, P and A + B K, dense.
    pub(crate) fn law(&self) -> &TerminalLaw {
        self.dense_law.get_or_init(|| self.law.to_dense())
    }

    /// K, P and A + B K as they were computed.
    pub(crate) fn sparse_law(&self) -> &Law {
        &self.law
    }

    /// The rows along the terminal law up to a step, opposite ones in pairs.
    ///
    /// # Errors
    /// As the design: [`DesignError::Unbounded`], [`DesignError::Solver`].
    pub(crate) fn law_rows(&self, last: usize) -> Result<LawRows, DesignError> {
        let mut system = self.augmented();
        within_a_box(&mut system, Room::AsIs, &Clock::unlimited())?;
        system.extend_to(last);
        Ok(system.into_law_rows(self.problem.plant().inputs()))
    }

    /// First spent step of ellipsoid k.
    pub(crate) fn spent_norm_step(&self, norm: usize) -> usize {
        self.spent_norms[norm]
    }

    /// First spent step of constraint row i.
    pub(crate) fn spent_step(&self, row: usize) -> usize {
        self.spent[row]
    }

    fn augmented(&self) -> Augmented {
        Augmented::new(
            &self.problem,
            &self.law.gain,
            &self.law.closed_loop,
            &self.steady_states,
        )
    }
}

/// K and P. When that is interrupted every row is still open.
fn terminal_law(
    problem: &Problem,
    options: &DesignOptions<'_>,
    clock: &Clock,
) -> Result<Law, DesignError> {
    let law = if problem.plant().states() < WATCHED_FROM {
        lqr::terminal_law(problem, clock)
    } else {
        watched(options, clock, || lqr::terminal_law(problem, clock))
    };
    law.map_err(|e| match e {
        DesignError::Interrupted { at_least, .. } => DesignError::Interrupted {
            at_least,
            rows_left: problem.rows().len() + problem.norms().len(),
        },
        other => other,
    })
}

/// First spent steps in the order of the problem's rows.
fn spent_by_row(problem: &Problem, system: &Augmented, found: &horizon::Found) -> Vec<usize> {
    let mut spent = vec![1; problem.rows().len()];
    for (pair, at) in system.pairs.iter().zip(&found.spent) {
        spent[pair.upper] = at[0];
        if let Some((lower, _)) = pair.lower {
            spent[lower] = at[1];
        }
    }
    spent
}

/// From this many states on K and P take long enough for somebody to want to stop them.
const WATCHED_FROM: usize = 100;
/// How often it is asked whether to stop while K and P are computed.
const WATCH: Duration = Duration::from_millis(50);

/// Work that tells no progress of its own: a thread beside it asks whether to stop.
fn watched<T>(options: &DesignOptions<'_>, clock: &Clock, work: impl FnOnce() -> T) -> T {
    let Some(progress) = options.progress else {
        return work();
    };
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let watcher = scope.spawn(|| {
            while !is_done.load(Ordering::Acquire) {
                std::thread::park_timeout(WATCH);
                let nothing_new = Progress {
                    rows_done: 0,
                    rows_total: 0,
                    row: None,
                    step: 0,
                    terminal_horizon_at_least: 1,
                };
                if !is_done.load(Ordering::Acquire) && progress(&nothing_new).is_break() {
                    clock.stop();
                    break;
                }
            }
        });
        let result = work();
        is_done.store(true, Ordering::Release);
        watcher.thread().unpark();
        result
    })
}

/// Which box a computation needs.
#[derive(Clone, Copy)]
enum Room {
    /// That of the set.
    AsIs,
    /// That of the set with any one row left out.
    Doubled,
}

/// The box of a system, and its rows laid out in it.
fn within_a_box(system: &mut Augmented, room: Room, clock: &Clock) -> Result<Bank, DesignError> {
    let boxes = match room {
        Room::AsIs => Boxes::of(system, clock)?,
        Room::Doubled => Boxes::of(system, clock)?.doubled(),
    };
    if boxes.valid.iter().all(|&v| v) {
        system.drop_within(&boxes.beta);
    }
    Ok(Bank::new(system, &boxes))
}
