//! The constraints along the terminal law, recomputed from the plant as written in the file.
//!
//! With e = x − x_op − M_θx θ the closed loop is e⁺ = Â e + ρ θ, θ⁺ = θ, Â = A + B K, and ρ = A M_θx + B M_θu − M_θx
//! is what rounding left of the equation of the steady states. Constraint i at time s is g_i e(s) + w_i θ ≤ room_i.
//! For the sequence of doubles g_0, g_1, … with g_{s−1} Â = g_s + d_s,
//!   g_i e(s) = g_s e(0) + Σ_t d_t e(s − t) + Σ_{k<s} g_k ρ θ,
//! and as e(0), …, e(s − 1) lie in the box for every point of O_{s−1}, the last two sums are at most
//!   δ_s = Σ_t ‖d_t‖_β + Σ_{k<s} ‖g_k ρ‖_β,   ‖v‖_β = Σ_l |v_l| β_l.
//! The bound adds up and does not grow along the law, and it covers rounding, ρ, and entries dropped on purpose.
//!
//! One-sided constraints may bound a coordinate only after b steps: the box then holds O_b, and only
//! e(0), …, e(s − 1 − b) lie in it for every point of O_{s−1}. Up to step b the rows are therefore computed as intervals
//! g_0 Âˢ, whose widths act on e(0) alone; the recurrence above starts from step b.

use super::document::{Claim, Ellipsoid, Sparse};
use super::interval::{
    Accumulator, Interval, IntervalRows, add_up, combined, mul_up, product, scaled,
};
use super::verify::VerifyError;

/// Entries of g with |g_l| β_l below this share of the room are dropped, into δ.
const DROP: f64 = 1e-15;

/// Everything that follows from the claim without a proof.
pub(super) struct System {
    pub(super) states: usize,
    pub(super) parameters: usize,
    pub(super) scaling: f64,
    /// Â.
    pub(super) closed_loop: IntervalRows,
    /// |ρ|, by rows.
    drift: Vec<Vec<(usize, f64)>>,
    pub(super) rows: Vec<ConstraintRow>,
    pub(super) norms: Vec<Norm>,
}

/// An ellipsoid at step 0: ‖components + h‖ ≤ 1.
pub(super) struct Norm {
    pub(super) components: Vec<ConstraintRow>,
    pub(super) offset: Vec<Interval>,
}

/// One constraint at step 0.
pub(super) struct ConstraintRow {
    /// g_0, which holds the exact coefficients.
    e: Vec<(usize, Interval)>,
    /// w, in columns of z; the doubles used.
    pub(super) w: Vec<(usize, f64)>,
    /// How far the exact coefficients of w may be from these.
    w_error: Vec<(usize, f64)>,
    /// Room above and below at the operating point.
    room: [Option<Interval>; 2],
}

impl ConstraintRow {
    /// w as the checker uses it: the doubles where the box bounds what they may be off by, all of it where θ is unbounded.
    pub(super) fn equilibrium<'a>(
        &'a self,
        beta: &'a [f64],
    ) -> impl Iterator<Item = (usize, Interval)> + 'a {
        self.w.iter().map(|&(j, v)| {
            let error = if beta[j].is_finite() {
                0.0
            } else {
                self.w_error_at(j)
            };
            (j, Interval::around(v, error))
        })
    }

    /// How far w may be off in a coordinate.
    pub(super) fn w_error_at(&self, j: usize) -> f64 {
        self.w_error.iter().find(|e| e.0 == j).map_or(0.0, |e| e.1)
    }

    /// δ of the row of θ ∈ λΘ: ‖w error‖_β over the coordinates that have a box.
    pub(super) fn static_slack(&self, beta: &[f64]) -> f64 {
        let boxed = self.w_error.iter().filter(|e| beta[e.0].is_finite());
        boxed.fold(0.0, |s, &(j, v)| add_up(s, mul_up(v, beta[j])))
    }

    /// The room of a side.
    pub(super) fn room(&self, upper: bool) -> Option<Interval> {
        self.room[usize::from(!upper)]
    }
}

/// Columns and values.
type Entries = Vec<(usize, f64)>;

/// A constraint at a step: the e part of the row, and δ.
#[derive(Clone)]
pub(super) struct StepRow {
    pub(super) e: Vec<(usize, f64)>,
    pub(super) slack: f64,
}

/// A matrix of the file with the shape it must have.
pub(super) fn checked(
    what: &str,
    m: &Sparse,
    rows: usize,
    columns: usize,
) -> Result<IntervalRows, VerifyError> {
    let ascending = |r: &[(usize, f64)]| r.windows(2).all(|w| w[0].0 < w[1].0);
    let fine = m.rows.len() == rows
        && m.columns == columns
        && m.rows
            .iter()
            .all(|r| ascending(r) && r.iter().all(|e| e.0 < columns && e.1.is_finite()));
    if !fine {
        return Err(VerifyError::refused(format!(
            "{what} is not a {rows} x {columns} matrix of finite numbers"
        )));
    }
    let exact = |r: &Vec<(usize, f64)>| r.iter().map(|&(j, v)| (j, Interval::exact(v))).collect();
    Ok(m.rows.iter().map(exact).collect())
}

/// Σ |v_l| β_l, rounded up.
pub(super) fn weighted(entries: &[(usize, f64)], beta: &[f64]) -> f64 {
    entries
        .iter()
        .fold(0.0, |s, &(j, v)| add_up(s, mul_up(v.abs(), beta[j])))
}

impl System {
    /// # Errors
    /// When a shape is wrong or a number makes no sense.
    pub(super) fn of(claim: &Claim) -> Result<Self, VerifyError> {
        let (n, m) = (claim.a.rows.len(), claim.b.columns);
        let parameters = claim.state_basis.columns;
        if n == 0 || (parameters != m && parameters != 0) {
            return Err(VerifyError::refused(
                "the shapes of A, B and M_θ do not fit",
            ));
        }
        if !(claim.scaling > 0.0 && claim.scaling < 1.0) {
            return Err(VerifyError::refused("λ must lie between 0 and 1"));
        }
        let a = checked("A", &claim.a, n, n)?;
        let b = checked("B", &claim.b, n, m)?;
        let k = checked("K", &claim.gain, m, n)?;
        let mx = checked("M_θx", &claim.state_basis, n, parameters)?;
        let mu = checked("M_θu", &claim.input_basis, m, parameters)?;
        let closed_loop = combined(&a, &product(&b, &k, n), 1.0, n);
        let equilibria = combined(
            &product(&a, &mx, parameters),
            &product(&b, &mu, parameters),
            1.0,
            parameters,
        );
        let drift = combined(&equilibria, &mx, -1.0, parameters)
            .into_iter()
            .map(|row| {
                row.into_iter()
                    .map(|(j, v)| (n + j, v.magnitude()))
                    .filter(|e| e.1 != 0.0)
                    .collect()
            })
            .collect();
        let at = [&claim.operating_state, &claim.operating_input];
        if at[0].len() != n
            || at[1].len() != m
            || at.iter().any(|v| v.iter().any(|x| !x.is_finite()))
        {
            return Err(VerifyError::refused(
                "the operating point does not fit the plant",
            ));
        }
        let mut rows = Vec::with_capacity(claim.constraints.len());
        for constraint in &claim.constraints {
            let single = |what: &str, entries: &Vec<(usize, f64)>, width: usize| {
                let row = Sparse {
                    columns: width,
                    rows: vec![entries.clone()],
                };
                checked(&format!("{what} of {}", constraint.name), &row, 1, width)
            };
            let c = single("C", &constraint.c, n)?;
            let d = single("D", &constraint.d, m)?;
            let e = combined(&c, &product(&d, &k, n), 1.0, n);
            let w = combined(
                &product(&c, &mx, parameters),
                &product(&d, &mu, parameters),
                1.0,
                parameters,
            );
            let mut value = Interval::ZERO;
            for (entries, at) in [(&constraint.c, at[0]), (&constraint.d, at[1])] {
                for &(j, v) in entries {
                    // A constraint at the origin stays exact.
                    if at[j] != 0.0 {
                        value = value.add(Interval::exact(at[j]).times(v));
                    }
                }
            }
            let room = |bound: Option<f64>, sign: f64| -> Result<Option<Interval>, VerifyError> {
                let Some(bound) = bound else { return Ok(None) };
                let mut room = Interval::exact(bound);
                if value != Interval::ZERO {
                    room = room.sub(value);
                }
                let room = if sign < 0.0 { room.neg() } else { room };
                if room.lo > 0.0 && room.hi.is_finite() {
                    Ok(Some(room))
                } else {
                    Err(VerifyError::refused(format!(
                        "the operating point is not strictly inside {}",
                        constraint.name
                    )))
                }
            };
            let (w, w_error) = split(&w[0], n);
            rows.push(ConstraintRow {
                e: e.into_iter().flatten().collect(),
                w,
                w_error,
                room: [room(constraint.upper, 1.0)?, room(constraint.lower, -1.0)?],
            });
        }
        let norms = claim
            .ellipsoids
            .iter()
            .map(|ellipsoid| norm_of(claim, ellipsoid, &k, &mx, &mu))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            states: n,
            parameters,
            scaling: claim.scaling,
            closed_loop,
            drift,
            rows,
            norms,
        })
    }

    /// Dimension of z = (e, θ).
    pub(super) fn dimension(&self) -> usize {
        self.states + self.parameters
    }

    /// Largest |ρ_i| over the box, relative to it.
    pub(super) fn largest_drift(&self, beta: &[f64]) -> f64 {
        self.drift
            .iter()
            .zip(beta)
            .map(|(row, b)| weighted(row, beta) / b)
            .fold(0.0, f64::max)
    }

    /// Constraint i at steps 0, …, `last`, where the box `beta` holds the set of `box_steps` steps. The δ of a step is
    /// valid for every point of that set up to step `box_steps`, and beyond it for every point of the set of all steps
    /// before.
    pub(super) fn along(
        &self,
        i: usize,
        last: usize,
        beta: &[f64],
        box_steps: usize,
    ) -> Vec<StepRow> {
        self.row_along(&self.rows[i], last, beta, box_steps)
    }

    /// The components of an ellipsoid, likewise.
    pub(super) fn norm_along(
        &self,
        k: usize,
        last: usize,
        beta: &[f64],
        box_steps: usize,
    ) -> Vec<Vec<StepRow>> {
        let components = self.norms[k].components.iter();
        components
            .map(|row| self.row_along(row, last, beta, box_steps))
            .collect()
    }

    fn row_along(
        &self,
        row: &ConstraintRow,
        last: usize,
        beta: &[f64],
        box_steps: usize,
    ) -> Vec<StepRow> {
        let room = row
            .room
            .iter()
            .flatten()
            .fold(f64::INFINITY, |a, r| a.min(r.lo));
        let of_w = row.static_slack(beta);
        let mut sum = Accumulator::new(self.states);
        let mut steps: Vec<StepRow> = Vec::with_capacity(last + 1);
        // Steps 0, …, b: intervals. What ρ adds is kept apart from the widths.
        let mut exact = row.e.clone();
        let mut of_drift = 0.0;
        let mut widths = Entries::new();
        for s in 0..=last.min(box_steps) {
            if s > 0 {
                of_drift = self.drifted(of_drift, &exact, beta);
                exact = self.stepped(&exact, &mut sum);
            }
            let (e, error) = split(&exact, 0);
            let slack = add_up(add_up(of_w, of_drift), weighted(&error, beta));
            steps.push(StepRow { e, slack });
            widths = error;
        }
        if last <= box_steps {
            return steps;
        }
        // Step b + 1: the widths of step b act on e(s − b), which need not lie in the box yet. Â takes them back to
        // e(s − b − 1), which does.
        let mut slack = add_up(of_w, self.drifted(of_drift, &exact, beta));
        for &(k, v) in &widths {
            for &(j, f) in &self.closed_loop[k] {
                slack = add_up(slack, mul_up(mul_up(v, f.magnitude()), beta[j]));
            }
        }
        for s in box_steps + 1..=last {
            let e: Vec<(usize, Interval)> = steps[s - 1]
                .e
                .iter()
                .map(|&(j, v)| (j, Interval::exact(v)))
                .collect();
            if s > box_steps + 1 {
                slack = self.drifted(slack, &e, beta);
            }
            let mut kept = Vec::with_capacity(e.len());
            for (j, v) in self.stepped(&e, &mut sum) {
                let keep = if v.magnitude() * beta[j] > DROP * room {
                    v.middle()
                } else {
                    0.0
                };
                let error = v.sub(Interval::exact(keep)).magnitude();
                slack = add_up(slack, mul_up(error, beta[j]));
                if keep != 0.0 {
                    kept.push((j, keep));
                }
            }
            steps.push(StepRow { e: kept, slack });
        }
        steps
    }

    /// g Â.
    fn stepped(&self, g: &[(usize, Interval)], sum: &mut Accumulator) -> Vec<(usize, Interval)> {
        for &(k, v) in g {
            for &(j, f) in &self.closed_loop[k] {
                sum.add(j, scaled(f, v));
            }
        }
        sum.take()
    }

    /// `slack` + ‖g ρ‖_β.
    fn drifted(&self, slack: f64, g: &[(usize, Interval)], beta: &[f64]) -> f64 {
        g.iter().fold(slack, |sum, &(k, v)| {
            let drift = weighted(&self.drift[k], beta);
            add_up(sum, mul_up(v.magnitude(), drift))
        })
    }
}

/// An ellipsoid of the file at step 0.
fn norm_of(
    claim: &Claim,
    ellipsoid: &Ellipsoid,
    k: &IntervalRows,
    mx: &IntervalRows,
    mu: &IntervalRows,
) -> Result<Norm, VerifyError> {
    let (n, m) = (claim.a.rows.len(), claim.b.columns);
    let parameters = claim.state_basis.columns;
    let name = &ellipsoid.name;
    let q = ellipsoid.f.rows.len();
    let f = checked(&format!("F of {name}"), &ellipsoid.f, q, n)?;
    let g = checked(&format!("G of {name}"), &ellipsoid.g, q, m)?;
    let centers = [&ellipsoid.center_state, &ellipsoid.center_input];
    if q == 0
        || centers[0].len() != n
        || centers[1].len() != m
        || centers.iter().any(|c| c.iter().any(|v| !v.is_finite()))
    {
        return Err(VerifyError::refused(format!(
            "{name} is no ellipsoid of this plant"
        )));
    }
    let e = combined(&f, &product(&g, k, n), 1.0, n);
    let w = combined(
        &product(&f, mx, parameters),
        &product(&g, mu, parameters),
        1.0,
        parameters,
    );
    // h = F (x_op − x_c) + G (u_op − u_c); exactly 0 around the operating point.
    let at = [&claim.operating_state, &claim.operating_input];
    let mut offset = vec![Interval::ZERO; q];
    for (side, matrix) in [&f, &g].into_iter().enumerate() {
        for (h, row) in offset.iter_mut().zip(matrix) {
            for &(j, v) in row {
                let from = (at[side][j], centers[side][j]);
                if from.0 != from.1 {
                    let shift = Interval::exact(from.0).sub(Interval::exact(from.1));
                    *h = h.add(v.mul(shift));
                }
            }
        }
    }
    let far = offset
        .iter()
        .fold(0.0, |s, h| add_up(s, mul_up(h.magnitude(), h.magnitude())));
    if !(far < 1.0) {
        return Err(VerifyError::refused(format!(
            "the operating point is not strictly inside {name}"
        )));
    }
    let components = e
        .iter()
        .zip(&w)
        .map(|(e, w)| {
            let (w, w_error) = split(w, n);
            ConstraintRow {
                e: e.clone(),
                w,
                w_error,
                // A component is at most 1 in size; what is dropped from it is measured by that.
                room: [Some(Interval::exact(1.0)); 2],
            }
        })
        .collect();
    Ok(Norm { components, offset })
}

/// Doubles near interval coefficients, and how far off they may be; columns moved by `shift`.
fn split(row: &[(usize, Interval)], shift: usize) -> (Entries, Entries) {
    let middle = row.iter().map(|&(j, v)| (j + shift, v.middle()));
    let error = row
        .iter()
        .map(|&(j, v)| (j + shift, v.sub(Interval::exact(v.middle())).magnitude()));
    (
        middle.filter(|e| e.1 != 0.0).collect(),
        error.filter(|e| e.1 != 0.0).collect(),
    )
}
