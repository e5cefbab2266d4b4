//! Outlines of terminal sets against what they mean: the terminal law keeps the constraints for ever from there.

use crate::cases::{academic, design, weak};
use crate::oracle::{self, Rows};
use mpct::analysis::terminal_set;
use mpct::{SparseMatrix, Task, TerminalIngredients};

/// Steps of the terminal law that stand for "for ever": ρ is 0.63 and 0.4, so that 0.63^150 is below 1e-29.
const LONG: usize = 150;

/// How far inside the set a state is: the largest t such that some θ leaves every row at every step a slack of t. For
/// regulation θ = 0. Written with e_j = (A + B K)ʲ e_0 and plain products.
fn depth(design: &TerminalIngredients, x: &[f64]) -> f64 {
    let problem = design.problem();
    let rows = problem.rows();
    let plant = problem.plant();
    let steady = design.steady_states();
    let m = plant.inputs();
    let tracking = problem.task() == Task::Tracking;
    let closed = plant.a().combine(1.0, &plant.b().mul(design.gain()), 1.0);
    let along = rows.c.combine(1.0, &rows.d.mul(design.gain()), 1.0);
    let at_rest =
        rows.c
            .mul(steady.state_basis())
            .combine(1.0, &rows.d.mul(steady.input_basis()), 1.0);
    let parameters = if tracking { m } else { 0 };
    let mut at_most = Rows::default();
    let row_of = |w: &SparseMatrix, i: usize| -> Vec<f64> { (0..m).map(|t| w.get(i, t)).collect() };
    let mut power = along;
    for _ in 0..LONG {
        let basis = power.mul(steady.state_basis());
        for i in 0..rows.len() {
            let value: f64 = power.row(i).map(|(j, v)| v * x[j]).sum();
            let (rest, moved) = (row_of(&at_rest, i), row_of(&basis, i));
            let mut row: Vec<(usize, f64)> =
                (0..parameters).map(|t| (t, rest[t] - moved[t])).collect();
            row.push((parameters, 1.0));
            at_most.push(row, 1.0 - value);
        }
        power = power.mul(&closed);
    }
    if tracking {
        for i in 0..rows.len() {
            let rest = row_of(&at_rest, i);
            let row = (0..m).map(|t| (t, rest[t])).collect();
            at_most.push(row, problem.scaling());
        }
    }
    at_most.push(vec![(parameters, 1.0)], 1.0);
    let mut q = vec![0.0; parameters + 1];
    q[parameters] = -1.0;
    let (v, _) = oracle::solve(&[], &q, &Rows::default(), &at_most).expect("LP");
    v[parameters]
}

#[test]
fn the_terminal_law_stays_admissible_inside_and_not_beyond() {
    for problem in [academic(0.9), academic(0.5), weak()] {
        for task in [Task::Tracking, Task::Regulation] {
            let ingredients = design(&problem.clone().with_task(task));
            let outline = terminal_set(&ingredients, (0, 1)).expect("outline");
            assert!(
                outline.gap < 2e-6 && outline.vertices.len() >= 4,
                "{outline:?}"
            );
            let n = outline.vertices.len();
            for (k, v) in outline.vertices.iter().enumerate() {
                let next = outline.vertices[(k + 1) % n];
                let middle = [0.5 * (v[0] + next[0]), 0.5 * (v[1] + next[1])];
                for p in [*v, middle] {
                    let inside = depth(&ingredients, &p.map(|c| 0.999 * c));
                    let beyond = depth(&ingredients, &p.map(|c| 1.001 * c));
                    assert!(inside > 0.0 && beyond < 0.0, "{p:?}: {inside} {beyond}");
                }
            }
        }
    }
}

#[test]
fn coordinates_that_are_equal_or_out_of_range_are_refused() {
    let ingredients = design(&academic(0.9));
    for pair in [(0, 0), (1, 2), (9, 0)] {
        let e = terminal_set(&ingredients, pair).expect_err("coordinates");
        assert!(
            e.to_string()
                .contains(&format!("{} and {}", pair.0, pair.1)),
            "{e}"
        );
    }
}
