//! Set-points and scalings, and the figures of a run, against direct computation.

use crate::cases::{academic, design, drone};
use mpct::analysis::{Performance, compare, scaling_advice, scaling_need};
use mpct::{
    Constraints, Controller, DesignOptions, Matrix, Plant, Problem, ScheduledSetPoint, SetPoint,
    Simulation, Task, Weights, simulate,
};

fn admits(problem: &Problem, scaling: f64, set_point: &SetPoint) -> bool {
    let problem = problem.clone().with_scaling(scaling).expect("scaling");
    let ingredients = design(&problem);
    ingredients
        .steady_states()
        .closest_admissible(&problem, set_point)
        .expect("closest")
        .admissible
}

#[test]
fn the_needed_scaling_is_the_smallest_that_admits() {
    for (problem, state) in [
        (academic(0.5), vec![2.0, 0.5]),
        (academic(0.5), vec![-1.3, 0.9]),
        (academic(0.9), vec![-0.5688, -0.0523]),
        (drone(), {
            let mut x = vec![0.0; 12];
            (x[0], x[1], x[2], x[8]) = (2.1, -1.0, 2.9, 0.3);
            x
        }),
    ] {
        let set_point = SetPoint::state(state);
        let need = scaling_need(&problem, &set_point).expect("need");
        assert!(
            need.equilibrium && need.is_attainable() && !need.limiting.is_empty(),
            "{need:?}"
        );
        assert!(
            admits(&problem, need.needed * (1.0 + 1e-5), &set_point),
            "{need:?}"
        );
        assert!(
            !admits(&problem, need.needed * (1.0 - 1e-3), &set_point),
            "{need:?}"
        );
        assert!((need.grow_by - (need.needed - problem.scaling()).max(0.0)).abs() < 1e-12);
    }
}

#[test]
fn among_inputs_that_hold_one_state_the_least_demanding_counts() {
    // Two inputs act on one state: x⁺ = 0.5 x + u_1 + u_2, |u| ≤ 1, |x| ≤ 10. x = 3 needs u_1 + u_2 = 1.5: 0.75 each.
    let plant = Plant::discrete(
        Matrix::from_rows(&[[0.5]]),
        Matrix::from_rows(&[[1.0, 1.0]]),
    )
    .expect("plant");
    let constraints = Constraints::new(1, 2)
        .state_bounds(&[-10.0], &[10.0])
        .and_then(|c| c.input_bounds(&[-1.0; 2], &[1.0; 2]))
        .expect("constraints");
    let problem = Problem::new(plant, constraints, Weights::new(1.0, 1.0, 100.0)).expect("problem");
    let need = scaling_need(&problem, &SetPoint::state([3.0])).expect("need");
    assert!((need.needed - 0.75).abs() < 1e-7, "{need:?}");
    // A stated input binds when O_input weighs it: u = (1, 0.5) needs λ = 1.
    let stated = SetPoint {
        state: vec![3.0],
        input: Some(vec![1.0, 0.5]),
    };
    let need = scaling_need(&problem, &stated).expect("need");
    assert!((need.needed - 0.75).abs() < 1e-7, "{need:?}");
    let weights = Weights::new(1.0, 1.0, 100.0).with_offset_input(3.0);
    let (plant, constraints) = (problem.plant().clone(), problem.constraints().clone());
    let weighted = Problem::new(plant, constraints, weights).expect("problem");
    let need = scaling_need(&weighted, &stated).expect("need");
    assert!(
        (need.needed - 1.0).abs() < 1e-9 && need.equilibrium,
        "{need:?}"
    );
    assert!(!need.is_attainable());
}

#[test]
fn advice_lowers_the_horizon_and_leaves_out_what_no_scaling_admits() {
    let problem = academic(0.99);
    let list = [SetPoint::state([1.5, 0.2]), SetPoint::state([5.0, 0.0])];
    let advice = scaling_advice(&problem, &list, &DesignOptions::default()).expect("advice");
    assert!(advice.needs[0].is_attainable() && !advice.needs[1].is_attainable());
    assert!((advice.advised - advice.needs[0].needed).abs() < 1e-5);
    assert_eq!(advice.terminal_horizon, 10);
    assert!(advice.advised_horizon <= 4, "{advice:?}");
    assert!(admits(&problem, advice.advised, &list[0]));
    let e = scaling_advice(&problem, &[], &DesignOptions::default()).expect_err("no set-point");
    assert!(e.to_string().contains("at least one"));
    assert!(scaling_need(&problem, &SetPoint::state([1.0])).is_err());
    assert!(scaling_need(&problem, &SetPoint::state([f64::NAN, 0.0])).is_err());
    assert!(scaling_need(&academic(0.9).with_task(Task::Regulation), &list[0]).is_err());
    // The drone with a velocity is no equilibrium.
    let mut moving = vec![0.0; 12];
    moving[3] = 1.0;
    let need = scaling_need(&drone(), &SetPoint::state(moving)).expect("need");
    assert!(!need.equilibrium && !need.is_attainable());
}

#[test]
fn figures_of_a_run_are_what_its_steps_say() {
    let problem = academic(0.9);
    let simulation = |steps| Simulation {
        initial_state: vec![-2.0, 0.5],
        steps,
        set_points: vec![
            ScheduledSetPoint {
                from_step: 0,
                set_point: SetPoint::state([2.0, 0.5]),
            },
            ScheduledSetPoint {
                from_step: 40,
                set_point: SetPoint::state([-2.0, -0.5]),
            },
        ],
        disturbance: None,
    };
    let mut controller = Controller::new(design(&problem)).expect("controller");
    let run = simulate(&mut controller, &simulation(80), None).expect("run");
    let performance = Performance::of(&run, &problem).expect("performance");
    assert_eq!(performance.settling.len(), 2);
    for (k, settling) in performance.settling.iter().enumerate() {
        let steps = settling.steps.expect("settles");
        let stretch = &run.steps[40 * k..40 * (k + 1)];
        let home = &stretch[39].artificial_state;
        let far = |s: &mpct::RunStep| (s.x[0] - home[0]).hypot(s.x[1] - home[1]);
        let limit = 0.02 * stretch.iter().map(far).fold(0.0, f64::max);
        assert!(steps > 0 && stretch[steps..].iter().all(|s| far(s) <= limit));
        assert!(far(&stretch[steps - 1]) > limit);
    }
    let lowest = run
        .steps
        .iter()
        .map(|s| 3.0 - s.x[0])
        .fold(f64::INFINITY, f64::min);
    let margin = performance
        .margins
        .iter()
        .find(|m| m.row.to_string() == "state_upper[0]")
        .expect("row");
    assert!((margin.margin - lowest).abs() < 1e-12);
    let energy: f64 = run.steps.iter().map(|s| s.u[0].powi(2)).sum();
    assert!((performance.input_energy[0] - energy).abs() < 1e-9 * energy);
    let offset: f64 = run.steps.iter().map(|s| s.offset_cost).sum();
    assert!((performance.cumulative_offset_cost - offset).abs() <= 1e-9 * offset);
    // Side by side with a smaller λ: dearer, as Table 1 says.
    let tight = academic(0.49);
    let mut controller = Controller::new(design(&tight)).expect("controller");
    let other = simulate(&mut controller, &simulation(80), None).expect("run");
    let other = Performance::of(&other, &tight).expect("performance");
    let figures = compare(&performance, &other);
    let cost = figures
        .iter()
        .find(|f| f.what == "cumulative cost")
        .expect("figure");
    assert!(cost.ratio().expect("ratio") > 1.0);
    assert!(figures.iter().any(|f| f.what.contains("settle")));
    // A run of another plant is refused.
    assert!(Performance::of(&run, &drone()).is_err());
}
