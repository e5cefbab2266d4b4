//! The banded regime: equal to the dense one, which is tested against other solvers, and lawful under any budget.

use super::online::Limits;
use super::regime::Regime;
use crate::error::DesignError;
use crate::matrix::SparseMatrix;
use crate::optimization::Failure;
use crate::terminal::{DesignOptions, TerminalIngredients};
use crate::{Constraints, Plant, Problem, Weights};

/// A reproducible number in −1 … 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

fn design(problem: &Problem) -> TerminalIngredients {
    TerminalIngredients::design(problem, &DesignOptions::default()).unwrap()
}

fn banded(ingredients: &TerminalIngredients) -> Regime {
    let formulation = ingredients.problem().formulation();
    let solver = Regime::choose(ingredients, formulation).unwrap().solver;
    assert!(matches!(solver, Regime::Banded(_)));
    solver
}

/// x⁺ of the plant.
fn next(problem: &Problem, x: &[f64], u: &[f64]) -> Vec<f64> {
    let (ax, bu) = (
        problem.plant().a().mul_vec(x),
        problem.plant().b().mul_vec(u),
    );
    ax.iter().zip(&bu).map(|(a, b)| a + b).collect()
}

/// Masses on a rectangular grid, each pulled by springs to its neighbours, to the ground and by its own force; numbered by a
/// stride that scatters neighbours.
fn grid(width: usize, height: usize) -> Result<Problem, DesignError> {
    let count = width * height;
    let stride = 7;
    assert!(!count.is_multiple_of(stride));
    let name = |x: usize, y: usize| (x * height + y) * stride % count;
    let mut a = Vec::new();
    let mut b = Vec::new();
    for x in 0..width {
        for y in 0..height {
            let i = name(x, y);
            a.push((2 * i, 2 * i + 1, 1.0));
            a.push((2 * i + 1, 2 * i, -0.5));
            a.push((2 * i + 1, 2 * i + 1, -0.2));
            b.push((2 * i + 1, i, 40.0));
            let right = (x + 1 < width).then(|| name(x + 1, y));
            let up = (y + 1 < height).then(|| name(x, y + 1));
            for j in [right, up].into_iter().flatten() {
                for (p, q) in [(i, j), (j, i)] {
                    a.push((2 * p + 1, 2 * p, -0.5));
                    a.push((2 * p + 1, 2 * q, 0.5));
                    a.push((2 * p + 1, 2 * p + 1, -0.1));
                    a.push((2 * p + 1, 2 * q + 1, 0.1));
                }
            }
        }
    }
    let n = 2 * count;
    let plant = Plant::continuous(
        SparseMatrix::from_triplets(n, n, &a)?,
        SparseMatrix::from_triplets(n, count, &b)?,
        0.02,
    )?;
    let bound: Vec<f64> = (0..n).map(|k| if k % 2 == 0 { 4.0 } else { 1.0 }).collect();
    let below: Vec<f64> = bound.iter().map(|v| -v).collect();
    let constraints = Constraints::new(n, count)
        .state_bounds(&below, &bound)?
        .input_bounds(&vec![-1.0; count], &vec![1.0; count])?;
    Problem::new(plant, constraints, Weights::new(1.0, 20.0, 1e4))?.with_prediction_horizon(4)
}

/// Set-points that saturate many inputs, new every `period` steps; the largest difference of the solutions.
fn difference(problem: &Problem, steps: usize, period: usize) -> f64 {
    let ingredients = design(problem);
    let mut own = banded(&ingredients);
    let mut other = Regime::full(&ingredients, problem.formulation())
        .unwrap()
        .solver;
    assert_eq!(own.variables(), other.variables());
    assert_eq!(own.rows(), other.rows());
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let mut random = Random(7);
    let (mut x, mut r) = (vec![0.0; n], vec![0.0; n + m]);
    let mut worst = 0.0_f64;
    for k in 0..steps {
        if k % period == 0 {
            for i in 0..m {
                r[2 * i] = 3.0 * random.next();
            }
        }
        let a = own.solve(&x, &r, Limits::default()).unwrap();
        let b = other.solve(&x, &r, Limits::default()).unwrap();
        assert!(a.why.is_none() && b.why.is_none(), "step {k}");
        for (a, b) in a.z.iter().zip(&b.z).chain(a.input.iter().zip(&b.input)) {
            worst = worst.max((a - b).abs());
        }
        x = next(problem, &x, &a.input);
    }
    worst
}

#[test]
fn chains_have_the_solution_of_the_dense_regime() {
    let problem = crate::cases::carts(36).unwrap().problem;
    let worst = difference(&problem, 50, 25);
    assert!(worst < 1e-6, "{worst:e}");
}

#[test]
fn grids_have_the_solution_of_the_dense_regime() {
    let worst = difference(&grid(26, 3).unwrap(), 16, 8);
    assert!(worst < 1e-6, "{worst:e}");
}

#[test]
fn plants_without_structure_and_small_ones_stay_dense() {
    for problem in [
        crate::cases::drone().problem,
        crate::cases::carts(10).unwrap().problem,
        grid(5, 5).unwrap(),
    ] {
        let solver = Regime::choose(&design(&problem), problem.formulation())
            .unwrap()
            .solver;
        assert!(matches!(solver, Regime::Dense(_)));
    }
}

/// A plant that goes to the banded regime goes to the conic one as soon as there is an ellipsoid.
#[test]
fn ellipsoids_have_a_regime_of_their_own() {
    let count = 5;
    let ones = vec![1.0; count];
    let diagonal = |v: f64| {
        let entries: Vec<(usize, usize, f64)> = (0..count).map(|i| (i, i, v)).collect();
        SparseMatrix::from_triplets(count, count, &entries).unwrap()
    };
    let plant = Plant::discrete(diagonal(0.9), diagonal(0.5)).unwrap();
    let negative: Vec<f64> = ones.iter().map(|v| -v).collect();
    let boxes = Constraints::new(count, count)
        .state_bounds(&negative, &ones)
        .and_then(|c| c.input_bounds(&negative, &ones))
        .unwrap();
    let of = |constraints: Constraints| {
        let problem = Problem::new(plant.clone(), constraints, Weights::new(1.0, 1.0, 1e2))
            .and_then(|p| p.with_prediction_horizon(20))
            .unwrap();
        let ingredients = design(&problem);
        Regime::choose(&ingredients, problem.formulation()).unwrap()
    };
    assert!(matches!(of(boxes.clone()).solver, Regime::Banded(_)));
    let with_disc = of(boxes.input_ellipsoid(0.5).unwrap());
    assert!(matches!(with_disc.solver, Regime::Conic(_)));
    assert!(with_disc.solver.tables().is_none());
    assert_eq!(with_disc.solver.cones().len(), with_disc.cone_origin.len());
    assert_eq!(with_disc.solver.rows(), with_disc.origin.len());
}

/// Theorems 3 and 4 whatever the budget: every input keeps the constraints, and the cost falls while the set-point stays.
#[test]
fn any_budget_is_feasible_and_the_cost_falls() {
    let problem = crate::cases::carts(36).unwrap().problem;
    let ingredients = design(&problem);
    let mut solver = banded(&ingredients);
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let steady = ingredients.steady_states();
    let mut random = Random(11);
    let (mut x, mut r) = (vec![0.0; n], vec![0.0; n + m]);
    let (mut cut, mut before) = (0, f64::INFINITY);
    for k in 0..120 {
        let is_new = k % 30 == 0;
        if is_new {
            for i in 0..m {
                r[2 * i] = 3.0 * random.next();
            }
        }
        let budget = (20.0 * (1.0 + random.next())) as u32;
        let limits = Limits {
            // The first step has no candidate.
            iterations: (k > 0).then_some(budget),
            time: None,
        };
        let answer = solver.solve(&x, &r, limits).unwrap();
        cut += usize::from(answer.why.is_some());
        assert!(answer.violation <= 1e-8, "step {k}: {}", answer.violation);
        // The cost (10) of the plan, from the plant.
        let theta = &answer.z[answer.z.len() - m..];
        let (xs, us) = (
            steady.state_basis().mul_vec(theta),
            steady.input_basis().mul_vec(theta),
        );
        let minus =
            |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        let square = super::weighted_square;
        let mut cost = square(problem.offset_weight(), &minus(&xs, &r[..n]));
        let mut predicted = x.clone();
        for j in 0..problem.prediction_horizon() {
            let e = minus(&predicted, &xs);
            let mut du = ingredients.gain().mul_vec(&e);
            for (d, c) in du.iter_mut().zip(&answer.z[j * m..(j + 1) * m]) {
                *d += c;
            }
            cost += square(problem.state_weight(), &e) + square(problem.input_weight(), &du);
            let u: Vec<f64> = du.iter().zip(&us).map(|(d, u)| d + u).collect();
            if j == 0 {
                for (a, b) in u.iter().zip(&answer.input) {
                    assert!((a - b).abs() < 1e-9);
                }
            }
            predicted = next(&problem, &predicted, &u);
        }
        cost += square(ingredients.terminal_weight(), &minus(&predicted, &xs));
        assert!(
            is_new || cost <= before * (1.0 + 1e-9) + 1e-9,
            "step {k}: {cost} after {before}"
        );
        before = cost;
        x = next(&problem, &x, &answer.input);
        for (i, v) in x.iter().enumerate() {
            let bound = if i % 2 == 0 { 4.0 } else { 1.0 };
            assert!(v.abs() <= bound + 1e-8, "step {k}, state {i}: {v}");
        }
    }
    assert!(cut > 20, "only {cut} steps were cut short");
}

#[test]
fn infeasible_states_are_proved_and_do_no_lasting_harm() {
    let problem = crate::cases::carts(36).unwrap().problem;
    let ingredients = design(&problem);
    let mut solver = banded(&ingredients);
    let (n, m) = (problem.plant().states(), problem.plant().inputs());
    let r = vec![0.0; n + m];
    let first = solver.solve(&vec![0.01; n], &r, Limits::default()).unwrap();
    for far in [1.5, 10.0, 1e6] {
        let mut x = vec![0.01; n];
        // A cart beyond its velocity limit after one step, whatever the force.
        x[21] = 4.0 * far;
        match solver.solve(&x, &r, Limits::default()) {
            Err(Failure::Infeasible(proof)) => {
                assert!(proof.gap > 0.0 && proof.radius >= 1e6, "{proof:?}");
                assert!(!solver.proof().is_empty());
            }
            Err(other) => panic!("{far}: {other:?}"),
            Ok(_) => panic!("{far}: solved"),
        }
    }
    let again = solver.solve(&vec![0.01; n], &r, Limits::default()).unwrap();
    assert!(again.why.is_none());
    for (a, b) in first.input.iter().zip(&again.input) {
        assert!((a - b).abs() < 1e-8);
    }
}
