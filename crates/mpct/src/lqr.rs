//! The gain K and the terminal weight P of Assumption 1.
//!
//! K is the gain of the linear quadratic regulator,
//!   P = Q + AᵀP(I + G P)⁻¹A,  G = B R⁻¹Bᵀ,   K = −(R + BᵀPB)⁻¹BᵀPA,
//! unless the user states another one. In both cases P solves (3), (A+BK)ᵀP(A+BK) − P = −(Q + KᵀRK), for exactly
//! the K that the controller uses: entries of K at the level of rounding are set to zero first.
//!
//! Small plants are computed with full matrices. On large ones made of coupled subsystems K and P decay with the
//! distance; [`local`] computes them from the plant around each input and nothing of order n × n is formed.
//!
//! Source: structured doubling, Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic discrete-time
//! algebraic Riccati equations", Int. J. Control 77(8), 2004; squared Smith iteration, Smith 1968.

mod local;
mod residual;
mod smith;

use crate::clock::Clock;
use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::matrix::SparseMatrix;
use crate::problem::Problem;

/// Doublings before the iteration is given up: 2^60 steps decide about every modulus that a double can tell from 1.
const MAX_DOUBLINGS: usize = 60;
/// Relative change at which the Riccati iteration has converged; it converges quadratically, so the next change
/// would be at rounding level.
const RICCATI_TOLERANCE: f64 = 1e-13;
/// A mode counts as uncontrollable when the smallest singular value of [A − zI, B] is below this, relative to the
/// largest.
const RANK_TOLERANCE: f64 = 1e-11;
/// From this many states on, a plant is looked at for locality. Below, full matrices cost milliseconds.
const LOCAL_FROM: usize = 64;
/// Entries of K this much smaller than the largest of their row, in units of Q, are rounding of the computation that
/// K comes from.
const ROUNDING: f64 = 1e-16;

/// K, P and the closed loop A + B K.
#[derive(Clone, Debug)]
pub(crate) struct Law {
    /// K, m × n.
    pub(crate) gain: SparseMatrix,
    /// P, n × n.
    pub(crate) weight: SparseMatrix,
    /// A + B K, n × n.
    pub(crate) closed_loop: SparseMatrix,
    pub(crate) spectral_radius: f64,
}

/// The same as full matrices.
#[derive(Clone, Debug)]
pub(crate) struct TerminalLaw {
    /// K, m × n.
    pub(crate) gain: Dense,
    /// P, n × n.
    pub(crate) weight: Dense,
    /// A + B K, n × n.
    pub(crate) closed_loop: Dense,
}

impl Law {
    /// Full matrices.
    pub(crate) fn to_dense(&self) -> TerminalLaw {
        TerminalLaw {
            gain: linalg::dense(&self.gain),
            weight: linalg::dense(&self.weight),
            closed_loop: linalg::dense(&self.closed_loop),
        }
    }
}

/// K (LQR, or the problem's own) and the P that belongs to it.
pub(crate) fn terminal_law(problem: &Problem, clock: &Clock) -> Result<Law, DesignError> {
    let n = problem.plant().states();
    if n >= LOCAL_FROM
        && problem.plant().a().share() < 0.5
        && let Some(law) = local::terminal_law(problem, clock)?
    {
        return Ok(law);
    }
    full(problem, clock)
}

/// With full matrices.
fn full(problem: &Problem, clock: &Clock) -> Result<Law, DesignError> {
    let a = linalg::dense(problem.plant().a());
    let b = linalg::dense(problem.plant().b());
    let q = linalg::dense(problem.state_weight());
    let r = linalg::dense(problem.input_weight());
    let gain = match problem.gain() {
        Some(k) => linalg::dense(k),
        None => {
            let unit = units(problem.state_weight());
            let gain = linalg::sparse(&lqr_gain(&a, &b, &q, &r, clock)?);
            linalg::dense(&without_rounding(&gain, &unit))
        }
    };
    let closed_loop = &a + &b * &gain;
    let spectral_radius = linalg::spectral_radius("A + B K", &closed_loop)?;
    if !(spectral_radius < 1.0) {
        if problem.gain().is_none() {
            check_stabilizable(&a, &b)?;
        }
        return Err(DesignError::NotSchur { spectral_radius });
    }
    let stage = linalg::symmetrised(&(&q + gain.transpose() * &r * &gain));
    let not_schur = DesignError::NotSchur { spectral_radius };
    let mut weight = lyapunov(&closed_loop, &stage).ok_or(not_schur)?;
    // One step of refinement: the correction solves the same equation with the residual on the right.
    let residual =
        linalg::symmetrised(&(closed_loop.transpose() * &weight * &closed_loop - &weight + &stage));
    if let Some(correction) = lyapunov(&closed_loop, &residual) {
        weight = linalg::symmetrised(&(&weight + correction));
    }
    let left = closed_loop.transpose() * &weight * &closed_loop - &weight + &stage;
    let entries = (0..left.nrows()).flat_map(|i| (0..left.ncols()).map(move |j| (i, j)));
    residual::check(problem, entries.map(|(i, j)| (i, j, left[(i, j)])))?;
    Ok(Law {
        gain: linalg::sparse(&gain),
        weight: linalg::sparse(&weight),
        closed_loop: linalg::sparse(&closed_loop),
        spectral_radius,
    })
}

/// Units of the states in which Q has ones on its diagonal: badly scaled plants become ordinary ones.
fn units(q: &SparseMatrix) -> Vec<f64> {
    (0..q.rows()).map(|i| 1.0 / q.get(i, i).sqrt()).collect()
}

/// K without the entries that are rounding of its computation.
fn without_rounding(gain: &SparseMatrix, unit: &[f64]) -> SparseMatrix {
    let largest: Vec<f64> = (0..gain.rows())
        .map(|i| {
            gain.row(i)
                .fold(0.0_f64, |a, (j, v)| a.max(v.abs() * unit[j]))
        })
        .collect();
    gain.filtered(|i, j, v| v.abs() * unit[j] > ROUNDING * largest[i])
}

/// S with FᵀSF − S + C = 0 by the squared Smith iteration; `None` when the powers of F do not vanish.
fn lyapunov(f: &Dense, c: &Dense) -> Option<Dense> {
    let mut power = f.clone();
    let mut sum = c.clone();
    for _ in 0..MAX_DOUBLINGS {
        let increment = power.transpose() * &sum * &power;
        let (small, large) = (
            linalg::max_abs(increment.as_ref()),
            linalg::max_abs(sum.as_ref()),
        );
        if !(small.is_finite() && large.is_finite()) {
            return None;
        }
        sum = linalg::symmetrised(&(&sum + increment));
        if small <= 1e-18 * large {
            return Some(sum);
        }
        power = &power * &power;
    }
    None
}

/// K = −(R + BᵀPB)⁻¹BᵀPA with P from structured doubling.
fn lqr_gain(
    a: &Dense,
    b: &Dense,
    q: &Dense,
    r: &Dense,
    clock: &Clock,
) -> Result<Dense, DesignError> {
    // States in units in which Q has ones on its diagonal: badly scaled plants become ordinary ones.
    let n = a.nrows();
    let unit: Vec<f64> = (0..n).map(|i| 1.0 / q[(i, i)].sqrt()).collect();
    let a_s = Dense::from_fn(n, n, |i, j| a[(i, j)] * unit[j] / unit[i]);
    let b_s = Dense::from_fn(n, b.ncols(), |i, j| b[(i, j)] / unit[i]);
    let q_s = Dense::from_fn(n, n, |i, j| q[(i, j)] * unit[i] * unit[j]);
    let Some(p) = riccati(&a_s, &b_s, &q_s, r, clock)? else {
        check_stabilizable(a, b)?;
        return Err(DesignError::Solver {
            what: "the Riccati equation".into(),
            detail: format!("structured doubling did not converge in {MAX_DOUBLINGS} doublings"),
        });
    };
    let btp = b_s.transpose() * &p;
    let k = linalg::solve_positive(
        "R + BᵀPB",
        &linalg::symmetrised(&(r + &btp * &b_s)),
        &(&btp * &a_s),
    )?;
    Ok(Dense::from_fn(k.nrows(), n, |i, j| -k[(i, j)] / unit[j]))
}

/// Ends a long computation when the time is over.
fn interruptible(clock: &Clock) -> Result<(), DesignError> {
    if clock.has_stopped() {
        Err(DesignError::Interrupted {
            at_least: 1,
            rows_left: 0,
        })
    } else {
        Ok(())
    }
}

/// P by structured doubling; `None` when it does not converge to finite numbers.
fn riccati(
    a: &Dense,
    b: &Dense,
    q: &Dense,
    r: &Dense,
    clock: &Clock,
) -> Result<Option<Dense>, DesignError> {
    let n = a.nrows();
    let bt = b.transpose().to_owned();
    let mut a_k = a.clone();
    let mut g = linalg::symmetrised(&(b * linalg::solve_positive("weights.R", r, &bt)?));
    let mut h = q.clone();
    for _ in 0..MAX_DOUBLINGS {
        interruptible(clock)?;
        let w = Dense::identity(n, n) + &g * &h;
        let lu = w.partial_piv_lu();
        let (wa, wg) = {
            use faer::linalg::solvers::Solve;
            (lu.solve(&a_k), lu.solve(&g))
        };
        let increment = linalg::symmetrised(&(a_k.transpose() * (&h * &wa)));
        g = linalg::symmetrised(&(&g + &a_k * (&wg * a_k.transpose())));
        a_k = &a_k * &wa;
        let (small, large) = (
            linalg::max_abs(increment.as_ref()),
            linalg::max_abs(h.as_ref()),
        );
        h = &h + increment;
        if !(linalg::is_finite(&h) && linalg::is_finite(&g) && linalg::is_finite(&a_k)) {
            return Ok(None);
        }
        if small <= RICCATI_TOLERANCE * large {
            return Ok(Some(h));
        }
    }
    Ok(None)
}

/// Popov–Belevitch–Hautus: every eigenvalue z with |z| ≥ 1 leaves [A − zI, B] with full row rank.
fn check_stabilizable(a: &Dense, b: &Dense) -> Result<(), DesignError> {
    let (n, m) = (a.nrows(), b.ncols());
    for (re, im) in linalg::eigenvalues("A", a)? {
        let modulus = re.hypot(im);
        // Computed eigenvalues of defective matrices scatter; one just inside may stand for one on the circle.
        if modulus < 1.0 - 1e-7 {
            continue;
        }
        // The complex matrix as a real one of twice the size has the same singular values, each twice.
        let pencil = Dense::from_fn(2 * n, 2 * (n + m), |i, j| {
            let (row, upper) = (i % n, i < n);
            let (column, left) = if j < n + m {
                (j, true)
            } else {
                (j - n - m, false)
            };
            let real = if column < n {
                a[(row, column)] - if row == column { re } else { 0.0 }
            } else {
                b[(row, column - n)]
            };
            let imaginary = if row == column { -im } else { 0.0 };
            match (upper, left) {
                (true, true) | (false, false) => real,
                (true, false) => -imaginary,
                (false, true) => imaginary,
            }
        });
        let (_, s, _) = linalg::svd("[A - zI, B]", &pencil)?;
        let largest = s.first().copied().unwrap_or(0.0);
        let smallest = s.last().copied().unwrap_or(0.0);
        if !(smallest > RANK_TOLERANCE * largest) {
            return Err(DesignError::NotStabilizable { re, im, modulus });
        }
    }
    Ok(())
}
