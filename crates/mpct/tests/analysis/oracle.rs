//! The oracle: problem (30), (9) or (35) written out with states as variables, from public matrices alone, and solved
//! by Clarabel. It shares neither coordinates nor elimination with the library.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SupportedConeT, ZeroConeT,
};
use mpct::{SparseMatrix, Task, TerminalIngredients};

/// Which problem is written out.
#[derive(Clone, Copy, Debug)]
pub enum Terminal {
    /// (30) with Theorem 2's last step: `steps` = M̃, rows of X_aug,t at steps N, …, N + M̃.
    Implicit { steps: usize },
    /// (9): the rows of the explicit set at step N.
    Explicit,
    /// (35): inputs up to step N + M̄ − 1, states up to N + M̄; terminal weight γ.
    None { steps: usize, gamma: f64 },
}

/// The answer of the oracle.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The largest t with every inequality slack by t, at most 1; the problem is feasible when it is ≥ 0.
    pub depth: f64,
}

/// Triplets of a conic program A v + s = b, built up row by row.
#[derive(Default)]
pub struct Rows {
    pub entries: Vec<(usize, usize, f64)>,
    pub bounds: Vec<f64>,
}

impl Rows {
    pub fn push(&mut self, row: Vec<(usize, f64)>, bound: f64) {
        let i = self.bounds.len();
        self.entries.extend(
            row.into_iter()
                .filter(|e| e.1 != 0.0)
                .map(|(j, v)| (i, j, v)),
        );
        self.bounds.push(bound);
    }
}

/// min ½ vᵀPv + qᵀv with equalities and inequalities; (v, objective) when solved.
pub fn solve(
    p: &[(usize, usize, f64)],
    q: &[f64],
    equal: &Rows,
    at_most: &Rows,
) -> Option<(Vec<f64>, f64)> {
    let n = q.len();
    let (e, l) = (equal.bounds.len(), at_most.bounds.len());
    let mut triplets = equal.entries.clone();
    triplets.extend(at_most.entries.iter().map(|&(i, j, v)| (i + e, j, v)));
    let csc = |rows: usize, t: &[(usize, usize, f64)]| {
        CscMatrix::new_from_triplets(
            rows,
            n,
            t.iter().map(|t| t.0).collect(),
            t.iter().map(|t| t.1).collect(),
            t.iter().map(|t| t.2).collect(),
        )
    };
    let upper: Vec<_> = p.iter().copied().filter(|t| t.0 <= t.1).collect();
    let b: Vec<f64> = equal
        .bounds
        .iter()
        .chain(&at_most.bounds)
        .copied()
        .collect();
    let cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(e), NonnegativeConeT(l)];
    let settings = DefaultSettings {
        verbose: false,
        presolve_enable: false,
        ..DefaultSettings::default()
    };
    let mut solver = DefaultSolver::new(
        &csc(n, &upper),
        q,
        &csc(e + l, &triplets),
        &b,
        &cones,
        settings,
    )
    .ok()?;
    solver.solve();
    let s = &solver.solution;
    s.x.iter()
        .all(|v| v.is_finite())
        .then(|| (s.x.clone(), s.obj_val))
        .filter(|_| {
            // The residual of the equalities says whether the answer is one.
            equal.bounds.iter().enumerate().all(|(i, b)| {
                let at: f64 = equal
                    .entries
                    .iter()
                    .filter(|t| t.0 == i)
                    .map(|t| t.2 * s.x[t.1])
                    .sum();
                (at - b).abs() < 1e-6
            })
        })
}

/// Layout of the lifted variables: x_0 … x_T, u_0 … u_{T}, θ.
pub struct Layout {
    pub n: usize,
    pub m: usize,
    pub steps: usize,
    pub parameters: usize,
}

impl Layout {
    pub fn x(&self, j: usize, i: usize) -> usize {
        j * self.n + i
    }
    pub fn u(&self, j: usize, i: usize) -> usize {
        (self.steps + 1) * self.n + j * self.m + i
    }
    pub fn theta(&self, i: usize) -> usize {
        (self.steps + 1) * (self.n + self.m) + i
    }
    pub fn len(&self) -> usize {
        (self.steps + 1) * (self.n + self.m) + self.parameters
    }
}

fn times(m: &SparseMatrix, i: usize, at: impl Fn(usize) -> usize, f: f64) -> Vec<(usize, f64)> {
    m.row(i).map(|(j, v)| (at(j), f * v)).collect()
}

/// Dynamics, terminal law and inequalities; the initial state is left free.
pub fn lifted(design: &TerminalIngredients, terminal: Terminal) -> (Layout, Rows, Rows) {
    let problem = design.problem();
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let horizon = problem.prediction_horizon();
    let tail = match terminal {
        Terminal::Implicit { steps } | Terminal::None { steps, .. } => steps,
        Terminal::Explicit => 0,
    };
    let tracking = problem.task() == Task::Tracking;
    let l = Layout {
        n,
        m,
        steps: horizon + tail,
        parameters: if tracking { m } else { 0 },
    };
    let (mut equal, mut at_most) = (Rows::default(), Rows::default());
    for j in 0..l.steps {
        for i in 0..n {
            let mut row = vec![(l.x(j + 1, i), 1.0)];
            row.extend(times(problem.plant().a(), i, |k| l.x(j, k), -1.0));
            row.extend(times(problem.plant().b(), i, |k| l.u(j, k), -1.0));
            equal.push(row, 0.0);
        }
    }
    let steady = design.steady_states();
    let k_mx = design.gain().mul(steady.state_basis());
    for j in horizon..=l.steps {
        for i in 0..m {
            // u_j = K (x_j − M_θx θ) + M_θu θ.
            let mut row = vec![(l.u(j, i), 1.0)];
            row.extend(times(design.gain(), i, |k| l.x(j, k), -1.0));
            if tracking {
                row.extend(times(&k_mx, i, |k| l.theta(k), 1.0));
                row.extend(times(steady.input_basis(), i, |k| l.theta(k), -1.0));
            }
            equal.push(row, 0.0);
        }
    }
    let rows = problem.rows();
    for j in 0..=l.steps {
        for i in 0..rows.len() {
            let last = match terminal {
                Terminal::Implicit { .. } => true,
                Terminal::Explicit => j < horizon,
                Terminal::None { .. } => j < l.steps || rows.d.row(i).len() == 0,
            };
            if last {
                let mut row = times(&rows.c, i, |k| l.x(j, k), 1.0);
                row.extend(times(&rows.d, i, |k| l.u(j, k), 1.0));
                at_most.push(row, 1.0);
            }
        }
    }
    if let Terminal::Explicit = terminal {
        let set = design.maximal_admissible_set().expect("explicit set");
        for k in 0..set.len() {
            let row = set
                .rows()
                .row(k)
                .map(|(j, v)| {
                    (
                        if j < n {
                            l.x(horizon, j)
                        } else {
                            l.theta(j - n)
                        },
                        v,
                    )
                })
                .collect();
            at_most.push(row, 1.0);
        }
    } else if tracking {
        for i in 0..rows.len() {
            let mut row = vec![0.0; m];
            for (k, c) in rows.c.row(i) {
                for (t, v) in steady.state_basis().row(k) {
                    row[t] += c * v;
                }
            }
            for (k, d) in rows.d.row(i) {
                for (t, v) in steady.input_basis().row(k) {
                    row[t] += d * v;
                }
            }
            at_most.push(
                row.iter()
                    .enumerate()
                    .map(|(t, v)| (l.theta(t), *v))
                    .collect(),
                problem.scaling(),
            );
        }
    }
    (l, equal, at_most)
}

/// How deep inside the feasible set a state (shifted coordinates) is.
pub fn depth(design: &TerminalIngredients, terminal: Terminal, x: &[f64]) -> Answer {
    let (l, mut equal, mut at_most) = lifted(design, terminal);
    let t = l.len();
    for (i, &v) in x.iter().enumerate() {
        equal.push(vec![(l.x(0, i), 1.0)], v);
    }
    for i in 0..at_most.bounds.len() {
        at_most.entries.push((i, t, 1.0));
    }
    at_most.push(vec![(t, 1.0)], 1.0);
    let mut q = vec![0.0; t + 1];
    q[t] = -1.0;
    let (v, _) = solve(&[], &q, &equal, &at_most).expect("the oracle's program");
    Answer { depth: v[t] }
}

/// The optimal value of (10), or of its variant in (35), at a state and a set-point's state (shifted coordinates).
pub fn optimal_cost(
    design: &TerminalIngredients,
    terminal: Terminal,
    x: &[f64],
    set_point: &[f64],
) -> Option<(f64, Vec<f64>)> {
    let (l, mut equal, at_most) = lifted(design, terminal);
    for (i, &v) in x.iter().enumerate() {
        equal.push(vec![(l.x(0, i), 1.0)], v);
    }
    let problem = design.problem();
    let (n, m, horizon) = (l.n, l.m, problem.prediction_horizon());
    let steady = design.steady_states();
    let mut p = std::collections::BTreeMap::<(usize, usize), f64>::new();
    let mut q = vec![0.0; l.len()];
    let mut constant = 0.0;
    // ‖E v − g‖²_W for each term.
    let mut add = |w: &SparseMatrix, e: Vec<Vec<(usize, f64)>>, g: &[f64], f: f64| {
        for (a, b, w) in w.entries() {
            for &(i, vi) in &e[a] {
                for &(j, vj) in &e[b] {
                    *p.entry((i, j)).or_default() += 2.0 * f * w * vi * vj;
                }
                q[i] -= f * w * vi * g[b];
            }
            for &(j, vj) in &e[b] {
                q[j] -= f * w * vj * g[a];
            }
            constant += f * w * g[a] * g[b];
        }
    };
    let tracking = l.parameters > 0;
    let merged = |list: Vec<(usize, f64)>| list;
    let dx = |j: usize| -> Vec<Vec<(usize, f64)>> {
        (0..n)
            .map(|i| {
                let mut row = vec![(l.x(j, i), 1.0)];
                if tracking {
                    row.extend(times(steady.state_basis(), i, |k| l.theta(k), -1.0));
                }
                merged(row)
            })
            .collect()
    };
    let du = |j: usize| -> Vec<Vec<(usize, f64)>> {
        (0..m)
            .map(|i| {
                let mut row = vec![(l.u(j, i), 1.0)];
                if tracking {
                    row.extend(times(steady.input_basis(), i, |k| l.theta(k), -1.0));
                }
                row
            })
            .collect()
    };
    let (end, gamma) = match terminal {
        Terminal::None { steps, gamma } => (horizon + steps, gamma),
        Terminal::Implicit { steps } => (horizon + steps, 1.0),
        Terminal::Explicit => (horizon, 1.0),
    };
    for j in 0..end {
        add(problem.state_weight(), dx(j), &vec![0.0; n], 1.0);
        add(problem.input_weight(), du(j), &vec![0.0; m], 1.0);
    }
    add(design.terminal_weight(), dx(end), &vec![0.0; n], gamma);
    if tracking {
        let e = (0..n)
            .map(|i| times(steady.state_basis(), i, |k| l.theta(k), 1.0))
            .collect();
        add(problem.offset_weight(), e, set_point, 1.0);
    }
    let p: Vec<_> = p.into_iter().map(|((i, j), v)| (i, j, v)).collect();
    solve(&p, &q, &equal, &at_most).map(|(v, value)| (value + constant, v))
}
