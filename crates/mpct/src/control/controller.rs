//! The controller behind one door: `step(x, set_point) -> u`.

use super::online::Limits;
use super::prediction::RowOrigin;
use super::regime::Regime;
use super::set_point::{Equilibria, SetPoint};
use super::step::{CondensedCone, CondensedQp, Step, StepStatus};
use super::terminal_cost::ExtraCost;
use crate::analysis::ProgramRow;
use crate::error::{DesignError, StepError};
use crate::linalg::Dense;
use crate::optimization::Failure;
use crate::problem::{Formulation, Task};
use crate::terminal::TerminalIngredients;
use std::fmt;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

mod describe;
mod program;

/// A controller with its guarantees.
///
/// ```
/// use mpct::{Constraints, Controller, DesignOptions, Matrix, Plant, Problem, SetPoint, TerminalIngredients, Weights};
/// let plant = Plant::discrete(
///     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
///     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// )?;
/// let constraints = Constraints::new(2, 2)
///     .state_bounds(&[-3.0; 2], &[3.0; 2])?
///     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
/// let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?;
/// let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
/// let mut controller = Controller::new(ingredients)?;
/// let step = controller.step(&[0.0, 0.0], &SetPoint::state([2.0, 0.0]))?;
/// assert!(step.admissible);
/// assert!(step.input.iter().all(|u| u.abs() <= 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Controller {
    ingredients: TerminalIngredients,
    formulation: Formulation,
    solver: Regime,
    /// Where each row of the program comes from.
    origin: Vec<RowOrigin>,
    /// The same for its cones; rows are ellipsoids there.
    cone_origin: Vec<RowOrigin>,
    /// The Hessian of the cost in the state.
    state_hessian: OnceLock<Dense>,
    /// What the cost has besides (10).
    extra: Option<ExtraCost>,
    limits: Limits,
    /// Finds the closest admissible equilibrium, to say whether a set-point is admissible.
    equilibria: Option<Equilibria>,
    /// The last set-point asked for, and whether it is admissible.
    known: Option<(SetPoint, bool)>,
}

impl fmt::Debug for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Controller")
            .field("problem", &self.ingredients.problem().name())
            .field("formulation", &self.formulation)
            .field("terminal_horizon", &self.ingredients.terminal_horizon())
            .field("variables", &self.variables())
            .field("rows", &self.rows())
            .finish_non_exhaustive()
    }
}

impl Controller {
    /// A controller for the formulation and task of the problem.
    ///
    /// # Errors
    /// [`DesignError::Solver`] when the explicit set or the program cannot be formed.
    pub fn new(ingredients: TerminalIngredients) -> Result<Self, DesignError> {
        let formulation = ingredients.problem().formulation();
        Self::with_formulation(ingredients, formulation)
    }

    /// A controller with another formulation than the problem names.
    ///
    /// # Errors
    /// As [`Controller::new`].
    pub fn with_formulation(
        ingredients: TerminalIngredients,
        formulation: Formulation,
    ) -> Result<Self, DesignError> {
        let problem = ingredients.problem();
        let online = Regime::choose(&ingredients, formulation)?;
        let equilibria = match problem.task() {
            Task::Tracking => Some(Equilibria::new(problem, ingredients.steady_states())?),
            Task::Regulation => None,
        };
        Ok(Self {
            solver: online.solver,
            cone_origin: online.cone_origin,
            ingredients,
            formulation,
            origin: online.origin,
            state_hessian: online.state_hessian,
            extra: online.extra,
            limits: Limits::default(),
            equilibria,
            known: None,
        })
    }

    /// Ends every step after this many iterations, or this time, with the shifted candidate (32) or a better point;
    /// `None` is no limit. The candidate is feasible whenever the state is where the last step predicted it.
    pub fn set_limits(&mut self, iterations: Option<u32>, time: Option<Duration>) {
        self.limits = Limits { iterations, time };
    }

    /// The terminal ingredients.
    pub fn ingredients(&self) -> &TerminalIngredients {
        &self.ingredients
    }

    /// The formulation of this controller.
    pub fn formulation(&self) -> Formulation {
        self.formulation
    }

    /// Variables of the quadratic program.
    pub fn variables(&self) -> usize {
        self.solver.variables()
    }

    /// Second-order cones of the quadratic program: none without ellipsoids.
    pub fn cones(&self) -> usize {
        self.solver.cones().len()
    }

    /// Rows of the quadratic program.
    pub fn rows(&self) -> usize {
        self.solver.rows()
    }

    /// Forgets the last step; the next one has no candidate to fall back on.
    pub fn reset(&mut self) {
        self.solver.reset();
    }

    /// The input for a measured state and a set-point, both in physical coordinates.
    ///
    /// The set-point may be anything finite: when it is not admissible the controller goes to the closest equilibrium
    /// that is.
    ///
    /// # Errors
    /// [`StepError::WrongLength`], [`StepError::StateNotFinite`], [`StepError::SetPointNotFinite`];
    /// [`StepError::Infeasible`] with a checked proof; [`StepError::IterationLimit`] when the solver failed and the
    /// shifted candidate does not fit the measured state.
    pub fn step(&mut self, state: &[f64], set_point: &SetPoint) -> Result<Step, StepError> {
        let started = Instant::now();
        let (x, r) = self.shifted(state, set_point)?;
        let answer = self
            .solver
            .solve(&x, &r, self.limits)
            .map_err(|failure| match failure {
                Failure::Infeasible(proof) => StepError::Infeasible {
                    gap: proof.gap,
                    radius: proof.radius,
                },
                Failure::Unsolved {
                    iterations,
                    residual,
                } => StepError::IterationLimit {
                    iterations,
                    residual,
                },
            })?;
        let admissible = self.is_admissible(set_point);
        let mut step = self.describe(&x, &r, &answer.z);
        let at = &self.ingredients.problem().plant().operating_point().input;
        for ((u, v), o) in step.input.iter_mut().zip(&answer.input).zip(at) {
            *u = v + o;
        }
        if answer.why.is_none()
            && let Some(first) = step.predicted_inputs.first_mut()
        {
            first.clone_from(&step.input);
        }
        step.status = answer
            .why
            .map_or(StepStatus::Optimal, |why| StepStatus::Candidate(why.into()));
        step.violation = answer.violation;
        step.iterations = answer.iterations;
        step.admissible = admissible;
        step.elapsed = started.elapsed();
        Ok(step)
    }

    /// The quadratic program that a step at this state and set-point solves.
    ///
    /// # Errors
    /// [`StepError::WrongLength`], [`StepError::StateNotFinite`], [`StepError::SetPointNotFinite`].
    pub fn qp(&self, state: &[f64], set_point: &SetPoint) -> Result<CondensedQp, StepError> {
        let (x, r) = self.shifted(state, set_point)?;
        let (linear, bounds) = self.solver.linear_and_bounds(&x, &r);
        Ok(CondensedQp {
            hessian: crate::linalg::to_matrix(&self.solver.program().hessian),
            linear,
            rows: crate::linalg::to_matrix(&self.solver.program().rows),
            bounds,
            cones: self
                .solver
                .cones()
                .iter()
                .map(|c| CondensedCone {
                    map: crate::linalg::to_matrix(&c.map),
                    offset: c.offset_at(&x),
                })
                .collect(),
        })
    }

    /// The rows of the program and their multipliers y ≥ 0 that proved the last step infeasible: Gᵀy ≈ 0 and b(x)ᵀy < 0, so that no z has
    /// G z ≤ b(x). Empty unless the last step was [`StepError::Infeasible`] by the proof of the controller's own solver; indices are those
    /// of [`Controller::qp`]. Empty with ellipsoids, whose proofs have vectors too.
    ///
    /// ```
    /// # use mpct::{cases, Controller, DesignOptions, SetPoint, StepError, TerminalIngredients};
    /// let ingredients = TerminalIngredients::design(&cases::academic().problem, &DesignOptions::default())?;
    /// let mut controller = Controller::new(ingredients)?;
    /// let (state, set_point) = ([2.9, 2.9], SetPoint::state([0.0, 0.0]));
    /// assert!(matches!(controller.step(&state, &set_point), Err(StepError::Infeasible { .. })));
    /// let bounds = controller.qp(&state, &set_point)?.bounds;
    /// let proof = controller.infeasibility_proof();
    /// assert!(proof.iter().all(|(_, _, y)| *y >= 0.0));
    /// assert!(proof.iter().map(|(row, _, y)| bounds[*row] * y).sum::<f64>() < 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn infeasibility_proof(&self) -> Vec<(usize, ProgramRow, f64)> {
        let proof = self.solver.proof();
        if proof.is_empty() {
            return Vec::new();
        }
        let names = self.program_row_names();
        proof.iter().map(|&(i, y)| (i, names[i], y)).collect()
    }

    /// The tables of the online program and their sizes, for a controller of [`crate::runtime`] that runs without the desk: the state and
    /// the set-point (state, then input) in shifted coordinates, x − x_op, and the input likewise. `None` for plants of many subsystems and
    /// with ellipsoids: their programs are not dense quadratic ones. Where they take no more than 8 000 numbers, the products of rows
    /// ([`prepare_gram`](mpct_runtime::prepare_gram)) follow the tables.
    ///
    /// ```
    /// # use mpct::{cases, Controller, DesignOptions, SetPoint, TerminalIngredients};
    /// use mpct::runtime::{self, Budget, Tables, Workspace};
    /// let ingredients = TerminalIngredients::design(&cases::academic().problem, &DesignOptions::default())?;
    /// let mut desk = Controller::new(ingredients)?;
    /// let (dims, numbers) = desk.runtime_tables().ok_or("no tables")?;
    /// let (mut memory, mut indices) = (vec![0.0; dims.workspace_len()], vec![0; dims.index_len()]);
    /// let tables = Tables::from_slice(dims, numbers)?;
    /// let workspace = Workspace::new(dims, &mut memory, &mut indices)?;
    /// let mut target = runtime::Controller::new(tables, workspace)?;
    /// let u = target.step(&[-2.0, 0.5], &[1.0, 0.0, 0.0, 0.0], Budget::unlimited())?.input.to_vec();
    /// assert_eq!(u, desk.step(&[-2.0, 0.5], &SetPoint::state([1.0, 0.0]))?.input);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn runtime_tables(&self) -> Option<(mpct_runtime::Dims, &[f64])> {
        self.solver.tables()
    }

    /// The same for plants of many subsystems: the tables of a [`BandedController`](mpct_runtime::banded::BandedController), which takes the
    /// state and the set-point as [`Controller::runtime_tables`] says. `None` where the program is dense or has ellipsoids.
    ///
    /// ```
    /// # use mpct::{cases, Controller, DesignOptions, SetPoint, TerminalIngredients};
    /// use mpct::runtime::{banded::BandedController, Budget};
    /// let ingredients = TerminalIngredients::design(&cases::carts(40)?.problem, &DesignOptions::default())?;
    /// let mut desk = Controller::new(ingredients)?;
    /// let tables = desk.runtime_banded_tables().ok_or("no banded tables")?;
    /// let (numbers, indices) = (vec![0.0; tables.workspace_len()], vec![0; tables.index_len()]);
    /// let mut target = BandedController::new(&tables, numbers, indices)?;
    /// let (x, r) = (vec![0.1; 80], vec![0.0; 80 + 40]);
    /// let u = target.step(&tables, &x, &r, Budget::unlimited())?.input.to_vec();
    /// assert_eq!(u, desk.step(&x, &SetPoint::state(vec![0.0; 80]))?.input);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn runtime_banded_tables(&self) -> Option<mpct_runtime::banded::BandedTables<'_, f64>> {
        self.solver.banded_tables()
    }

    /// Checked and shifted state and set-point (state, input).
    fn shifted(
        &self,
        state: &[f64],
        set_point: &SetPoint,
    ) -> Result<(Vec<f64>, Vec<f64>), StepError> {
        let plant = self.ingredients.problem().plant();
        let (n, m) = (plant.states(), plant.inputs());
        let length = |what, v: &[f64], expected| {
            if v.len() == expected {
                Ok(())
            } else {
                Err(StepError::WrongLength {
                    what,
                    expected,
                    found: v.len(),
                })
            }
        };
        length("the state", state, n)?;
        length("the set-point's state", &set_point.state, n)?;
        if let Some(u) = &set_point.input {
            length("the set-point's input", u, m)?;
        }
        if let Some(index) = state.iter().position(|v| !v.is_finite()) {
            return Err(StepError::StateNotFinite {
                index,
                value: state[index],
            });
        }
        let at = plant.operating_point();
        let x = state.iter().zip(&at.state).map(|(x, o)| x - o).collect();
        let mut r: Vec<f64> = set_point
            .state
            .iter()
            .zip(&at.state)
            .map(|(x, o)| x - o)
            .collect();
        match &set_point.input {
            Some(u) => r.extend(u.iter().zip(&at.input).map(|(u, o)| u - o)),
            None => r.extend(std::iter::repeat_n(0.0, m)),
        }
        if let Some(index) = r.iter().position(|v| !v.is_finite()) {
            let value = if index < n {
                set_point.state[index]
            } else {
                set_point.input.as_ref().map_or(f64::NAN, |u| u[index - n])
            };
            return Err(StepError::SetPointNotFinite { index, value });
        }
        Ok((x, r))
    }

    fn is_admissible(&mut self, set_point: &SetPoint) -> bool {
        if let Some((known, admissible)) = &self.known
            && known == set_point
        {
            return *admissible;
        }
        let problem = self.ingredients.problem();
        let admissible = match problem.task() {
            Task::Regulation => set_point.state == problem.plant().operating_point().state,
            Task::Tracking => match &mut self.equilibria {
                Some(equilibria) => equilibria
                    .is_admissible(problem, self.ingredients.steady_states(), set_point)
                    .unwrap_or(false),
                None => false,
            },
        };
        self.known = Some((set_point.clone(), admissible));
        admissible
    }
}
