//! The set-point service: which λ a set-point needs, and what that λ costs in terminal horizon.
//!
//! A set-point is admissible when it is an equilibrium (M_θx θ, M_θu θ) with θ ∈ λΘ, that is w_iθ ≤ λ for every row. So the
//! smallest λ that admits it is max_i w_iθ; no search is needed. Where several inputs hold the same state, the one with
//! the smallest maximum counts (a linear program). The paper's advice after Table 1: choose the smallest λ that admits
//! the set-points of interest, for M̃ falls with it. An ellipsoid asks for ‖Wθ + λh‖ ≤ λ, with ‖h‖ < 1 the larger root of
//! (1 − ‖h‖²) λ² − 2 hᵀWθ λ − ‖Wθ‖² = 0.

use super::program::failure;
use crate::control::{AdmissibleSetPoint, SetPoint};
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::optimization::Body;
use crate::problem::{NormConstraint, Problem, RowSource, Task};
use crate::steady_state::SteadyStates;
use crate::terminal::{DesignOptions, TerminalIngredients};
use serde::Serialize;

/// A set-point is an equilibrium when the closest one is nearer than this, relative to its size and in the weight of the
/// offset cost: the distance at which closed loops are said to have arrived.
const EQUILIBRIUM: f64 = 1e-7;
/// A row limits a set-point when w_iθ is within this of the largest.
const LIMITING: f64 = 1e-9;
/// λ is not advised below this: the terminal horizon no longer falls, and set-points near the origin stay reachable.
pub const SMALLEST_SCALING: f64 = 0.01;
/// The advised λ exceeds the needed one by this relative margin, so that rounding does not refuse the set-point.
const MARGIN: f64 = 1e-6;

/// What one set-point needs.
#[derive(Clone, Debug, PartialEq)]
pub struct ScalingNeed {
    /// The set-point, in physical coordinates.
    pub set_point: SetPoint,
    /// Whether it is an equilibrium of the plant at all; if not, no λ admits it.
    pub equilibrium: bool,
    /// The smallest λ that admits it, or its closest equilibrium when it is none. From 1 on no design admits it: it
    /// violates a constraint, or lies on it.
    pub needed: f64,
    /// The rows that are active there for that λ.
    pub limiting: Vec<RowSource>,
    /// By how much λ would have to grow; 0 when it is large enough.
    pub grow_by: f64,
    /// The closest admissible equilibrium for the problem's λ.
    pub closest: AdmissibleSetPoint,
}

/// The smallest λ that admits a list of set-points, and what it costs.
#[derive(Clone, Debug, PartialEq)]
pub struct ScalingAdvice {
    /// Set-point by set-point.
    pub needs: Vec<ScalingNeed>,
    /// The problem's λ.
    pub scaling: f64,
    /// Its terminal horizon.
    pub terminal_horizon: usize,
    /// The smallest λ in (0, 1) that admits every set-point that some λ admits.
    pub advised: f64,
    /// Its terminal horizon.
    pub advised_horizon: usize,
}

impl ScalingNeed {
    /// Whether some λ < 1 admits the set-point.
    pub fn is_attainable(&self) -> bool {
        self.equilibrium && self.needed < 1.0 - LIMITING
    }
}

/// What a set-point needs.
///
/// ```
/// use mpct::{SetPoint, analysis::scaling_need};
/// let problem = mpct::cases::academic().problem;
/// let need = scaling_need(&problem, &SetPoint::state([2.85, 0.0]))?;
/// assert!((need.needed - 0.95).abs() < 1e-6 && (need.grow_by - 0.05).abs() < 1e-6);
/// assert_eq!(need.limiting[0].to_string(), "state_upper[0]");
/// # Ok::<(), mpct::DesignError>(())
/// ```
///
/// # Errors
/// [`DesignError::Shape`], [`DesignError::NotFinite`] for the set-point; [`DesignError::NotStabilizable`];
/// [`DesignError::Solver`].
pub fn scaling_need(problem: &Problem, set_point: &SetPoint) -> Result<ScalingNeed, DesignError> {
    if problem.task() == Task::Regulation {
        return Err(DesignError::OutOfRange {
            what: "controller.task".into(),
            expected: "\"tracking\": regulation has one set-point and no scaling".into(),
            found: "\"regulation\"".into(),
        });
    }
    let steady = SteadyStates::of(problem)?;
    let closest = steady.closest_admissible(problem, set_point)?;
    let nearest = nearest_equilibrium(problem, &steady, set_point)?;
    let rows = problem.rows();
    let w = rows
        .c
        .mul(steady.state_basis())
        .combine(1.0, &rows.d.mul(steady.input_basis()), 1.0);
    let values = w.mul_vec(&nearest.theta);
    let norms = problem.norms().iter();
    let values: Vec<(RowSource, f64)> = rows
        .source
        .iter()
        .copied()
        .zip(values)
        .chain(norms.map(|b| (b.source, needed_by_norm(b, &steady, &nearest.theta))))
        .collect();
    let needed = values.iter().fold(0.0_f64, |a, v| a.max(v.1));
    let limiting = values
        .iter()
        .filter(|v| needed > 0.0 && v.1 >= needed - LIMITING)
        .map(|v| v.0)
        .collect();
    Ok(ScalingNeed {
        set_point: set_point.clone(),
        equilibrium: nearest.distance <= EQUILIBRIUM,
        needed,
        limiting,
        grow_by: (needed - problem.scaling()).max(0.0),
        closest,
    })
}

/// The smallest λ with ‖Wθ + λh‖ ≤ λ.
fn needed_by_norm(bound: &NormConstraint, steady: &SteadyStates, theta: &[f64]) -> f64 {
    let x = steady.state_basis().mul_vec(theta);
    let u = steady.input_basis().mul_vec(theta);
    let (mut square, mut along, mut offset) = (0.0, 0.0, 0.0);
    for (k, h) in bound.offset.iter().enumerate() {
        let v = bound.f.row_dot(k, &x) + bound.g.row_dot(k, &u);
        square += v * v;
        along += v * h;
        offset += h * h;
    }
    let room = 1.0 - offset;
    (along + (along * along + room * square).sqrt()) / room
}

/// The smallest λ that admits the set-points, with the terminal horizon for it and for the problem's own.
///
/// Set-points that no λ admits are listed, and do not count.
///
/// # Errors
/// [`DesignError::OutOfRange`] for an empty list; those of [`scaling_need`] and of
/// [`TerminalIngredients::design`].
pub fn scaling_advice(
    problem: &Problem,
    set_points: &[SetPoint],
    options: &DesignOptions<'_>,
) -> Result<ScalingAdvice, DesignError> {
    if set_points.is_empty() {
        return Err(DesignError::OutOfRange {
            what: "the list of set-points".into(),
            expected: "at least one".into(),
            found: "none".into(),
        });
    }
    let needs = set_points
        .iter()
        .map(|s| scaling_need(problem, s))
        .collect::<Result<Vec<_>, _>>()?;
    let largest = needs
        .iter()
        .filter(|n| n.is_attainable())
        .fold(0.0_f64, |a, n| a.max(n.needed));
    // Halfway to 1 when the margin would pass it.
    let advised = (largest * (1.0 + MARGIN))
        .min(0.5 * (1.0 + largest))
        .max(SMALLEST_SCALING);
    let horizon = |scaling: f64| -> Result<usize, DesignError> {
        let problem = problem.clone().with_scaling(scaling)?;
        Ok(TerminalIngredients::design(&problem, options)?.terminal_horizon())
    };
    Ok(ScalingAdvice {
        scaling: problem.scaling(),
        terminal_horizon: horizon(problem.scaling())?,
        advised,
        advised_horizon: horizon(advised)?,
        needs,
    })
}

struct Nearest {
    theta: Vec<f64>,
    /// Relative distance in the weight of the offset cost.
    distance: f64,
}

/// The equilibrium nearest to a set-point without any constraint, and among those with the same state the one that
/// needs the smallest λ.
fn nearest_equilibrium(
    problem: &Problem,
    steady: &SteadyStates,
    set_point: &SetPoint,
) -> Result<Nearest, DesignError> {
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let at = problem.plant().operating_point();
    let xr = Dense::from_fn(n, 1, |i, _| set_point.state[i] - at.state[i]);
    let (mx, mu) = (
        linalg::dense(steady.state_basis()),
        linalg::dense(steady.input_basis()),
    );
    // ‖L_Oᵀ (M_θx θ − x_r)‖ over θ, by singular values. As in the offset cost, a stated input counts when O_input is
    // stated; here with the weight R, which changes nothing where the set-point is an equilibrium.
    let l = linalg::cholesky("weights.O", &linalg::dense(problem.offset_weight()))?;
    let mut map = l.transpose() * &mx;
    let mut right = l.transpose() * &xr;
    if let (Some(u), true) = (
        &set_point.input,
        problem.offset_input_weight().nonzeros() > 0,
    ) {
        let lr = linalg::cholesky("weights.R", &linalg::dense(problem.input_weight()))?;
        let (mu, ur) = (
            lr.transpose() * &mu,
            lr.transpose() * Dense::from_fn(m, 1, |i, _| u[i] - at.input[i]),
        );
        map = Dense::from_fn(
            n + m,
            m,
            |i, j| if i < n { map[(i, j)] } else { mu[(i - n, j)] },
        );
        right = Dense::from_fn(
            n + m,
            1,
            |i, _| if i < n { right[(i, 0)] } else { ur[(i - n, 0)] },
        );
    }
    // Zero rows make the map tall: the singular vectors then span every direction of θ.
    if map.nrows() < m {
        let (old, old_right) = (map, right);
        let rows = old.nrows();
        map = Dense::from_fn(m, m, |i, j| if i < rows { old[(i, j)] } else { 0.0 });
        right = Dense::from_fn(m, 1, |i, _| if i < rows { old_right[(i, 0)] } else { 0.0 });
    }
    let (u, s, v) = linalg::svd("the equilibria", &map)?;
    let largest = s.first().copied().unwrap_or(0.0);
    let mut theta = vec![0.0; m];
    let mut kernel = Vec::new();
    for k in 0..m {
        if s[k] > 1e-9 * largest {
            let along: f64 = (0..map.nrows()).map(|i| u[(i, k)] * right[(i, 0)]).sum();
            for t in 0..m {
                theta[t] += v[(t, k)] * along / s[k];
            }
        } else {
            kernel.push(k);
        }
    }
    let residual = &map * Dense::from_fn(m, 1, |t, _| theta[t]) - &right;
    let distance = residual.norm_l2() / right.norm_l2().max(f64::MIN_POSITIVE);
    if !kernel.is_empty() {
        spread(
            problem,
            steady,
            &mut theta,
            &Dense::from_fn(m, kernel.len(), |t, k| v[(t, kernel[k])]),
        )?;
    }
    Ok(Nearest {
        distance: if right.norm_l2() == 0.0 {
            0.0
        } else {
            distance
        },
        theta,
    })
}

/// Moves θ along `free` until max_i w_iθ is smallest.
fn spread(
    problem: &Problem,
    steady: &SteadyStates,
    theta: &mut [f64],
    free: &Dense,
) -> Result<(), DesignError> {
    let rows = problem.rows();
    let w = rows
        .c
        .mul(steady.state_basis())
        .combine(1.0, &rows.d.mul(steady.input_basis()), 1.0);
    let along = linalg::dense(&w) * free;
    let values = w.mul_vec(theta);
    let size = values.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    if size == 0.0 {
        return Ok(());
    }
    if !problem.norms().is_empty() {
        return Err(DesignError::OutOfRange {
            what: "the scaling that a set-point needs".into(),
            expected: "one input for each equilibrium state; with several, the choice among them is not made with ellipsoids".into(),
            found: format!("{} free directions of the input", free.ncols()),
        });
    }
    // The deepest point of {w (θ + free s) ≤ 2 size}: the depth is at most 1 there after division by 4 size.
    let unit = 4.0 * size;
    let body = Body {
        rows: along,
        bounds: values.iter().map(|v| 0.5 - v / unit).collect(),
        balls: Vec::new(),
    };
    let deepest = body
        .deepest()
        .map_err(|e| failure("the smallest scaling", "an equilibrium input", e))?;
    for (t, value) in theta.iter_mut().enumerate() {
        *value += (0..free.ncols())
            .map(|k| free[(t, k)] * deepest.point[k] * unit)
            .sum::<f64>();
    }
    Ok(())
}

impl Serialize for ScalingNeed {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut s = serializer.serialize_struct("ScalingNeed", 8)?;
        let rows = |r: &[RowSource]| -> Vec<String> { r.iter().map(ToString::to_string).collect() };
        s.serialize_field("set_point", &self.set_point.state)?;
        s.serialize_field("equilibrium", &self.equilibrium)?;
        s.serialize_field("attainable", &self.is_attainable())?;
        s.serialize_field("needed", &self.needed)?;
        s.serialize_field("limiting", &rows(&self.limiting))?;
        s.serialize_field("grow_by", &self.grow_by)?;
        s.serialize_field("closest", &self.closest.state)?;
        s.serialize_field("offset_cost", &self.closest.offset_cost)?;
        s.end()
    }
}

impl Serialize for ScalingAdvice {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut s = serializer.serialize_struct("ScalingAdvice", 5)?;
        s.serialize_field("set_points", &self.needs)?;
        s.serialize_field("scaling", &self.scaling)?;
        s.serialize_field("terminal_horizon", &self.terminal_horizon)?;
        s.serialize_field("advised_scaling", &self.advised)?;
        s.serialize_field("advised_terminal_horizon", &self.advised_horizon)?;
        s.end()
    }
}
