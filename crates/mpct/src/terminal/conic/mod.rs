//! The terminal horizon with ellipsoidal constraints. The derivation is in `docs/ellipsoids.md`.
//!
//! In z = (e, θ) constraint rows and ellipsoids after s steps of the terminal law read
//!   g_i A_Kˢ e + w_i θ ≤ 1,   ‖F_k A_Kˢ e + W_k θ + h_k‖ ≤ 1,
//! and O_t is the set of all of them for s ≤ t with θ ∈ λΘ. Supports of O_t are second-order cone programs. A row is
//! spent at step t when one support is at most 1. An ellipsoid is spent when the maximum of a convex function over
//! O_{t−1} is at most 1: a [`fan`] of supports bounds it from above, points of O_{t−1} from below.

mod fan;
mod proofs;
mod search;
mod spent;

pub(crate) use proofs::ConicMultiplier;
pub(super) use search::search;

use crate::error::DesignError;
use crate::linalg::{self, Dense};
use crate::lqr::TerminalLaw;
use crate::optimization::{
    Ball, Body, BodyFailure, Multipliers, SupportValue, add_product, dot, norm,
};
use crate::problem::{Problem, Task};
use crate::steady_state::SteadyStates;

/// A constraint after some steps of the terminal law, or, without a step, its part in θ ∈ λΘ.
pub(crate) type At = (usize, Option<usize>);

/// Linear forms of one step: constraint rows first, then the components of the ellipsoids.
pub(super) struct ConicSystem {
    states: usize,
    parameters: usize,
    scaling: f64,
    /// Number of constraint rows p.
    pub(super) rows: usize,
    /// First form and number of forms of each ellipsoid.
    pub(super) norms: Vec<(usize, usize)>,
    /// h, for every form; 0 for rows.
    offset: Vec<f64>,
    /// (C + D K) (A + B K)^s of all forms, one matrix a step.
    powers: Vec<Dense>,
    /// C M_θx + D M_θu of all forms.
    equilibrium: Dense,
    closed_loop: Dense,
    /// Half widths β of a box that holds O from `bounded_from` steps on. Programs see z_l / β_l.
    pub(super) beta: Vec<f64>,
    /// Number of steps whose constraints bound every coordinate.
    pub(super) bounded_from: usize,
    /// O = −O: every row has an opposite one, and no ellipsoid is off center.
    symmetric: bool,
}

/// A box is a little wider than computed, so that rounding does not cut the set.
const BOX_ROOM: f64 = 1e-6;
/// Steps looked at to bound a coordinate that step 0 does not bound.
const BOX_STEPS: usize = 64;

impl ConicSystem {
    /// # Errors
    /// [`DesignError::Unbounded`] for a coordinate of z that the constraints do not bound.
    pub(super) fn new(
        problem: &Problem,
        law: &TerminalLaw,
        steady: &SteadyStates,
    ) -> Result<Self, DesignError> {
        let constraints = problem.rows();
        let (n, m) = (problem.plant().states(), problem.plant().inputs());
        let rows = constraints.len();
        let mut norms = Vec::new();
        let mut offset = vec![0.0; rows];
        let total = rows + problem.norms().iter().map(|b| b.dimension()).sum::<usize>();
        let (mut c, mut d) = (Dense::zeros(total, n), Dense::zeros(total, m));
        let mut put = |from: usize, f: &crate::SparseMatrix, g: &crate::SparseMatrix| {
            f.entries().for_each(|(i, j, v)| c[(from + i, j)] = v);
            g.entries().for_each(|(i, j, v)| d[(from + i, j)] = v);
        };
        put(0, &constraints.c, &constraints.d);
        for bound in problem.norms() {
            put(offset.len(), &bound.f, &bound.g);
            norms.push((offset.len(), bound.dimension()));
            offset.extend(&bound.offset);
        }
        let (parameters, equilibrium) = match problem.task() {
            Task::Tracking => (
                m,
                &c * linalg::dense(steady.state_basis()) + &d * linalg::dense(steady.input_basis()),
            ),
            Task::Regulation => (0, Dense::zeros(total, 0)),
        };
        let mut system = Self {
            states: n,
            parameters,
            scaling: problem.scaling(),
            rows,
            norms,
            offset,
            powers: vec![&c + &d * &law.gain],
            equilibrium,
            closed_loop: law.closed_loop.clone(),
            beta: Vec::new(),
            bounded_from: 1,
            symmetric: false,
        };
        system.symmetric = system.is_symmetric();
        system.find_box()?;
        Ok(system)
    }

    fn is_symmetric(&self) -> bool {
        let row = |i: usize| {
            let e = (0..self.states).map(move |j| self.powers[0][(i, j)]);
            e.chain((0..self.parameters).map(move |t| self.equilibrium[(i, t)]))
        };
        let opposite = |i: usize, j: usize| row(i).zip(row(j)).all(|(a, b)| a == -b);
        self.offset.iter().all(|h| *h == 0.0)
            && (0..self.rows).all(|i| (0..self.rows).any(|j| opposite(i, j)))
    }

    /// Rows and ellipsoids, in this order.
    pub(super) fn items(&self) -> usize {
        self.rows + self.norms.len()
    }

    pub(super) fn dimension(&self) -> usize {
        self.states + self.parameters
    }

    /// Makes the forms of steps 0, …, `step` available.
    pub(super) fn extend_to(&mut self, step: usize) {
        while self.powers.len() <= step {
            let next = &self.powers[self.powers.len() - 1] * &self.closed_loop;
            self.powers.push(next);
        }
    }

    /// A form after some steps, or its part in θ ∈ λΘ, in scaled coordinates.
    fn form(&self, form: usize, step: Option<usize>) -> Vec<f64> {
        let mut out = vec![0.0; self.dimension()];
        if let Some(step) = step {
            for j in 0..self.states {
                out[j] = self.powers[step][(form, j)];
            }
        }
        let scale = if step.is_some() {
            1.0
        } else {
            1.0 / self.scaling
        };
        for t in 0..self.parameters {
            out[self.states + t] = self.equilibrium[(form, t)] * scale;
        }
        out.iter_mut().zip(&self.beta).for_each(|(v, b)| *v *= b);
        out
    }

    /// The e part alone.
    fn transient(&self, form: usize, step: usize) -> Vec<f64> {
        let mut out = self.form(form, Some(step));
        out[self.states..].fill(0.0);
        out
    }

    /// O_{known − 1} in scaled coordinates: θ ∈ λΘ, and each item at the steps before `known` and before it is spent.
    fn set(&self, known: usize, spent: &[usize]) -> Set {
        let mut set = Set::default();
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for i in 0..self.rows {
            let last = known.min(spent[i]);
            for step in std::iter::once(None).chain((0..last).map(Some)) {
                let row = self.form(i, step);
                if row.iter().any(|v| *v != 0.0) {
                    rows.push(row);
                    set.rows.push((i, step));
                }
            }
        }
        for (k, &(first, q)) in self.norms.iter().enumerate() {
            let last = known.min(spent[self.rows + k]);
            for step in std::iter::once(None).chain((0..last).map(Some)) {
                let forms: Vec<Vec<f64>> = (first..first + q).map(|f| self.form(f, step)).collect();
                if forms.iter().flatten().any(|v| *v != 0.0) {
                    set.body.balls.push(Ball {
                        map: Dense::from_fn(q, self.dimension(), |i, j| forms[i][j]),
                        offset: self.offset[first..first + q].to_vec(),
                        radius: 1.0,
                    });
                    set.balls.push((k, step));
                }
            }
        }
        set.body.rows = Dense::from_fn(rows.len(), self.dimension(), |i, j| rows[i][j]);
        set.body.bounds = vec![1.0; rows.len()];
        set
    }

    /// β, from supports of O_0, or of O over a few more steps.
    fn find_box(&mut self) -> Result<(), DesignError> {
        let d = self.dimension();
        let few = BOX_STEPS.min(self.states) + 1;
        self.extend_to(few);
        for known in [1, few] {
            // Scale of a coordinate: where a form alone would stop it.
            self.beta = vec![1.0; d];
            let scale: Vec<f64> = {
                let mut largest = vec![0.0_f64; d];
                for form in 0..self.offset.len() {
                    for step in std::iter::once(None).chain((0..known).map(Some)) {
                        for (a, v) in largest.iter_mut().zip(self.form(form, step)) {
                            *a = a.max(v.abs());
                        }
                    }
                }
                largest
            };
            if let Some(l) = scale.iter().position(|s| !(*s > 0.0)) {
                if known == few {
                    return Err(self.unbounded(l));
                }
                continue;
            }
            self.beta = scale.iter().map(|s| s.recip()).collect();
            let set = self.set(known, &vec![usize::MAX; self.items()]);
            let reach = (0..d)
                .map(|l| {
                    let mut reach = 0.0_f64;
                    for sign in [1.0, -1.0] {
                        let mut c = vec![0.0; d];
                        c[l] = sign;
                        match set.body.support(&c, &vec![0.0; d]) {
                            Ok(value) => reach = reach.max(value.upper),
                            Err(BodyFailure::Unbounded) => return Ok(None),
                            Err(BodyFailure::Unsolved(detail)) => {
                                return Err(DesignError::Solver {
                                    what: format!("the reach of {}", self.name(l)),
                                    detail,
                                });
                            }
                        }
                    }
                    Ok(Some(reach))
                })
                .collect::<Result<Vec<_>, DesignError>>()?;
            match reach.iter().position(Option::is_none) {
                None => {
                    for (b, r) in self.beta.iter_mut().zip(reach.into_iter().flatten()) {
                        *b *= r * (1.0 + BOX_ROOM);
                    }
                    self.bounded_from = known;
                    return Ok(());
                }
                Some(l) if known == few => return Err(self.unbounded(l)),
                Some(_) => {}
            }
        }
        Ok(())
    }

    fn name(&self, l: usize) -> String {
        if l < self.states {
            format!("the distance of x[{l}] from its equilibrium")
        } else {
            format!("the equilibria along theta[{}]", l - self.states)
        }
    }

    fn unbounded(&self, l: usize) -> DesignError {
        DesignError::Unbounded {
            direction: self.name(l),
        }
    }
}

/// A set O in scaled coordinates, and where its rows and balls come from.
pub(super) struct Set {
    body: Body,
    rows: Vec<At>,
    balls: Vec<At>,
}

impl Default for Set {
    fn default() -> Self {
        Self {
            body: Body {
                rows: Dense::zeros(0, 0),
                bounds: Vec::new(),
                balls: Vec::new(),
            },
            rows: Vec::new(),
            balls: Vec::new(),
        }
    }
}

/// max cᵀz over a set, from both sides.
struct Support {
    point: Vec<f64>,
    upper: f64,
    multipliers: Multipliers,
}

impl Set {
    /// `None` when the solver has no answer of use.
    fn support(&self, c: &[f64]) -> Option<Support> {
        let size = norm(c);
        if !(size > 0.0) {
            return (size == 0.0).then(|| Support {
                point: vec![0.0; c.len()],
                upper: 0.0,
                multipliers: self.no_multipliers(),
            });
        }
        let SupportValue {
            point, multipliers, ..
        } = self.body.support(c, &vec![0.0; c.len()]).ok()?;
        let upper = proved(&self.body, c, &multipliers);
        Some(Support {
            point,
            upper,
            multipliers,
        })
    }

    fn no_multipliers(&self) -> Multipliers {
        Multipliers {
            rows: vec![0.0; self.body.bounds.len()],
            balls: self
                .body
                .balls
                .iter()
                .map(|b| vec![0.0; b.offset.len()])
                .collect(),
        }
    }
}

/// An upper bound of max cᵀz from multipliers alone, in a box of half widths 1: for y ≥ 0
///   cᵀz = yᵀG z + Σ wᵀF z + restᵀz ≤ yᵀg + Σ (‖w‖ ρ − wᵀf) + ‖rest‖₁.
/// Nothing of the solver is used; NaN and negative multipliers prove nothing.
fn proved(body: &Body, c: &[f64], multipliers: &Multipliers) -> f64 {
    if !multipliers.rows.iter().all(|y| *y >= 0.0) {
        return f64::INFINITY;
    }
    let mut value = dot(&multipliers.rows, &body.bounds);
    let mut rest = c.to_vec();
    for (j, r) in rest.iter_mut().enumerate() {
        for (i, y) in multipliers.rows.iter().enumerate() {
            *r -= y * body.rows[(i, j)];
        }
    }
    for (ball, w) in body.balls.iter().zip(&multipliers.balls) {
        value += norm(w) * ball.radius - dot(w, &ball.offset);
        let mut column = vec![0.0; c.len()];
        add_product(&mut column, &ball.map.transpose().to_owned(), w, 1.0);
        rest.iter_mut().zip(column).for_each(|(r, v)| *r -= v);
    }
    value += rest.iter().map(|r| r.abs()).sum::<f64>();
    if value.is_nan() { f64::INFINITY } else { value }
}

#[cfg(test)]
mod tests;
