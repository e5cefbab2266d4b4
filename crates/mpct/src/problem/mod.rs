//! A problem: plant, constraints, weights and the choices of the controller, checked once at the door.

mod constraints;
mod discretise;
mod ellipsoid;
pub mod file;
mod formulation;
pub(crate) mod plant;
mod weights;

pub use constraints::{ConstraintRows, Constraints, MixedRows, RowSource};
pub use ellipsoid::{Ellipsoid, EllipsoidShape, NormConstraint};
pub use formulation::{Formulation, NoTerminalConstraint, TerminalCost};
pub use plant::{Labels, OperatingPoint, Plant};
pub use weights::{Weight, Weights};

use crate::error::DesignError;
use crate::matrix::{Matrix, SparseMatrix};
use serde::{Deserialize, Serialize};
use weights::Definite;

/// What the controller is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Task {
    /// Set-points that jump (section 3.2).
    #[default]
    Tracking,
    /// The origin (the operating point) only (section 3.1).
    Regulation,
}

/// A checked problem, in shifted coordinates.
///
/// ```
/// use mpct::{Constraints, Matrix, Plant, Problem, Weights};
/// let plant = Plant::discrete(
///     Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
///     Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
/// )?;
/// let constraints = Constraints::new(2, 2)
///     .state_bounds(&[-3.0; 2], &[3.0; 2])?
///     .input_bounds(&[-2.0; 2], &[2.0; 2])?;
/// let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))?
///     .with_prediction_horizon(10)?
///     .with_scaling(0.9)?;
/// assert_eq!(problem.rows().len(), 8);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    name: String,
    plant: Plant,
    constraints: Constraints,
    rows: ConstraintRows,
    norms: Vec<NormConstraint>,
    q: SparseMatrix,
    r: SparseMatrix,
    o: SparseMatrix,
    o_input: SparseMatrix,
    task: Task,
    formulation: Formulation,
    terminal_cost: TerminalCost,
    no_terminal_constraint: Option<NoTerminalConstraint>,
    prediction_horizon: usize,
    scaling: f64,
    gain: Option<SparseMatrix>,
}

/// λ when none is stated.
pub const DEFAULT_SCALING: f64 = 0.9;
/// N when none is stated.
pub const DEFAULT_PREDICTION_HORIZON: usize = 10;
/// Largest N. The program of a step is dense in N m variables; beyond this no memory holds it.
pub const MAX_PREDICTION_HORIZON: usize = 10_000;

impl Problem {
    /// A tracking problem with the default horizon and scaling.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`], [`DesignError::NotSymmetric`],
    /// [`DesignError::NotPositiveDefinite`], [`DesignError::OriginNotInterior`].
    pub fn new(
        plant: Plant,
        constraints: Constraints,
        weights: Weights,
    ) -> Result<Self, DesignError> {
        let (n, m) = (plant.states(), plant.inputs());
        if (constraints.states(), constraints.inputs()) != (n, m) {
            return Err(DesignError::Shape {
                what: "constraints".into(),
                expected: format!("{n} states and {m} inputs, as the plant has"),
                found: format!("{} and {}", constraints.states(), constraints.inputs()),
            });
        }
        let rows = constraints.normalised(plant.operating_point())?;
        let norms = constraints.norms(plant.operating_point())?;
        Ok(Self {
            name: String::new(),
            q: weights
                .state
                .to_matrix("weights.Q", n, Definite::Positive)?,
            r: weights
                .input
                .to_matrix("weights.R", m, Definite::Positive)?,
            o: weights
                .offset
                .to_matrix("weights.O", n, Definite::Positive)?,
            o_input: match &weights.offset_input {
                Some(w) => w.to_matrix("weights.O_input", m, Definite::NonNegative)?,
                None => SparseMatrix::zeros(m, m),
            },
            plant,
            constraints,
            rows,
            norms,
            task: Task::default(),
            formulation: Formulation::default(),
            terminal_cost: TerminalCost::default(),
            no_terminal_constraint: None,
            prediction_horizon: DEFAULT_PREDICTION_HORIZON,
            scaling: DEFAULT_SCALING,
            gain: None,
        })
    }

    /// Names the problem, for reports.
    pub fn with_name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Chooses the task.
    pub fn with_task(mut self, task: Task) -> Self {
        self.task = task;
        self
    }

    /// Chooses the formulation.
    pub fn with_formulation(mut self, formulation: Formulation) -> Self {
        self.formulation = formulation;
        self
    }

    /// Chooses the formulation of section 3.5, with M̄, γ and α.
    pub fn with_no_terminal_constraint(mut self, choices: NoTerminalConstraint) -> Self {
        self.formulation = Formulation::NoTerminalConstraint;
        self.no_terminal_constraint = Some(choices);
        self
    }

    /// Chooses the terminal cost.
    pub fn with_terminal_cost(mut self, cost: TerminalCost) -> Self {
        self.terminal_cost = cost;
        self
    }

    /// Sets N ≥ 1.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`].
    pub fn with_prediction_horizon(mut self, steps: usize) -> Result<Self, DesignError> {
        if (1..=MAX_PREDICTION_HORIZON).contains(&steps) {
            self.prediction_horizon = steps;
            Ok(self)
        } else {
            Err(DesignError::OutOfRange {
                what: "controller.prediction_horizon".into(),
                expected: format!("a whole number of steps >= 1, at most {MAX_PREDICTION_HORIZON}"),
                found: steps.to_string(),
            })
        }
    }

    /// Sets λ in (0, 1), the scaling of Θ (12).
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`].
    pub fn with_scaling(mut self, scaling: f64) -> Result<Self, DesignError> {
        if scaling > 0.0 && scaling < 1.0 {
            self.scaling = scaling;
            Ok(self)
        } else {
            Err(DesignError::OutOfRange {
                what: "controller.scaling".into(),
                expected: "a number strictly between 0 and 1".into(),
                found: scaling.to_string(),
            })
        }
    }

    /// Sets the gain K (m × n) of the terminal law u = K x + L θ. The default is the LQR gain.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`]. That A + B K is Schur is checked by the design.
    pub fn with_gain(mut self, gain: Matrix) -> Result<Self, DesignError> {
        let (n, m) = (self.plant.states(), self.plant.inputs());
        if (gain.rows(), gain.cols()) != (m, n) {
            return Err(DesignError::Shape {
                what: "controller.gain".into(),
                expected: format!("{m} x {n}"),
                found: format!("{} x {}", gain.rows(), gain.cols()),
            });
        }
        let gain = SparseMatrix::from(gain);
        plant::check_finite("controller.gain", &gain)?;
        self.gain = Some(gain);
        Ok(self)
    }

    /// The name, empty when none was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The plant.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The constraints in physical coordinates.
    pub fn constraints(&self) -> &Constraints {
        &self.constraints
    }

    /// The constraints in shifted coordinates, normalised.
    pub fn rows(&self) -> &ConstraintRows {
        &self.rows
    }

    /// The ellipsoids in shifted coordinates, as norms ‖F x + G u + h‖ ≤ 1.
    pub fn norms(&self) -> &[NormConstraint] {
        &self.norms
    }

    /// Q, n × n.
    pub fn state_weight(&self) -> &SparseMatrix {
        &self.q
    }

    /// R, m × m.
    pub fn input_weight(&self) -> &SparseMatrix {
        &self.r
    }

    /// O, n × n.
    pub fn offset_weight(&self) -> &SparseMatrix {
        &self.o
    }

    /// O_input, m × m; zero unless stated.
    pub fn offset_input_weight(&self) -> &SparseMatrix {
        &self.o_input
    }

    /// The task.
    pub fn task(&self) -> Task {
        self.task
    }

    /// The formulation.
    pub fn formulation(&self) -> Formulation {
        self.formulation
    }

    /// The terminal cost.
    pub fn terminal_cost(&self) -> TerminalCost {
        self.terminal_cost
    }

    /// The choices of section 3.5, when stated.
    pub fn no_terminal_constraint(&self) -> Option<NoTerminalConstraint> {
        self.no_terminal_constraint
    }

    /// N.
    pub fn prediction_horizon(&self) -> usize {
        self.prediction_horizon
    }

    /// λ.
    pub fn scaling(&self) -> f64 {
        self.scaling
    }

    /// The user's gain K, when stated.
    pub fn gain(&self) -> Option<&SparseMatrix> {
        self.gain.as_ref()
    }
}
