//! Remark 2 and regulation.

use crate::cases::{academic, design, drone};
use crate::oracle::{self, Terminal};
use mpct::{
    Controller, Formulation, ImplicitTerminalCost, SetPoint, SparseMatrix, Task, TerminalCost,
};

fn square(w: &SparseMatrix, e: &[f64]) -> f64 {
    w.mul_vec(e).iter().zip(e).map(|(a, b)| a * b).sum()
}

/// Pseudo-random directions without a generator: a lattice of irrational steps.
fn directions(n: usize, count: usize) -> Vec<Vec<f64>> {
    (1..=count)
        .map(|k| {
            (1..=n)
                .map(|i| ((k * i) as f64 * 0.754_877 + i as f64 * 0.569_84).fract() - 0.5)
                .collect()
        })
        .collect()
}

#[test]
fn the_implicit_cost_falls_along_the_law_and_bounds_the_cost_to_go() {
    for problem in [academic(0.9), academic(0.39), drone()] {
        let ingredients = design(&problem);
        let cost = ImplicitTerminalCost::of(&ingredients).expect("cost");
        assert!((0.0..1.0).contains(&cost.epsilon()));
        let weight = cost.weight();
        let n = problem.plant().states();
        let mut tightest = f64::INFINITY;
        for e in directions(n, 400) {
            let du = ingredients.gain().mul_vec(&e);
            let stage = square(problem.state_weight(), &e) + square(problem.input_weight(), &du);
            let ax = problem.plant().a().mul_vec(&e);
            let bu = problem.plant().b().mul_vec(&du);
            let next: Vec<f64> = ax.iter().zip(&bu).map(|(a, b)| a + b).collect();
            let here = square(&weight, &e);
            assert!(
                here - square(&weight, &next) >= stage - 1e-9 * here,
                "decrease"
            );
            assert!(
                here >= square(ingredients.terminal_weight(), &e) * (1.0 - 1e-9),
                "upper bound"
            );
            // The definition: (1 − ε)⁻¹ times the first M̃ stages.
            let (mut sum, mut at) = (0.0, e.clone());
            for _ in 0..ingredients.terminal_horizon() {
                let du = ingredients.gain().mul_vec(&at);
                sum += square(problem.state_weight(), &at) + square(problem.input_weight(), &du);
                let ax = problem.plant().a().mul_vec(&at);
                let bu = problem.plant().b().mul_vec(&du);
                at = ax.iter().zip(&bu).map(|(a, b)| a + b).collect();
            }
            assert!((sum / (1.0 - cost.epsilon()) - here).abs() < 1e-8 * here);
            tightest = tightest.min(
                1.0 - (square(problem.state_weight(), &at)
                    + square(problem.input_weight(), &ingredients.gain().mul_vec(&at)))
                    / stage,
            );
        }
        // No sampled direction contracts less than ε says; in the plane one comes close to it.
        assert!(1.0 - tightest <= cost.epsilon() * (1.0 + 1e-9));
        if n == 2 {
            assert!(
                1.0 - tightest > 0.9 * cost.epsilon(),
                "{} {}",
                1.0 - tightest,
                cost.epsilon()
            );
        }
    }
}

#[test]
fn the_controller_with_the_implicit_cost_costs_more_and_converges() {
    let set_point = SetPoint::state([1.0, 0.25]);
    let exact = academic(0.9);
    let implicit = academic(0.9).with_terminal_cost(TerminalCost::Implicit);
    let ingredients = design(&implicit);
    let weight = ImplicitTerminalCost::of(&ingredients)
        .expect("cost")
        .weight();
    let mut a = Controller::new(design(&exact)).expect("controller");
    let mut b = Controller::new(ingredients).expect("controller");
    let (x, y) = (vec![-2.5, 1.0], vec![-2.5, 1.0]);
    let (one, two) = (
        a.step(&x, &set_point).expect("step"),
        b.step(&y, &set_point).expect("step"),
    );
    assert!(two.cost >= one.cost * (1.0 - 1e-9));
    // The reported cost is the sum of its parts.
    let minus =
        |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
    let mut sum = two.offset_cost
        + square(
            &weight,
            &minus(&two.predicted_states[10], &two.artificial_state),
        );
    for j in 0..10 {
        sum += square(
            implicit.state_weight(),
            &minus(&two.predicted_states[j], &two.artificial_state),
        ) + square(
            implicit.input_weight(),
            &minus(&two.predicted_inputs[j], &two.artificial_input),
        );
    }
    assert!((sum - two.cost).abs() < 1e-8 * sum);
    let mut x = x;
    let mut before = f64::INFINITY;
    for _ in 0..60 {
        let step = b.step(&x, &set_point).expect("step");
        assert!(step.cost <= before * (1.0 + 1e-9) + 1e-9);
        before = step.cost;
        let ax = implicit.plant().a().mul_vec(&x);
        let bu = implicit.plant().b().mul_vec(&step.input);
        x = ax.iter().zip(&bu).map(|(a, b)| a + b).collect();
    }
    assert!((x[0] - 1.0).hypot(x[1] - 0.25) < 1e-5, "{x:?}");
}

#[test]
fn regulation_is_the_same_implicit_and_explicit_and_by_the_oracle() {
    let home = SetPoint::state([0.0, 0.0]);
    let ingredients = design(&academic(0.9).with_task(Task::Regulation));
    let of = |f| Controller::with_formulation(ingredients.clone(), f).expect("controller");
    let (mut implicit, mut explicit) = (of(Formulation::Implicit), of(Formulation::Explicit));
    let terminal = Terminal::Implicit {
        steps: ingredients.terminal_horizon(),
    };
    let mut feasible = 0;
    for e in directions(2, 60) {
        let x = [6.0 * e[0], 6.0 * e[1]];
        let depth = oracle::depth(&ingredients, terminal, &x).depth;
        if depth.abs() < 1e-6 || x.iter().any(|v| v.abs() > 3.0) {
            continue;
        }
        implicit.reset();
        explicit.reset();
        let (a, b) = (implicit.step(&x, &home), explicit.step(&x, &home));
        if depth < 0.0 {
            assert!(a.is_err() && b.is_err(), "{x:?}");
            continue;
        }
        feasible += 1;
        let (a, b) = (a.expect("implicit"), b.expect("explicit"));
        let (cost, _) =
            oracle::optimal_cost(&ingredients, terminal, &x, &[0.0, 0.0]).expect("oracle");
        assert!((a.cost - b.cost).abs() < 1e-7 * (1.0 + cost));
        assert!(
            (a.cost - cost).abs() < 1e-5 * (1.0 + cost),
            "{} {cost}",
            a.cost
        );
        for (u, v) in a.input.iter().zip(&b.input) {
            assert!((u - v).abs() < 1e-6);
        }
    }
    assert!(feasible > 10, "{feasible}");
}

#[test]
fn the_drone_is_regulated_the_same_implicitly_and_explicitly() {
    let home = SetPoint::state([0.0; 12]);
    let ingredients = design(&drone().with_task(Task::Regulation));
    let of = |f| Controller::with_formulation(ingredients.clone(), f).expect("controller");
    let (mut implicit, mut explicit) = (of(Formulation::Implicit), of(Formulation::Explicit));
    assert!(explicit.rows() < implicit.rows());
    let mut saturated = 0;
    for e in directions(12, 40) {
        let x: Vec<f64> = e
            .iter()
            .enumerate()
            .map(|(i, v)| if i < 6 { v * 0.8 } else { v * 0.1 })
            .collect();
        implicit.reset();
        explicit.reset();
        let (a, b) = (
            implicit.step(&x, &home).expect("implicit"),
            explicit.step(&x, &home).expect("explicit"),
        );
        assert!(
            (a.cost - b.cost).abs() <= 1e-8 * a.cost,
            "{} {}",
            a.cost,
            b.cost
        );
        for (u, v) in a.input.iter().zip(&b.input) {
            assert!((u - v).abs() < 1e-7, "{:?} {:?}", a.input, b.input);
        }
        saturated += usize::from(a.input[1..].iter().any(|u| u.abs() > 0.0429));
    }
    assert!(saturated > 0, "no state met a constraint");
}

#[test]
fn regulation_has_m_by_both_forms() {
    use mpct::{Condition, DesignOptions, TerminalIngredients};
    let problem = academic(0.9).with_task(Task::Regulation);
    let m = |condition| {
        let options = DesignOptions {
            condition,
            ..DesignOptions::default()
        };
        TerminalIngredients::design(&problem, &options)
            .expect("design")
            .terminal_horizon()
    };
    let (exact, sufficient) = (m(Condition::Exact), m(Condition::Sufficient));
    assert!(exact >= 1 && exact <= sufficient, "{exact} {sufficient}");
    // The oracle: the largest value of a row at step M + 1 over the rows of steps 0, …, M (or of step 0).
    let ingredients = design(&problem);
    let holds = |last: usize, steps: usize| {
        let rows = problem.rows();
        let p = rows.len();
        // Rows (C + D K)_i (A + B K)^s.
        let k = ingredients.gain();
        let closed = problem
            .plant()
            .a()
            .combine(1.0, &problem.plant().b().mul(k), 1.0);
        let mut powers = vec![rows.c.combine(1.0, &rows.d.mul(k), 1.0)];
        for s in 0..=last {
            let next = powers[s].mul(&closed);
            powers.push(next);
        }
        (0..p).all(|i| {
            let mut at_most = oracle::Rows::default();
            for power in powers.iter().take(steps + 1) {
                for r in 0..p {
                    at_most.push(power.row(r).collect(), 1.0);
                }
            }
            let mut q = vec![0.0; 2];
            for (j, v) in powers[last + 1].row(i) {
                q[j] = -v;
            }
            let (_, value) =
                oracle::solve(&[], &q, &oracle::Rows::default(), &at_most).expect("LP");
            -value <= 1.0 + 1e-7
        })
    };
    let first = |f: &dyn Fn(usize) -> bool| (1..50).find(|&m| f(m)).expect("finite");
    assert_eq!(exact, first(&|m| holds(m, m)));
    assert_eq!(sufficient, first(&|m| holds(m, 0)));
}
