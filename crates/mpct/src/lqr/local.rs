//! K and P of plants made of subsystems, from windows of the plant.
//!
//! What an input does is decided by the states around it: the entries of K decay with the distance in the graph of
//! the plant. A few neighbouring inputs are taken together with everything within some radius of them, the Riccati
//! equation of this window is solved with full matrices, and the gains of these inputs are kept. The radius is large
//! enough when the gains have faded to rounding at the rim of the window, which the window itself shows. P is then
//! computed for exactly this K, and the optimality of K is checked once more on the whole plant,
//!   R K + BᵀP (A + B K) = 0.

use super::smith::{correction, smith};
use super::{Law, interruptible, lqr_gain, units, without_rounding};
use crate::clock::Clock;
use crate::error::DesignError;
use crate::linalg::Dense;
use crate::matrix::SparseMatrix;
use crate::problem::Problem;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Inputs that share a window: the window is a few times larger than they are, and is solved once for all of them.
const INPUTS_PER_WINDOW: usize = 6;
/// First radius of a window.
const FIRST_RADIUS: usize = 4;
/// A window is large enough when the gains at its rim are this small, relative to the largest and in units of Q:
/// what lies beyond then changes them at the level of rounding.
const FADED: f64 = 1e-15;
/// Windows with more states than this share of the plant are not worth it.
const LARGEST_SHARE: f64 = 0.5;
/// The gain is optimal when its residual is this small; the residual of full matrices is about 1e-13.
const OPTIMAL: f64 = 1e-10;

/// K and P by windows; `None` when the plant is not local.
pub(super) fn terminal_law(problem: &Problem, clock: &Clock) -> Result<Option<Law>, DesignError> {
    let (a, b) = (problem.plant().a(), problem.plant().b());
    let (q, r) = (problem.state_weight(), problem.input_weight());
    let unit = units(q);
    let gain = match problem.gain() {
        Some(k) => k.clone(),
        None => match windows(problem, &unit, clock)? {
            Some(k) => without_rounding(&k, &unit),
            None => return Ok(None),
        },
    };
    let product = |x: &SparseMatrix, y: &SparseMatrix| x.mul_with(y, |_, _| 0.0).0;
    let closed_loop = a.combine(1.0, &product(b, &gain), 1.0);
    let rk = product(r, &gain);
    let stage = q.combine(1.0, &product(&gain.transpose(), &rk), 1.0);
    let Some(found) = smith(&closed_loop, &stage, &unit, clock) else {
        interruptible(clock)?;
        return Ok(None);
    };
    // One step of refinement: the correction solves the same equation with the residual on the right.
    let pf = product(&found.sum, &closed_loop);
    let residual = product(&closed_loop.transpose(), &pf)
        .combine(1.0, &stage, 1.0)
        .combine(1.0, &found.sum, -1.0);
    let mut weight = found.sum;
    if let Some(missing) = correction(&closed_loop, &residual, &weight, &unit, clock) {
        weight = weight.combine(1.0, &missing, 1.0);
        weight = weight.combine(0.5, &weight.transpose(), 0.5);
    }
    let left = product(&closed_loop.transpose(), &product(&weight, &closed_loop))
        .combine(1.0, &stage, 1.0)
        .combine(1.0, &weight, -1.0);
    super::residual::check(problem, left.entries())?;
    if problem.gain().is_none() {
        let terms = product(&b.transpose(), &product(&weight, &closed_loop));
        let residual = rk.combine(1.0, &terms, 1.0);
        let largest = |m: &SparseMatrix| {
            m.entries()
                .fold(0.0_f64, |a, (_, j, v)| a.max(v.abs() * unit[j]))
        };
        if !(largest(&residual) <= OPTIMAL * largest(&rk)) {
            return Ok(None);
        }
    }
    Ok(Some(Law {
        gain,
        weight,
        closed_loop,
        spectral_radius: found.spectral_radius,
    }))
}

/// K from windows around its inputs.
fn windows(
    problem: &Problem,
    unit: &[f64],
    clock: &Clock,
) -> Result<Option<SparseMatrix>, DesignError> {
    let graph = Graph::of(problem);
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let radius = AtomicUsize::new(FIRST_RADIUS);
    let solved: Vec<Result<Option<Vec<GainRow>>, DesignError>> = graph
        .groups()
        .into_par_iter()
        .map(|inputs| window(problem, &graph, unit, &inputs, &radius, clock))
        .collect();
    let mut rows = vec![Vec::new(); m];
    for part in solved {
        let Some(part) = part? else { return Ok(None) };
        for (i, row) in part {
            rows[i] = row;
        }
    }
    Ok(Some(SparseMatrix::from_row_lists(m, n, rows)))
}

/// A row of K and its index.
type GainRow = (usize, Vec<(u32, f64)>);

/// Rows of K for a group of inputs.
fn window(
    problem: &Problem,
    graph: &Graph,
    unit: &[f64],
    group: &[usize],
    radius: &AtomicUsize,
    clock: &Clock,
) -> Result<Option<Vec<GainRow>>, DesignError> {
    let n = graph.states;
    loop {
        interruptible(clock)?;
        let reach = radius.load(Ordering::Relaxed);
        let ball = graph.ball(group, reach);
        let states: Vec<usize> = ball.nodes.iter().copied().filter(|&v| v < n).collect();
        let inputs: Vec<usize> = ball
            .nodes
            .iter()
            .filter(|&&v| v >= n)
            .map(|v| v - n)
            .collect();
        if states.len() as f64 > LARGEST_SHARE * n as f64 {
            return Ok(None);
        }
        if states.is_empty() {
            return Ok(Some(group.iter().map(|&i| (i, Vec::new())).collect()));
        }
        let cut = |m: &SparseMatrix, rows: &[usize], columns: &[usize]| {
            Dense::from_fn(rows.len(), columns.len(), |i, j| m.get(rows[i], columns[j]))
        };
        let k = lqr_gain(
            &cut(problem.plant().a(), &states, &states),
            &cut(problem.plant().b(), &states, &inputs),
            &cut(problem.state_weight(), &states, &states),
            &cut(problem.input_weight(), &inputs, &inputs),
            clock,
        );
        let k = match k {
            Ok(k) => k,
            Err(e @ DesignError::Interrupted { .. }) => return Err(e),
            // A window can lack what stabilizes it; a larger one has it.
            Err(_) if ball.rim.is_empty() => return Ok(None),
            Err(_) => {
                radius.fetch_max(reach + reach / 2, Ordering::Relaxed);
                continue;
            }
        };
        let (mut largest, mut rim) = (0.0_f64, 0.0_f64);
        let mut rows = Vec::with_capacity(group.len());
        for &i in group {
            // Every input of the group is in its own window.
            let Ok(place) = inputs.binary_search(&i) else {
                return Ok(None);
            };
            let mut row = Vec::with_capacity(states.len());
            for (c, &j) in states.iter().enumerate() {
                let v = k[(place, c)];
                let size = v.abs() * unit[j];
                largest = largest.max(size);
                if ball.is_rim(j) {
                    rim = rim.max(size);
                }
                row.push((j as u32, v));
            }
            rows.push((i, row));
        }
        if rim <= FADED * largest {
            return Ok(Some(rows));
        }
        radius.fetch_max(reach + (reach / 4).max(1), Ordering::Relaxed);
    }
}

/// The graph of a plant: states 0, …, n − 1 and inputs n, …, n + m − 1, joined where A, B, Q or R join them.
struct Graph {
    states: usize,
    neighbours: Vec<Vec<u32>>,
}

struct Ball {
    /// Nodes, ascending.
    nodes: Vec<usize>,
    /// The last two layers, ascending; empty when nothing lies outside. (The last one may be inputs only.)
    rim: Vec<usize>,
}

impl Ball {
    fn is_rim(&self, node: usize) -> bool {
        self.rim.binary_search(&node).is_ok()
    }
}

impl Graph {
    fn of(problem: &Problem) -> Self {
        let plant = problem.plant();
        let (n, m) = (plant.states(), plant.inputs());
        // Before discretisation every entry is a coupling; afterwards everything reaches everything a little.
        let (a, b) = plant
            .continuous_matrices()
            .unwrap_or((plant.a(), plant.b()));
        let mut neighbours = vec![Vec::new(); n + m];
        let mut join = |i: usize, j: usize| {
            if i != j {
                neighbours[i].push(j as u32);
                neighbours[j].push(i as u32);
            }
        };
        a.entries().for_each(|(i, j, _)| join(i, j));
        b.entries().for_each(|(i, j, _)| join(i, n + j));
        let (q, r) = (problem.state_weight(), problem.input_weight());
        q.entries().for_each(|(i, j, _)| join(i, j));
        r.entries().for_each(|(i, j, _)| join(n + i, n + j));
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        Self {
            states: n,
            neighbours,
        }
    }

    /// Everything within `radius` steps of some inputs.
    fn ball(&self, inputs: &[usize], radius: usize) -> Ball {
        let mut nodes: Vec<usize> = inputs.iter().map(|i| i + self.states).collect();
        let mut inside: std::collections::HashSet<usize> = nodes.iter().copied().collect();
        let (mut before, mut last) = (0, 0);
        for _ in 0..radius {
            let end = nodes.len();
            before = last;
            for k in last..end {
                for &v in &self.neighbours[nodes[k]] {
                    if inside.insert(v as usize) {
                        nodes.push(v as usize);
                    }
                }
            }
            last = end;
        }
        let open = |&v: &usize| {
            let mut around = self.neighbours[v].iter();
            around.any(|w| !inside.contains(&(*w as usize)))
        };
        let mut rim = if nodes[last..].iter().any(open) {
            nodes[before..].to_vec()
        } else {
            Vec::new()
        };
        rim.sort_unstable();
        nodes.sort_unstable();
        Ball { nodes, rim }
    }

    /// The inputs in groups of neighbours.
    fn groups(&self) -> Vec<Vec<usize>> {
        let n = self.states;
        let mut taken = vec![false; self.neighbours.len()];
        let mut groups = Vec::new();
        for first in n..self.neighbours.len() {
            if taken[first] {
                continue;
            }
            taken[first] = true;
            let mut group = vec![first - n];
            // Breadth first from there, through states, until there are enough.
            let mut queue = std::collections::VecDeque::from([(first, 0)]);
            let mut seen = std::collections::HashSet::from([first]);
            while let Some((v, depth)) = queue.pop_front() {
                if group.len() == INPUTS_PER_WINDOW || depth > 2 * INPUTS_PER_WINDOW {
                    break;
                }
                if v >= n && !taken[v] {
                    taken[v] = true;
                    group.push(v - n);
                }
                for &w in &self.neighbours[v] {
                    if seen.insert(w as usize) {
                        queue.push_back((w as usize, depth + 1));
                    }
                }
            }
            group.sort_unstable();
            groups.push(group);
        }
        groups
    }
}
