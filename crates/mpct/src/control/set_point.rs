//! Set-points, and the admissible equilibrium closest to one.

use super::conic::ProgramCone;
use super::online::{Limits, Program, beyond};
use super::regime::Regime;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use crate::optimization::{Failure, norm};
use crate::problem::plant::check_vector;
use crate::problem::{Problem, RowSource};
use crate::steady_state::SteadyStates;

/// A set-point (x_s^r, u_s^r) in physical coordinates.
///
/// The input takes part in the offset cost only when `O_input` is stated, or to choose among equilibria with the same
/// state. It need not be an equilibrium, nor admissible.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPoint {
    /// x_s^r, length n.
    pub state: Vec<f64>,
    /// u_s^r, length m; the operating point's input unless stated.
    pub input: Option<Vec<f64>>,
}

impl SetPoint {
    /// A set-point for the state.
    pub fn state(state: impl Into<Vec<f64>>) -> Self {
        Self {
            state: state.into(),
            input: None,
        }
    }
}

impl From<Vec<f64>> for SetPoint {
    fn from(state: Vec<f64>) -> Self {
        Self { state, input: None }
    }
}

/// The admissible equilibrium closest to a set-point in the offset cost, in physical coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct AdmissibleSetPoint {
    /// Its state.
    pub state: Vec<f64>,
    /// Its input.
    pub input: Vec<f64>,
    /// θ.
    pub parameter: Vec<f64>,
    /// ‖x_s − x_s^r‖²_O + ‖u_s − u_s^r‖²_{O_input}.
    pub offset_cost: f64,
    /// Whether the set-point itself is admissible: an equilibrium inside λ times the constraints.
    pub admissible: bool,
    /// The rows of λΘ that are active there.
    pub limiting: Vec<RowSource>,
}

/// Weight, relative to R, by which the input of least distance is chosen among equilibria with equal states. Small
/// enough not to move a state: the offset cost outweighs it by the ratio of O to this times R.
const TIE_BREAK: f64 = 1e-6;
/// A singular value of M_θx below this, relative to the largest, means equilibria that differ in the input alone.
const SAME_STATE: f64 = 1e-9;
/// An offset cost at most this is zero, relative to that of the way from the operating point to the set-point or to a
/// constraint: the square of the distance at which closed loops are said to have arrived, 1e-6, less two digits.
const ADMISSIBLE: f64 = 1e-14;
/// A row of λΘ is limiting when its slack is below this (right-hand sides are 1).
const ACTIVE: f64 = 1e-7;

/// The offset cost as a quadratic in θ: ½ θᵀ H θ − (F_x x_r + F_u u_r)ᵀ θ + const, all in shifted coordinates.
#[derive(Clone, Debug)]
pub(crate) struct OffsetCost {
    /// 2 (M_θxᵀ O M_θx + M_θuᵀ T M_θu).
    pub(crate) hessian: Dense,
    /// 2 M_θxᵀ O, m × n.
    pub(crate) from_state: Dense,
    /// 2 M_θuᵀ T, m × m.
    pub(crate) from_input: Dense,
    /// Whether T has a part that only chooses among equilibria with equal states.
    pub(crate) is_tied: bool,
}

impl OffsetCost {
    pub(crate) fn of(problem: &Problem, steady: &SteadyStates) -> Result<Self, DesignError> {
        let mx = linalg::dense(steady.state_basis());
        let mu = linalg::dense(steady.input_basis());
        let o = linalg::dense(problem.offset_weight());
        let mut t = linalg::dense(problem.offset_input_weight());
        let tie = tie_break(problem, &mx, &mu)?;
        let is_tied = tie.is_some();
        if let Some(tie) = tie {
            t = &t + tie;
        }
        let two = faer::Scale(2.0);
        let from_state = mx.transpose() * &o * two;
        let from_input = mu.transpose() * &t * two;
        Ok(Self {
            hessian: linalg::symmetrised(&(&from_state * &mx + &from_input * &mu)),
            from_state,
            from_input,
            is_tied,
        })
    }
}

/// The weight TIE_BREAK · Pᵀ R P with P the projection on the inputs that leave the equilibrium state alone; `None`
/// when M_θx has full column rank.
fn tie_break(problem: &Problem, mx: &Dense, mu: &Dense) -> Result<Option<Dense>, DesignError> {
    let m = mx.ncols();
    // Large plants with one equilibrium state an input are the rule; a Cholesky factorisation tells at once.
    let gram = mx.transpose() * mx;
    let scale: Vec<f64> = (0..m).map(|j| gram[(j, j)].sqrt()).collect();
    if scale.iter().all(|&s| s > 0.0) {
        let correlation = Dense::from_fn(m, m, |i, j| {
            gram[(i, j)] / (scale[i] * scale[j]) - if i == j { SAME_STATE } else { 0.0 }
        });
        if linalg::cholesky("M_θx", &correlation).is_ok() {
            return Ok(None);
        }
    }
    // Square root of O weighs the states: singular values then say what the offset cost sees.
    let n = mx.nrows();
    let scaled = Dense::from_fn(n.max(m), m, |i, j| {
        if i < n {
            mx[(i, j)] * problem.offset_weight().get(i, i).sqrt()
        } else {
            0.0
        }
    });
    let (_, s, v) = linalg::svd("M_θx", &scaled)?;
    let largest = s.first().copied().unwrap_or(0.0);
    let kernel: Vec<usize> = (0..m).filter(|&k| !(s[k] > SAME_STATE * largest)).collect();
    if kernel.is_empty() {
        return Ok(None);
    }
    let free = Dense::from_fn(m, kernel.len(), |i, k| v[(i, kernel[k])]);
    let (u, _, _) = linalg::svd("M_θu", &(mu * free))?;
    let basis = u.submatrix(0, 0, m, kernel.len()).to_owned();
    let projection = &basis * basis.transpose();
    let r = linalg::dense(problem.input_weight());
    Ok(Some(
        projection.transpose() * r * &projection * faer::Scale(TIE_BREAK),
    ))
}

/// ‖x − x_r‖²_W for sparse W.
pub(crate) fn weighted_square(w: &SparseMatrix, difference: &[f64]) -> f64 {
    difference
        .iter()
        .enumerate()
        .map(|(i, d)| d * w.row_dot(i, difference))
        .sum()
}

fn subtract(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn add(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// The closest admissible equilibrium as a program in θ, ready for many set-points.
pub(crate) struct Equilibria {
    cost: OffsetCost,
    /// Lower triangular L with L Lᵀ the Hessian of the offset cost.
    factor: Dense,
    /// Made when a program must be solved for the first time.
    solver: Option<Regime>,
    /// C M_θx + D M_θu.
    rows: SparseMatrix,
    /// ‖Wθ/λ + h‖ ≤ 1 for each ellipsoid, W = F M_θx + G M_θu.
    cones: Vec<ProgramCone>,
    /// Offset cost of going from the operating point to a constraint, the largest over the parameters.
    unit: f64,
}

impl Equilibria {
    pub(crate) fn new(problem: &Problem, steady: &SteadyStates) -> Result<Self, DesignError> {
        let m = problem.plant().inputs();
        let cost = OffsetCost::of(problem, steady)?;
        let factor = linalg::cholesky("the offset cost", &cost.hessian)?;
        let constraints = problem.rows();
        let rows = constraints.c.mul(steady.state_basis()).combine(
            1.0,
            &constraints.d.mul(steady.input_basis()),
            1.0,
        );
        let unit = (0..m).fold(0.0_f64, |a, i| a.max(0.5 * cost.hessian[(i, i)]));
        let cones = problem
            .norms()
            .iter()
            .map(|b| {
                let w = linalg::dense(&b.f) * linalg::dense(steady.state_basis())
                    + linalg::dense(&b.g) * linalg::dense(steady.input_basis());
                ProgramCone {
                    map: w * faer::Scale(1.0 / problem.scaling()),
                    from_state: Dense::zeros(b.dimension(), 1),
                    offset: b.offset.clone(),
                }
            })
            .collect();
        Ok(Self {
            cost,
            factor,
            solver: None,
            cones,
            rows,
            unit,
        })
    }

    /// The solver of the program min offset cost over θ ∈ λΘ.
    fn solver(&mut self, problem: &Problem) -> Result<&mut Regime, DesignError> {
        if self.solver.is_none() {
            let (n, m) = (problem.plant().states(), problem.plant().inputs());
            let cost = &self.cost;
            // There is no measured state here: one that is always zero takes its place.
            let program = Program {
                hessian: cost.hessian.clone(),
                from_state: Dense::zeros(m, 1),
                from_set_point: Dense::from_fn(m, n + m, |i, j| {
                    if j < n {
                        -cost.from_state[(i, j)]
                    } else {
                        -cost.from_input[(i, j - n)]
                    }
                }),
                rows: linalg::dense(&self.rows) * faer::Scale(1.0 / problem.scaling()),
                state_rows: Dense::zeros(problem.rows().len(), 1),
                law: None,
            };
            self.solver = Some(Regime::of_program(program, self.cones.clone(), m, 0)?);
        }
        self.solver.as_mut().ok_or_else(|| DesignError::Solver {
            what: "the closest admissible equilibrium".into(),
            detail: "no solver".into(),
        })
    }

    /// Whether a set-point is admissible, as [`Equilibria::closest`] says, mostly without its program.
    ///
    /// Let θ_r be the minimum of the offset cost without constraints, d its cost, and ε the cost that counts as zero. Every
    /// θ costs d + ½ (θ − θ_r)ᵀH(θ − θ_r). So: if d > ε, no. If θ_r ∈ λΘ, it is the closest, and d ≤ ε says yes. Otherwise the
    /// answer costs at least d + ½ v²/(a H⁻¹ aᵀ) for a row a that θ_r violates by v, which may be the half space that touches an
    /// ellipsoid on the side of θ_r: if this exceeds ε, no. It costs at most as much as the point where the way from 0 to θ_r leaves λΘ: if that is below ε, yes. Between these the program is solved, and
    /// also where equilibria with equal states leave a choice, which H weighs and the offset cost does not.
    pub(crate) fn is_admissible(
        &mut self,
        problem: &Problem,
        steady: &SteadyStates,
        set_point: &SetPoint,
    ) -> Result<bool, DesignError> {
        let plant = problem.plant();
        let (n, m) = (plant.states(), plant.inputs());
        check_vector("set-point state", &set_point.state, n)?;
        let at = plant.operating_point();
        let xr = subtract(&set_point.state, &at.state);
        let ur = match &set_point.input {
            Some(u) => {
                check_vector("set-point input", u, m)?;
                subtract(u, &at.input)
            }
            None => vec![0.0; m],
        };
        let mut theta = Dense::zeros(m, 1);
        for (from, v) in [(&self.cost.from_state, &xr), (&self.cost.from_input, &ur)] {
            for (j, &vj) in v.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                for i in 0..m {
                    theta[(i, 0)] += from[(i, j)] * vj;
                }
            }
        }
        self.factor
            .as_ref()
            .solve_lower_triangular_in_place(theta.as_mut());
        self.factor
            .transpose()
            .solve_upper_triangular_in_place(theta.as_mut());
        let theta: Vec<f64> = theta.col(0).iter().copied().collect();
        let offset = |theta: &[f64]| {
            let dx = subtract(&steady.state_basis().mul_vec(theta), &xr);
            let du = subtract(&steady.input_basis().mul_vec(theta), &ur);
            weighted_square(problem.offset_weight(), &dx)
                + weighted_square(problem.offset_input_weight(), &du)
        };
        let size = weighted_square(problem.offset_weight(), &xr)
            + weighted_square(problem.offset_input_weight(), &ur);
        let zero = ADMISSIBLE * size.max(self.unit);
        let free = offset(&theta);
        if !(free <= zero) {
            return Ok(false);
        }
        let scaling = problem.scaling();
        let worst = (0..self.rows.rows())
            .map(|i| (i, self.rows.row_dot(i, &theta)))
            .fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        // Wθ_r/λ of each ellipsoid; with h added, its norm is at most 1 inside.
        let images: Vec<Vec<f64>> = self.cones.iter().map(|c| c.image(&theta)).collect();
        let outside: Vec<Vec<f64>> = images
            .iter()
            .zip(&self.cones)
            .map(|(v, c)| add(v, &c.offset))
            .collect();
        let worst_norm = outside
            .iter()
            .map(|v| norm(v))
            .enumerate()
            .fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        if worst.1 <= scaling && worst_norm.1 <= 1.0 {
            return Ok(true);
        }
        if self.cost.is_tied {
            return Ok(self.closest(problem, steady, set_point)?.admissible);
        }
        let mut reach = Dense::zeros(m, 1);
        let excess = if worst.1 / scaling >= worst_norm.1 {
            for (j, v) in self.rows.row(worst.0) {
                reach[(j, 0)] = v;
            }
            worst.1 - scaling
        } else {
            let (map, v) = (&self.cones[worst_norm.0].map, &outside[worst_norm.0]);
            for (k, vk) in v.iter().enumerate() {
                for j in 0..m {
                    reach[(j, 0)] += map[(k, j)] * vk / worst_norm.1;
                }
            }
            worst_norm.1 - 1.0
        };
        self.factor
            .as_ref()
            .solve_lower_triangular_in_place(reach.as_mut());
        let reach: f64 = reach.col(0).iter().map(|v| v * v).sum();
        if free + 0.5 * excess * excess / reach > zero {
            return Ok(false);
        }
        let by = images
            .iter()
            .zip(&self.cones)
            .map(|(v, c)| beyond(v, &c.offset))
            .fold(worst.1 / scaling, f64::max);
        let inside: Vec<f64> = theta.iter().map(|t| t / by).collect();
        if offset(&inside) <= zero {
            return Ok(true);
        }
        Ok(self.closest(problem, steady, set_point)?.admissible)
    }

    pub(crate) fn closest(
        &mut self,
        problem: &Problem,
        steady: &SteadyStates,
        set_point: &SetPoint,
    ) -> Result<AdmissibleSetPoint, DesignError> {
        let (n, m) = (problem.plant().states(), problem.plant().inputs());
        check_vector("set-point state", &set_point.state, n)?;
        let at = problem.plant().operating_point();
        let xr = subtract(&set_point.state, &at.state);
        let ur = match &set_point.input {
            Some(u) => {
                check_vector("set-point input", u, m)?;
                subtract(u, &at.input)
            }
            None => vec![0.0; m],
        };
        let r: Vec<f64> = xr.iter().chain(&ur).copied().collect();
        let solution = self
            .solver(problem)?
            .solve(&[0.0], &r, Limits::default())
            .map_err(|failure| DesignError::Solver {
                what: "the closest admissible equilibrium".into(),
                detail: match failure {
                    Failure::Infeasible(_) => {
                        "said to be infeasible, though θ = 0 is admissible".into()
                    }
                    Failure::Unsolved { residual, .. } => {
                        format!("largest residual {residual:.3e}")
                    }
                },
            })?;
        if solution.why.is_some() {
            return Err(DesignError::Solver {
                what: "the closest admissible equilibrium".into(),
                detail: "no answer passed the check".into(),
            });
        }
        let theta = solution.z;
        let (xs, us) = (
            steady.state_basis().mul_vec(&theta),
            steady.input_basis().mul_vec(&theta),
        );
        let (dx, du) = (subtract(&xs, &xr), subtract(&us, &ur));
        let offset_cost = weighted_square(problem.offset_weight(), &dx)
            + weighted_square(problem.offset_input_weight(), &du);
        let size = weighted_square(problem.offset_weight(), &xr)
            + weighted_square(problem.offset_input_weight(), &ur);
        let scaling = problem.scaling();
        let limiting = (0..self.rows.rows())
            .filter(|&i| self.rows.row_dot(i, &theta) >= scaling * (1.0 - ACTIVE))
            .map(|i| problem.rows().source[i])
            .chain(self.limiting_norms(problem, &theta))
            .collect();
        Ok(AdmissibleSetPoint {
            state: add(&xs, &at.state),
            input: add(&us, &at.input),
            admissible: offset_cost <= ADMISSIBLE * size.max(self.unit),
            parameter: theta,
            offset_cost,
            limiting,
        })
    }
}

impl Equilibria {
    /// The ellipsoids with ‖Wθ/λ + h‖ at 1.
    fn limiting_norms(&self, problem: &Problem, theta: &[f64]) -> Vec<RowSource> {
        let bounds = problem.norms().iter().zip(&self.cones);
        bounds
            .filter(|(_, c)| norm(&add(&c.image(theta), &c.offset)) >= 1.0 - ACTIVE)
            .map(|(b, _)| b.source)
            .collect()
    }
}

impl SteadyStates {
    /// The admissible equilibrium closest to a set-point: the minimum of the offset cost over θ ∈ λΘ.
    ///
    /// # Errors
    /// [`DesignError::Shape`], [`DesignError::NotFinite`] for the set-point; [`DesignError::Solver`].
    pub fn closest_admissible(
        &self,
        problem: &Problem,
        set_point: &SetPoint,
    ) -> Result<AdmissibleSetPoint, DesignError> {
        Equilibria::new(problem, self)?.closest(problem, self, set_point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Constraints, Matrix, Plant, Weights};

    /// What a solver remembers of the last set-point must not show in the next answer.
    #[test]
    fn answers_do_not_depend_on_the_set_point_before() {
        let plant = Plant::discrete(
            Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
            Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
        )
        .unwrap();
        let constraints = Constraints::new(2, 2)
            .state_bounds(&[-3.0; 2], &[3.0; 2])
            .unwrap()
            .input_bounds(&[-2.0; 2], &[2.0; 2])
            .unwrap();
        let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4)).unwrap();
        let steady = SteadyStates::of(&problem).unwrap();
        let mut equilibria = Equilibria::new(&problem, &steady).unwrap();
        for (state, admissible) in [
            ([2.0, 0.5], true),
            ([50.0, -30.0], false),
            ([0.0, 0.0], true),
            ([1e6, 1e6], false),
            // On the border of λΘ, within it by rounding, and beyond what counts as zero.
            ([2.7, 0.0], true),
            ([2.7 * (1.0 + 1e-15), 0.0], true),
            ([2.7 * (1.0 + 1e-9), 0.0], true),
            ([2.7 * (1.0 + 1e-6), 0.0], false),
            ([1.0, 0.1], true),
            ([0.0, 0.0], true),
        ] {
            let set_point = SetPoint::state(state);
            let found = equilibria.closest(&problem, &steady, &set_point).unwrap();
            assert_eq!(found.admissible, admissible, "{found:?}");
            assert_eq!(
                equilibria.is_admissible(&problem, &steady, &set_point),
                Ok(admissible)
            );
            let fresh = steady.closest_admissible(&problem, &set_point).unwrap();
            for (a, b) in found.state.iter().zip(&fresh.state) {
                assert!((a - b).abs() < 1e-9, "{found:?} {fresh:?}");
            }
        }
    }

    /// Discs off their centers beside rows; set-points all over λΘ, beyond it, and close to its border on both sides.
    #[test]
    fn ellipsoids_count_for_what_is_admissible() {
        let plant = Plant::discrete(
            Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
            Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
        )
        .unwrap();
        let constraints = Constraints::new(2, 2)
            .state_bounds(&[-2.0; 2], &[2.5; 2])
            .unwrap()
            .state_ellipsoid_around(1.0 / 6.0, vec![0.3, -0.1])
            .unwrap()
            .input_ellipsoid(0.25)
            .unwrap();
        let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4)).unwrap();
        let steady = SteadyStates::of(&problem).unwrap();
        let mut equilibria = Equilibria::new(&problem, &steady).unwrap();
        let mut counts = [0, 0];
        for k in 0..40 {
            let angle = 0.7 + 0.157 * f64::from(k);
            let direction = [angle.cos(), angle.sin()];
            let far = direction.map(|d| 30.0 * d);
            let border = equilibria
                .closest(&problem, &steady, &SetPoint::state(far))
                .unwrap();
            assert!(!border.admissible && !border.limiting.is_empty());
            for (by, expected) in [
                (0.3, Some(true)),
                (1.0 - 1e-9, Some(true)),
                (1.0, None),
                (1.0 + 1e-9, None),
                (1.0 + 1e-4, Some(false)),
                (3.0, Some(false)),
            ] {
                // The operating point is the origin.
                let state: Vec<f64> = border.state.iter().map(|x| by * x).collect();
                let set_point = SetPoint::state(state);
                let found = equilibria.closest(&problem, &steady, &set_point).unwrap();
                let quick = equilibria.is_admissible(&problem, &steady, &set_point);
                assert_eq!(quick, Ok(found.admissible), "{k} {by} {found:?}");
                if let Some(expected) = expected {
                    assert_eq!(found.admissible, expected, "{k} {by} {found:?}");
                }
                counts[usize::from(found.admissible)] += 1;
            }
        }
        assert!(counts[0] > 40 && counts[1] > 40, "{counts:?}");
    }
}
