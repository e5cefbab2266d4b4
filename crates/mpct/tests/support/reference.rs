//! Sections 2 and 3 of the paper as printed: terminal horizons, the explicit set, the problems (9) and (30), and the
//! admissible equilibrium closest to a set-point.
//!
//! K, M_θ and P are taken from the design under test (tests of their own check them); everything else is built anew,
//! in shifted coordinates.

use super::linear::{
    self, Mat, apply, apply_transposed, combine, dense, dot, minus, mul, plus, zeros,
};
use super::program::{Answer, Program, Row, Solution, sparse};
use mpct::{Problem, TerminalIngredients};

/// A support at most this counts as ≤ 1. The horizons of the cases are the same from 0 to 1e-6.
pub const SPENT: f64 = 1.0 + 1e-7;

/// The plant, constraints, weights and ingredients as nested vectors.
#[derive(Clone, Debug)]
pub struct Reference {
    pub n: usize,
    pub m: usize,
    pub a: Mat,
    pub b: Mat,
    /// C x + D u ≤ 1.
    pub c: Mat,
    pub d: Mat,
    pub q: Mat,
    pub r: Mat,
    pub o: Mat,
    pub o_input: Mat,
    pub scaling: f64,
    pub horizon: usize,
    pub k: Mat,
    pub p: Mat,
    pub mx: Mat,
    pub mu: Mat,
    /// L = [−K I] M_θ.
    pub l: Mat,
}

/// Which form of (15)/(26).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    First,
    Second,
}

/// How an LP is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writing {
    /// In (x, θ): the rows G̃ Aaug^j.
    Plain,
    /// With x_0, …, x_M̃ as variables and the dynamics as equations.
    Lifted,
}

/// The terminal dynamics z⁺ = F z and constraints G z ≤ 1: (21)–(24) for tracking, (13)–(19) for regulation.
#[derive(Clone, Debug)]
pub struct Terminal {
    pub dynamics: Mat,
    pub rows: Mat,
    /// Index in `rows` of each constraint row of the problem; rows that vanish are `None`.
    pub constraint: Vec<Option<usize>>,
}

impl Reference {
    pub fn new(ingredients: &TerminalIngredients) -> Self {
        let problem: &Problem = ingredients.problem();
        let k = dense(ingredients.gain());
        let mx = dense(ingredients.steady_states().state_basis());
        let mu = dense(ingredients.steady_states().input_basis());
        let l = combine(1.0, &mu, -1.0, &mul(&k, &mx));
        Self {
            n: problem.plant().states(),
            m: problem.plant().inputs(),
            a: dense(problem.plant().a()),
            b: dense(problem.plant().b()),
            c: dense(&problem.rows().c),
            d: dense(&problem.rows().d),
            q: dense(problem.state_weight()),
            r: dense(problem.input_weight()),
            o: dense(problem.offset_weight()),
            o_input: dense(problem.offset_input_weight()),
            scaling: problem.scaling(),
            horizon: problem.prediction_horizon(),
            k,
            p: dense(ingredients.terminal_weight()),
            mx,
            mu,
            l,
        }
    }

    /// A + B K.
    pub fn closed_loop(&self) -> Mat {
        combine(1.0, &self.a, 1.0, &mul(&self.b, &self.k))
    }

    /// C M_θx + D M_θu.
    pub fn equilibrium_rows(&self) -> Mat {
        combine(1.0, &mul(&self.c, &self.mx), 1.0, &mul(&self.d, &self.mu))
    }

    /// (21)–(24).
    pub fn tracking(&self) -> Terminal {
        let (ak, bl) = (self.closed_loop(), mul(&self.b, &self.l));
        let mut dynamics: Mat = ak
            .iter()
            .zip(&bl)
            .map(|(a, b)| a.iter().chain(b).copied().collect())
            .collect();
        for i in 0..self.m {
            let mut row = vec![0.0; self.n + self.m];
            row[self.n + i] = 1.0;
            dynamics.push(row);
        }
        let x = combine(1.0, &self.c, 1.0, &mul(&self.d, &self.k));
        let theta = mul(&self.d, &self.l);
        let upper = x
            .iter()
            .zip(&theta)
            .map(|(x, t)| x.iter().chain(t).copied().collect());
        let lower = self.equilibrium_rows().into_iter().map(|w| {
            let mut row = vec![0.0; self.n];
            row.extend(w.iter().map(|v| v / self.scaling));
            row
        });
        Terminal::new(dynamics, upper.collect(), lower.collect())
    }

    /// (13)–(19).
    pub fn regulation(&self) -> Terminal {
        let rows = combine(1.0, &self.c, 1.0, &mul(&self.d, &self.k));
        Terminal::new(self.closed_loop(), rows, Vec::new())
    }

    /// The admissible equilibrium closest to a set-point, in (x_s, u_s): A x_s + B u_s = x_s, C x_s + D u_s ≤ λ. Among
    /// those with the least offset cost the state is unique, the input need not be.
    pub fn closest_equilibrium(&self, state: &[f64], input: &[f64]) -> (Vec<f64>, Vec<f64>, f64) {
        let (n, m) = (self.n, self.m);
        let mut program = Program::new(n + m);
        let unit = |from: usize, count: usize| -> Vec<Row> {
            (0..count).map(|i| vec![(from + i, 1.0)]).collect()
        };
        let minus_state: Vec<f64> = state.iter().map(|v| -v).collect();
        let minus_input: Vec<f64> = input.iter().map(|v| -v).collect();
        program.add_square(2.0, &self.o, &unit(0, n), &minus_state);
        program.add_square(2.0, &self.o_input, &unit(n, m), &minus_input);
        for i in 0..n {
            let mut row: Vec<f64> = self.a[i].iter().chain(&self.b[i]).copied().collect();
            row[i] -= 1.0;
            program.equal.push((sparse(&row), 0.0));
        }
        for (c, d) in self.c.iter().zip(&self.d) {
            let row: Vec<f64> = c.iter().chain(d).copied().collect();
            program.at_most.push((sparse(&row), self.scaling));
        }
        let z = program.solve_sharply().optimum().z;
        let (xs, us) = (z[..n].to_vec(), z[n..].to_vec());
        let cost = linear::quadratic(&self.o, &minus(&xs, state))
            + linear::quadratic(&self.o_input, &minus(&us, input));
        (xs, us, cost)
    }

    /// ℓ (4).
    pub fn stage_cost(&self, x: &[f64], u: &[f64], xs: &[f64], us: &[f64]) -> f64 {
        linear::quadratic(&self.q, &minus(x, xs)) + linear::quadratic(&self.r, &minus(u, us))
    }

    pub fn successor(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        plus(&apply(&self.a, x), &apply(&self.b, u))
    }

    /// Largest C x + D u − 1.
    pub fn violation(&self, x: &[f64], u: &[f64]) -> f64 {
        self.c
            .iter()
            .zip(&self.d)
            .map(|(c, d)| dot(c, x) + dot(d, u) - 1.0)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// (30) as printed and the last step, that is (x_{N+M}, θ) ∈ Xaug,t, as a sparse program in
    /// (x_0, …, x_{N+M}, u_0, …, u_{N+M−1}, θ), with the cost V_{N+M}: stage costs up to N + M − 1, then the terminal
    /// and the offset cost. θ = 0 when `tracking` is false.
    pub fn implicit_problem(
        &self,
        x: &[f64],
        set_point: (&[f64], &[f64]),
        terminal_horizon: usize,
        tracking: bool,
    ) -> TrackingProblem {
        let last = self.horizon + terminal_horizon;
        let (mut program, layout, constant) = self.stages(x, set_point, last, tracking);
        let theta = layout.theta;
        for j in self.horizon..last {
            // (30e) u_j = K x_j + L θ.
            for i in 0..self.m {
                let mut row: Row = vec![(layout.u(j) + i, 1.0)];
                row.extend(
                    sparse(&self.k[i])
                        .iter()
                        .map(|&(s, v)| (layout.x(j) + s, -v)),
                );
                row.extend(sparse(&self.l[i]).iter().map(|&(t, v)| (theta + t, -v)));
                program.equal.push((row, 0.0));
            }
        }
        // The last step, which (30) leaves out: C x + D (K x + L θ) ≤ 1.
        let x_rows = combine(1.0, &self.c, 1.0, &mul(&self.d, &self.k));
        let t_rows = mul(&self.d, &self.l);
        for (g, t) in x_rows.iter().zip(&t_rows) {
            let mut row: Row = sparse(g)
                .iter()
                .map(|&(s, v)| (layout.x(last) + s, v))
                .collect();
            row.extend(sparse(t).iter().map(|&(t, v)| (theta + t, v)));
            program.at_most.push((row, 1.0));
        }
        TrackingProblem {
            program,
            layout,
            constant,
            tracking,
        }
    }

    /// (9) with the set {(x, θ) : G (x, θ) ≤ 1} for Ψ.
    pub fn explicit_problem(
        &self,
        x: &[f64],
        set_point: (&[f64], &[f64]),
        set: &Mat,
        tracking: bool,
    ) -> TrackingProblem {
        let (mut program, layout, constant) = self.stages(x, set_point, self.horizon, tracking);
        for g in set {
            let row = sparse(g)
                .iter()
                .map(|&(j, v)| {
                    if j < self.n {
                        (layout.x(self.horizon) + j, v)
                    } else {
                        (layout.theta + j - self.n, v)
                    }
                })
                .collect();
            program.at_most.push((row, 1.0));
        }
        TrackingProblem {
            program,
            layout,
            constant,
            tracking,
        }
    }

    /// Dynamics, constraints, θ ∈ λΘ and the cost for stages 0, …, last.
    fn stages(
        &self,
        x: &[f64],
        (xr, ur): (&[f64], &[f64]),
        last: usize,
        tracking: bool,
    ) -> (Program, Layout, f64) {
        let (n, m) = (self.n, self.m);
        let layout = Layout {
            n,
            m,
            inputs: (last + 1) * n,
            theta: (last + 1) * n + last * m,
        };
        let mut program = Program::new(layout.theta + m);
        let mut constant = 0.0;
        for i in 0..n {
            program.equal.push((vec![(i, 1.0)], x[i]));
        }
        let mx: Vec<Row> = self.mx.iter().map(|r| sparse(r)).collect();
        let mu: Vec<Row> = self.mu.iter().map(|r| sparse(r)).collect();
        let deviation = |from: usize, basis: &[Row]| -> Vec<Row> {
            basis
                .iter()
                .enumerate()
                .map(|(i, r)| {
                    let mut row: Row = vec![(from + i, 1.0)];
                    row.extend(r.iter().map(|&(t, v)| (layout.theta + t, -v)));
                    row
                })
                .collect()
        };
        for j in 0..last {
            for i in 0..n {
                let mut row: Row = vec![(layout.x(j + 1) + i, 1.0)];
                row.extend(
                    sparse(&self.a[i])
                        .iter()
                        .map(|&(s, v)| (layout.x(j) + s, -v)),
                );
                row.extend(
                    sparse(&self.b[i])
                        .iter()
                        .map(|&(s, v)| (layout.u(j) + s, -v)),
                );
                program.equal.push((row, 0.0));
            }
            for (c, d) in self.c.iter().zip(&self.d) {
                // (30c) starts at x_1: rows of the state alone are not asked of x_0.
                if j == 0 && linear::largest(d) == 0.0 {
                    continue;
                }
                let mut row: Row = sparse(c)
                    .iter()
                    .map(|&(s, v)| (layout.x(j) + s, v))
                    .collect();
                row.extend(sparse(d).iter().map(|&(s, v)| (layout.u(j) + s, v)));
                program.at_most.push((row, 1.0));
            }
            constant +=
                program.add_square(2.0, &self.q, &deviation(layout.x(j), &mx), &vec![0.0; n]);
            constant +=
                program.add_square(2.0, &self.r, &deviation(layout.u(j), &mu), &vec![0.0; m]);
        }
        constant +=
            program.add_square(2.0, &self.p, &deviation(layout.x(last), &mx), &vec![0.0; n]);
        if tracking {
            let shifted = |basis: &[Row]| -> Vec<Row> {
                basis
                    .iter()
                    .map(|r| r.iter().map(|&(t, v)| (layout.theta + t, v)).collect())
                    .collect()
            };
            let negative = |v: &[f64]| -> Vec<f64> { v.iter().map(|v| -v).collect() };
            constant += program.add_square(2.0, &self.o, &shifted(&mx), &negative(xr));
            constant += program.add_square(2.0, &self.o_input, &shifted(&mu), &negative(ur));
            for w in self.equilibrium_rows() {
                let row = sparse(&w)
                    .iter()
                    .map(|&(t, v)| (layout.theta + t, v))
                    .collect();
                program.at_most.push((row, self.scaling));
            }
        } else {
            for t in 0..m {
                program.equal.push((vec![(layout.theta + t, 1.0)], 0.0));
            }
        }
        (program, layout, constant)
    }
}

/// Where the variables stand.
#[derive(Clone, Copy, Debug)]
struct Layout {
    n: usize,
    m: usize,
    inputs: usize,
    theta: usize,
}

impl Layout {
    fn x(&self, j: usize) -> usize {
        j * self.n
    }

    fn u(&self, j: usize) -> usize {
        self.inputs + j * self.m
    }
}

/// (9) or (30) for one state and set-point.
#[derive(Clone, Debug)]
pub struct TrackingProblem {
    program: Program,
    layout: Layout,
    constant: f64,
    tracking: bool,
}

/// The optimum of (9) or (30).
#[derive(Clone, Debug)]
pub struct Optimum {
    pub cost: f64,
    /// u_0.
    pub input: Vec<f64>,
    pub theta: Vec<f64>,
}

impl TrackingProblem {
    /// The optimum in the variables as printed; `None` when no point satisfies the constraints (proved).
    pub fn solve(&self) -> Option<Optimum> {
        match self.program.solve() {
            Answer::Optimal(s) => Some(self.optimum(&s)),
            Answer::Infeasible { .. } => None,
            Answer::Unbounded => panic!("the cost of a tracking problem is bounded below"),
        }
    }

    fn optimum(&self, s: &Solution) -> Optimum {
        let layout = &self.layout;
        Optimum {
            cost: s.value + self.constant,
            input: s.z[layout.u(0)..layout.u(0) + layout.m].to_vec(),
            theta: s.z[layout.theta..].to_vec(),
        }
    }

    /// The optimum to rounding level, with the equations of the program substituted: each of them gives one variable
    /// by those before it. Needs a unique optimum.
    pub fn solve_sharply(&self, horizon: usize) -> Option<Optimum> {
        let (layout, m) = (&self.layout, self.layout.m);
        let parameters = if self.tracking { m } else { 0 };
        let free = horizon * m + parameters;
        // Each variable as (coefficients of the free ones, constant).
        let mut known: Vec<Option<(Vec<f64>, f64)>> = vec![None; self.program.variables];
        let unit = |i: usize| {
            let mut v = vec![0.0; free];
            v[i] = 1.0;
            Some((v, 0.0))
        };
        for i in 0..horizon * m {
            known[layout.inputs + i] = unit(i);
        }
        for t in 0..parameters {
            known[layout.theta + t] = unit(horizon * m + t);
        }
        let mut open: Vec<&(Row, f64)> = self.program.equal.iter().collect();
        while !open.is_empty() {
            let before = open.len();
            open.retain(|(row, right)| {
                let unknown: Vec<_> = row.iter().filter(|e| known[e.0].is_none()).collect();
                let [&(j, v)] = unknown[..] else {
                    return true;
                };
                let mut value = (vec![0.0; free], *right);
                for &(i, c) in row.iter().filter(|e| e.0 != j) {
                    if let Some((coefficients, constant)) = &known[i] {
                        for (o, k) in value.0.iter_mut().zip(coefficients) {
                            *o -= c * k;
                        }
                        value.1 -= c * constant;
                    }
                }
                for o in &mut value.0 {
                    *o /= v;
                }
                value.1 /= v;
                known[j] = Some(value);
                false
            });
            assert!(open.len() < before, "an equation gives no new variable");
        }
        let known: Vec<(Vec<f64>, f64)> = known
            .into_iter()
            .map(|k| k.expect("every variable is given by an equation or free"))
            .collect();
        let mut condensed = Program::new(free);
        let mut constant = self.constant;
        let mut hessian = zeros(free, free);
        for (j, f) in self.program.linear.iter().enumerate() {
            for (o, k) in condensed.linear.iter_mut().zip(&known[j].0) {
                *o += f * k;
            }
            constant += f * known[j].1;
        }
        for &(i, j, v) in &self.program.hessian {
            let ((ki, ci), (kj, cj)) = (&known[i], &known[j]);
            // ½ v z_i z_j, twice off the diagonal.
            let pairs: &[_] = if i == j {
                &[(ki, ci, kj, cj)]
            } else {
                &[(ki, ci, kj, cj), (kj, cj, ki, ci)]
            };
            for (left, left_constant, right, right_constant) in pairs {
                for (a, va) in left.iter().enumerate().filter(|e| *e.1 != 0.0) {
                    for (h, vb) in hessian[a].iter_mut().zip(right.iter()) {
                        *h += v * va * vb;
                    }
                    condensed.linear[a] += 0.5 * v * va * **right_constant;
                }
                for (b, vb) in right.iter().enumerate() {
                    condensed.linear[b] += 0.5 * v * vb * **left_constant;
                }
                constant += 0.5 * v * **left_constant * **right_constant;
            }
        }
        for (a, row) in hessian.iter().enumerate() {
            for (b, v) in row.iter().enumerate().skip(a) {
                condensed.hessian.push((a, b, 0.5 * (v + hessian[b][a])));
            }
        }
        for (row, bound) in &self.program.at_most {
            let mut coefficients = vec![0.0; free];
            let mut right = *bound;
            for &(j, v) in row {
                for (o, k) in coefficients.iter_mut().zip(&known[j].0) {
                    *o += v * k;
                }
                right -= v * known[j].1;
            }
            condensed.at_most.push((sparse(&coefficients), right));
        }
        match condensed.solve_sharply() {
            Answer::Optimal(s) => Some(Optimum {
                cost: s.value + constant,
                input: s.z[..m].to_vec(),
                theta: if self.tracking {
                    s.z[horizon * m..].to_vec()
                } else {
                    vec![0.0; m]
                },
            }),
            Answer::Infeasible { .. } => None,
            Answer::Unbounded => panic!("the cost of a tracking problem is bounded below"),
        }
    }
}

impl Terminal {
    fn new(dynamics: Mat, constraint_rows: Mat, other_rows: Mat) -> Self {
        // A row without coefficients says 0 ≤ 1.
        let scale = linear::max_abs(&constraint_rows).max(linear::max_abs(&other_rows));
        let says_something = |row: &Vec<f64>| linear::largest(row) > 1e-13 * scale;
        let mut rows = Vec::new();
        let constraint = constraint_rows
            .into_iter()
            .map(|row| {
                says_something(&row).then(|| {
                    rows.push(row);
                    rows.len() - 1
                })
            })
            .collect();
        rows.extend(other_rows.into_iter().filter(says_something));
        Self {
            dynamics,
            rows,
            constraint,
        }
    }

    /// G F^j for j = 0, …, last.
    fn powers(&self, last: usize) -> Vec<Mat> {
        let mut powers = vec![self.rows.clone()];
        for j in 0..last {
            powers.push(mul(&powers[j], &self.dynamics));
        }
        powers
    }

    /// The rows of the intersection over j = 0, …, M of F^{-j} {G z ≤ 1}: (16), (27).
    pub fn intersection(&self, horizon: usize) -> Mat {
        self.powers(horizon).concat()
    }

    /// h over the intersection up to step `last`, of each objective. +∞ when it is unbounded (proved).
    fn supports(&self, last: usize, objectives: &[Vec<f64>], writing: Writing) -> Vec<f64> {
        let z = self.dynamics.len();
        let mut program = match writing {
            Writing::Plain => {
                let mut program = Program::new(z);
                for row in self.intersection(last) {
                    program.at_most.push((sparse(&row), 1.0));
                }
                program
            }
            Writing::Lifted => {
                let mut program = Program::new(z * (last + 1));
                let at = |j: usize, row: &[f64]| -> Row {
                    sparse(row).iter().map(|&(i, v)| (j * z + i, v)).collect()
                };
                for j in 0..=last {
                    for row in &self.rows {
                        program.at_most.push((at(j, row), 1.0));
                    }
                    for (i, f) in self.dynamics.iter().enumerate().filter(|_| j < last) {
                        let mut row = at(j, f);
                        row.push(((j + 1) * z + i, -1.0));
                        program.equal.push((row, 0.0));
                    }
                }
                program
            }
        };
        objectives
            .iter()
            .map(|objective| {
                for (f, v) in program.linear.iter_mut().zip(objective) {
                    *f = -v;
                }
                if linear::largest(objective) < 1e-14 {
                    return 0.0;
                }
                match program.solve() {
                    Answer::Optimal(s) => -s.value,
                    Answer::Unbounded => f64::INFINITY,
                    Answer::Infeasible { .. } => panic!("the origin is inside"),
                }
            })
            .collect()
    }

    /// Whether the condition (20)/(29) holds for each row in `which` at horizon M: the supports.
    pub fn condition(
        &self,
        horizon: usize,
        which: &[usize],
        form: Form,
        writing: Writing,
    ) -> Vec<f64> {
        let over = match form {
            Form::First => horizon,
            Form::Second => 0,
        };
        // (F^{M+1})ᵀ X_i.
        let objectives: Vec<Vec<f64>> = which
            .iter()
            .map(|&i| {
                (0..=horizon).fold(self.rows[i].clone(), |row, _| {
                    apply_transposed(&self.dynamics, &row)
                })
            })
            .collect();
        self.supports(over, &objectives, writing)
    }

    /// The smallest M ≥ 1 that satisfies (20)/(29), counting up; for that M every row is checked. A row that refuses
    /// one M is asked first at the next.
    pub fn horizon(&self, form: Form, writing: Writing, give_up: usize) -> usize {
        let mut order: Vec<usize> = (0..self.rows.len()).collect();
        for horizon in 1..=give_up {
            let refused = order
                .iter()
                .position(|&i| !(self.condition(horizon, &[i], form, writing)[0] <= SPENT));
            match refused {
                None => return horizon,
                Some(k) => order[..=k].rotate_right(1),
            }
        }
        panic!("no horizon up to {give_up}");
    }

    /// The first step t ≥ 1 at which each constraint row is spent, h(O_{t−1}, (F^t)ᵀ X_i) ≤ 1, counting up over full
    /// sets O_{t−1}; and the smallest distance of a deciding support from 1, which tells how clear the answer is.
    pub fn spent_steps(&self, give_up: usize) -> (Vec<usize>, f64) {
        let mut spent = vec![0; self.rows.len()];
        let mut margin = f64::INFINITY;
        for step in 1..=give_up {
            let open: Vec<usize> = (0..spent.len()).filter(|&i| spent[i] == 0).collect();
            if open.is_empty() {
                break;
            }
            let supports = self.condition(step - 1, &open, Form::First, Writing::Plain);
            for (&i, h) in open.iter().zip(supports) {
                margin = margin.min((h - SPENT).abs());
                if h <= SPENT {
                    spent[i] = step;
                }
            }
        }
        assert!(spent.iter().all(|&s| s > 0), "rows open after {give_up}");
        // A row without coefficients is spent at once.
        let of_constraint = self
            .constraint
            .iter()
            .map(|k| k.map_or(1, |k| spent[k]))
            .collect();
        (of_constraint, margin)
    }
}

/// The support of {G z ≤ 1} without row `without`, which is held at 2 to keep the program bounded.
pub fn support_of(rows: &Mat, objective: &[f64], without: Option<usize>) -> f64 {
    let mut program = Program::new(objective.len());
    for (f, v) in program.linear.iter_mut().zip(objective) {
        *f = -v;
    }
    for (k, row) in rows.iter().enumerate() {
        let bound = if Some(k) == without { 2.0 } else { 1.0 };
        program.at_most.push((sparse(row), bound));
    }
    match program.solve() {
        Answer::Optimal(s) => -s.value,
        Answer::Unbounded => f64::INFINITY,
        Answer::Infeasible { .. } => panic!("the origin is inside"),
    }
}
