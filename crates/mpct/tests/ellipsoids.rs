//! Ellipsoidal constraints: the terminal horizon, its certificate and closed loops, against polygons, samples and formulas.

mod support;

use mpct::analysis::{DomainOfAttraction, Membership, Performance, scaling_need};
use mpct::certificate::{Certificate, VerifyOptions, verify};
use mpct::*;
use std::f64::consts::{PI, TAU};
use support::every;
use support::random::{self, Random};

fn academic() -> Plant {
    Plant::discrete(
        Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
        Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
    )
    .expect("plant")
}

/// The academic plant with other constraints.
fn problem(constraints: Constraints, scaling: f64) -> Problem {
    Problem::new(academic(), constraints, Weights::new(10.0, 100.0, 1e4))
        .expect("problem")
        .with_scaling(scaling)
        .expect("scaling")
}

/// ‖x‖ ≤ 3 and ‖u‖ ≤ 2.
fn discs() -> Constraints {
    Constraints::new(2, 2)
        .state_ellipsoid(1.0 / 9.0)
        .and_then(|c| c.input_ellipsoid(0.25))
        .expect("discs")
}

fn boxes() -> Constraints {
    Constraints::new(2, 2)
        .state_bounds(&[-3.0; 2], &[3.0; 2])
        .and_then(|c| c.input_bounds(&[-2.0; 2], &[2.0; 2]))
        .expect("bounds")
}

/// Regular polygons in place of the discs: around them or within.
fn polygons(sides: usize, around: bool) -> Constraints {
    let part = |radius: f64| {
        let rows: Vec<Vec<f64>> = (0..sides)
            .map(|i| TAU * i as f64 / sides as f64)
            .map(|a| vec![a.cos(), a.sin()])
            .collect();
        let bound = if around {
            radius
        } else {
            radius * (PI / sides as f64).cos()
        };
        (random::matrix(&rows), vec![bound; sides])
    };
    let ((c, x), (d, u)) = (part(3.0), part(2.0));
    let zero = || Matrix::zeros(sides, 2);
    Constraints::new(2, 2)
        .mixed(c, zero(), x)
        .and_then(|with_x| with_x.mixed(zero(), d, u))
        .expect("polygons")
}

fn design(problem: &Problem) -> TerminalIngredients {
    TerminalIngredients::design(problem, &DesignOptions::default())
        .unwrap_or_else(|e| panic!("{}: {e}", problem.name()))
}

/// The random problem of a seed with one to three ellipsoids that cut off a part of its polytope.
fn with_ellipsoids(seed: u64) -> Problem {
    let base = random::problem(seed);
    let (n, m) = (base.plant().states(), base.plant().inputs());
    let mut random = Random::new(seed + 1000);
    let mut form = |n: usize, radius: f64| -> Matrix {
        let v = random.matrix(n, n, 1.0);
        let mut e = support::linear::mul(&v, &support::linear::transpose(&v));
        for (i, row) in e.iter_mut().enumerate() {
            row[i] += 0.2;
            row.iter_mut()
                .for_each(|v| *v /= radius * radius * n as f64);
        }
        random::matrix(&e)
    };
    let mut constraints = base
        .constraints()
        .clone()
        .state_ellipsoid_around(form(n, 2.0), vec![0.2; n])
        .expect("state ellipsoid");
    if seed.is_multiple_of(2) {
        constraints = constraints
            .input_ellipsoid(form(m, 1.0))
            .expect("input ellipsoid");
    }
    if seed.is_multiple_of(3) {
        let (c, d) = (random.matrix(2, n, 0.3), random.matrix(2, m, 0.3));
        constraints = constraints
            .norm_bound(random::matrix(&c), random::matrix(&d))
            .expect("norm bound");
    }
    let weights = Weights::new(
        base.state_weight().clone(),
        base.input_weight().clone(),
        base.offset_weight().clone(),
    );
    Problem::new(base.plant().clone(), constraints, weights)
        .expect("problem")
        .with_name(format!("ellipsoids {seed}"))
        .with_scaling(base.scaling())
        .expect("scaling")
        .with_prediction_horizon(base.prediction_horizon())
        .expect("horizon")
}

/// Largest value of a constraint (1 is its bound), from the problem's matrices.
fn value(problem: &Problem, x: &[f64], u: &[f64]) -> f64 {
    let rows = problem.rows();
    let sum =
        |a: Vec<f64>, b: Vec<f64>| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + b).collect() };
    let of_rows = sum(rows.c.mul_vec(x), rows.d.mul_vec(u));
    let of_norms = problem.norms().iter().map(|b| {
        let v = sum(sum(b.f.mul_vec(x), b.g.mul_vec(u)), b.offset.clone());
        v.iter().map(|v| v * v).sum::<f64>().sqrt()
    });
    of_rows
        .into_iter()
        .chain(of_norms)
        .fold(f64::NEG_INFINITY, f64::max)
}

/// The terminal law from (x, θ): the values of the constraints along `steps` steps.
fn along_the_law(design: &TerminalIngredients, x: &[f64], theta: &[f64], steps: usize) -> Vec<f64> {
    let problem = design.problem();
    let steady = design.steady_states();
    let (xs, us) = (
        steady.state_basis().mul_vec(theta),
        steady.input_basis().mul_vec(theta),
    );
    let mut x = x.to_vec();
    (0..steps)
        .map(|_| {
            let e: Vec<f64> = x.iter().zip(&xs).map(|(x, s)| x - s).collect();
            let ke = design.gain().mul_vec(&e);
            let u: Vec<f64> = us.iter().zip(ke).map(|(u, k)| u + k).collect();
            let at = value(problem, &x, &u);
            let (ax, bu) = (
                problem.plant().a().mul_vec(&x),
                problem.plant().b().mul_vec(&u),
            );
            x = ax.iter().zip(bu).map(|(a, b)| a + b).collect();
            at
        })
        .collect()
}

/// Whether θ ∈ λΘ, up to rounding: the equilibrium of θ/λ is admissible.
fn in_scaled_equilibria(design: &TerminalIngredients, theta: &[f64]) -> bool {
    let steady = design.steady_states();
    let larger: Vec<f64> = theta
        .iter()
        .map(|t| t / design.problem().scaling())
        .collect();
    let (xs, us) = (
        steady.state_basis().mul_vec(&larger),
        steady.input_basis().mul_vec(&larger),
    );
    value(design.problem(), &xs, &us) <= 1.0
}

/// Points on the boundary of the set of steps 0, …, M̃ stay admissible for 300 steps. Points are drawn on random rays, by
/// bisection on "admissible for M̃ + 1 steps with θ ∈ λΘ", which needs no solver.
fn stays_admissible(design: &TerminalIngredients, samples: usize, seed: u64) {
    let plant = design.problem().plant();
    let (n, m) = (plant.states(), plant.inputs());
    let horizon = design.terminal_horizon();
    let mut random = Random::new(seed);
    let inside = |x: &[f64], theta: &[f64]| {
        let values = along_the_law(design, x, theta, horizon + 1);
        in_scaled_equilibria(design, theta) && values.iter().all(|v| *v <= 1.0)
    };
    for _ in 0..samples {
        // Rays with equilibria near the edge are the ones that matter; the basis is scaled so that |θ_j| ≤ 1.
        let size = if random.chance(0.5) { 1.0 } else { 0.1 };
        let theta = random.vector(m, size);
        let x = random.vector(n, 3.0);
        let at = |t: f64| -> (Vec<f64>, Vec<f64>) {
            let scaled = |v: &[f64]| v.iter().map(|v| t * v).collect();
            (scaled(&x), scaled(&theta))
        };
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        while inside(&at(high).0, &at(high).1) {
            high *= 2.0;
            assert!(high < 1e6, "{} is unbounded", design.problem().name());
        }
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            let (x, theta) = at(middle);
            if inside(&x, &theta) {
                low = middle
            } else {
                high = middle
            }
        }
        let (x, theta) = at(low);
        let worst = along_the_law(design, &x, &theta, 300)
            .into_iter()
            .fold(0.0, f64::max);
        assert!(
            worst <= 1.0 + 2e-9,
            "{}: M̃ = {horizon}, a constraint reaches {worst:.9} from {x:?}, {theta:?}",
            design.problem().name()
        );
    }
}

#[test]
fn discs_have_the_horizon_of_polygons_with_many_sides() {
    for (scaling, horizon) in [(0.99, 10), (0.9, 5), (0.7, 3), (0.5, 3)] {
        let with_discs = design(&problem(discs(), scaling));
        assert_eq!(with_discs.terminal_horizon(), horizon, "at {scaling}");
        assert!(with_discs.is_minimal());
        for around in [true, false] {
            let with_polygons = design(&problem(polygons(128, around), scaling));
            assert_eq!(with_polygons.terminal_horizon(), horizon, "at {scaling}");
        }
        stays_admissible(&with_discs, 300, 7);
    }
}

#[test]
fn an_ellipsoid_that_never_matters_changes_nothing() {
    for scaling in [0.99, 0.9, 0.5] {
        let alone = design(&problem(boxes(), scaling));
        let with = design(&problem(
            boxes().state_ellipsoid(1e-4).expect("large"),
            scaling,
        ));
        assert_eq!(with.terminal_horizon(), alone.terminal_horizon());
        let steps = with.spent_steps();
        assert_eq!(steps[..8], alone.spent_steps()[..]);
        assert_eq!(steps[8], (RowSource::Ellipsoid(0), 1));
        assert!(with.is_minimal());
    }
    // And as many as it takes for the drone, whose programs are larger.
    let drone = mpct::cases::drone().problem;
    let constraints = drone
        .constraints()
        .clone()
        .state_ellipsoid(1e-6)
        .expect("large");
    let weights = Weights::new(
        drone.state_weight().clone(),
        drone.input_weight().clone(),
        drone.offset_weight().clone(),
    );
    let with = Problem::new(drone.plant().clone(), constraints, weights)
        .and_then(|p| p.with_scaling(0.39))
        .expect("drone");
    assert_eq!(design(&with).terminal_horizon(), 25);
}

#[test]
fn regulation_and_the_sufficient_form_are_sound_too() {
    let regulation = design(&problem(discs(), 0.9).with_task(Task::Regulation));
    assert!(regulation.terminal_horizon() <= 3);
    let options = DesignOptions {
        condition: Condition::Sufficient,
        ..DesignOptions::default()
    };
    let sufficient = TerminalIngredients::design(&problem(discs(), 0.9), &options).expect("design");
    assert!(sufficient.terminal_horizon() >= 5);
    stays_admissible(&sufficient, 100, 3);
    for ingredients in [regulation, sufficient] {
        let text = Certificate::of(&ingredients)
            .expect("certificate")
            .to_json();
        let verified = verify(&text, VerifyOptions::default()).expect("verified");
        assert_eq!(verified.terminal_horizon, ingredients.terminal_horizon());
        assert_eq!(verified.ellipsoids, 2);
    }
}

#[test]
fn random_plants_have_sound_horizons_with_certificates() {
    horizons_are_sound(4..10);
}

#[test]
#[ignore = "slow: designs with ellipsoids in up to eight dimensions"]
fn more_random_plants_have_sound_horizons_with_certificates() {
    horizons_are_sound((0..4).chain(10..40));
}

fn horizons_are_sound(seeds: impl Iterator<Item = u64>) {
    every(seeds, |seed| {
        let ingredients = design(&with_ellipsoids(seed));
        let norms = ingredients.problem().norms().iter();
        if norms.map(NormConstraint::dimension).max() <= Some(3) {
            assert!(ingredients.is_minimal(), "seed {seed}");
        }
        stays_admissible(&ingredients, 60, seed);
        let text = Certificate::of(&ingredients)
            .expect("certificate")
            .to_json();
        let verified =
            verify(&text, VerifyOptions::default()).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        assert_eq!(verified.terminal_horizon, ingredients.terminal_horizon());
        assert_eq!(verified.rows_to_tolerance, 0, "seed {seed}");
    });
}

#[test]
fn random_closed_loops_are_feasible_fall_and_converge() {
    closed_loops(7..13);
}

#[test]
#[ignore = "slow: closed loops of 150 steps with ellipsoids in up to eight dimensions"]
fn more_random_closed_loops_are_feasible_fall_and_converge() {
    closed_loops((0..7).chain(13..40));
}

/// Closed loops over random plants: feasible at every step, the cost falls by the stage cost, constraints are kept, the
/// cost converges to the offset cost of the closest admissible equilibrium.
fn closed_loops(seeds: impl Iterator<Item = u64>) {
    every(seeds, |seed| {
        let problem = with_ellipsoids(seed);
        let (n, m) = (problem.plant().states(), problem.plant().inputs());
        let mut controller = Controller::new(design(&problem)).expect("controller");
        let steady = controller.ingredients().steady_states().clone();
        let mut random = Random::new(seed + 77);
        // Every other set-point is far out, the others are equilibria well inside.
        let far = seed % 2 == 1;
        let theta = random.vector(m, 0.1 / m as f64);
        let state = if far {
            random.vector(n, 8.0)
        } else {
            steady.state_basis().mul_vec(&theta)
        };
        let mut set_point = SetPoint::state(state);
        set_point.input = (!far).then(|| steady.input_basis().mul_vec(&theta));
        // The start: as far out as the domain of attraction reaches on a ray, less a little.
        let direction = random.vector(n, 1.0);
        let domain = DomainOfAttraction::of(&controller);
        let reach = domain
            .reach(&direction)
            .unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        assert!(
            reach.at_most - reach.distance <= 1e-5 * reach.distance,
            "seed {seed}: {reach:?}"
        );
        let mut x: Vec<f64> = reach.state.iter().map(|v| 0.99 * v).collect();
        let mut last: Option<(f64, f64)> = None;
        let closest = steady
            .closest_admissible(&problem, &set_point)
            .expect("closest");
        for k in 0..150 {
            let step = controller
                .step(&x, &set_point)
                .unwrap_or_else(|e| panic!("seed {seed} step {k}: {e}"));
            assert_eq!(step.status, StepStatus::Optimal, "seed {seed} step {k}");
            assert!(
                value(&problem, &x, &step.input) <= 1.0 + 1e-7,
                "seed {seed} step {k}"
            );
            let stage = weighted(problem.state_weight(), &x, &step.artificial_state)
                + weighted(problem.input_weight(), &step.input, &step.artificial_input);
            if let Some((cost, stage)) = last {
                let slack = 1e-6 * (1.0 + cost);
                assert!(
                    step.cost <= cost - stage + slack,
                    "seed {seed} step {k}: {} after {cost}",
                    step.cost
                );
            }
            last = Some((step.cost, stage));
            let (ax, bu) = (
                problem.plant().a().mul_vec(&x),
                problem.plant().b().mul_vec(&step.input),
            );
            x = ax.iter().zip(bu).map(|(a, b)| a + b).collect();
        }
        // Where several equilibria have nearly the same offset cost, the cost tells and not the state.
        let (cost, _) = last.expect("steps");
        let gap = cost - closest.offset_cost;
        assert!(
            gap <= 1e-3 * (1.0 + closest.offset_cost),
            "seed {seed}: cost {cost}, closest {}",
            closest.offset_cost
        );
    });
}

fn weighted(w: &SparseMatrix, a: &[f64], b: &[f64]) -> f64 {
    let d: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    w.mul_vec(&d).iter().zip(&d).map(|(a, b)| a * b).sum()
}

#[test]
fn discs_and_polygons_give_the_same_inputs() {
    let mut of_discs = Controller::new(design(&problem(discs(), 0.9))).expect("controller");
    let mut of_polygons: Vec<Controller> = [true, false]
        .map(|around| {
            Controller::new(design(&problem(polygons(256, around), 0.9))).expect("controller")
        })
        .into();
    for (x, r) in [
        ([-2.0, 2.0], [2.0, 0.5]),
        ([0.5, -1.0], [-5.0, 0.1]),
        ([2.8, -0.9], [0.0, 0.0]),
    ] {
        let set_point = SetPoint::state(r);
        let step = of_discs.step(&x, &set_point).expect("discs");
        // The optimal cost lies between those of the larger and of the smaller polygons.
        let costs: Vec<f64> = of_polygons
            .iter_mut()
            .map(|c| c.step(&x, &set_point).expect("polygons"))
            .map(|s| {
                // An edge is 0.07 long; along it the offset cost is nearly flat.
                for (a, b) in s.input.iter().zip(&step.input) {
                    assert!((a - b).abs() < 3e-2, "{a} {b}");
                }
                s.cost
            })
            .collect();
        assert!(costs[0] <= step.cost * (1.0 + 1e-7) && step.cost <= costs[1] * (1.0 + 1e-7));
    }
}

#[test]
fn domains_lie_between_those_of_polygons() {
    let of = |c: Constraints| Controller::new(design(&problem(c, 0.9))).expect("controller");
    let (with_discs, larger, smaller) = (
        of(discs()),
        of(polygons(128, true)),
        of(polygons(128, false)),
    );
    let [discs, larger, smaller] = [&with_discs, &larger, &smaller].map(DomainOfAttraction::of);
    for k in 0..12 {
        let angle = TAU * k as f64 / 12.0;
        let d = [angle.cos(), angle.sin()];
        let reach = discs.reach(&d).expect("reach");
        let bounds = [&smaller, &larger].map(|domain| domain.reach(&d).expect("reach"));
        assert!(
            bounds[0].distance - 1e-6 <= reach.distance
                && reach.at_most <= bounds[1].at_most + 1e-6
        );
        let at = |t: f64| [t * reach.distance * d[0], t * reach.distance * d[1]];
        assert!(discs.contains(&at(0.999)).expect("inside").is_inside());
        match discs.contains(&at(1.01)).expect("outside") {
            Membership::Outside { gap, rows, .. } => {
                assert!(gap > 0.0 && rows.iter().all(|r| r.1 > 0.0));
            }
            inside => panic!("{inside:?}"),
        }
    }
    let polygon = discs.projection((0, 1)).expect("projection");
    assert!(
        polygon
            .vertices
            .iter()
            .all(|v| v[0].hypot(v[1]) <= 3.0 + 1e-5)
    );
}

#[test]
fn set_points_and_margins_know_ellipsoids() {
    let problem = problem(discs(), 0.9);
    // Equilibria are x = (a, b) with inputs (b, −2 b): of norm √(a² + b²) and √5 |b|.
    let steady = design(&problem).steady_states().clone();
    let closest = steady
        .closest_admissible(&problem, &SetPoint::state([5.0, 0.0]))
        .expect("closest");
    assert!(
        (closest.state[0] - 2.7).abs() < 1e-6 && closest.state[1].abs() < 1e-5,
        "{closest:?}"
    );
    assert_eq!(closest.limiting, [RowSource::Ellipsoid(0)]);
    assert!(!closest.admissible);
    let inside = steady
        .closest_admissible(&problem, &SetPoint::state([1.0, 0.5]))
        .expect("closest");
    assert!(inside.admissible, "{inside:?}");
    let need = scaling_need(&problem, &SetPoint::state([0.0, 0.85])).expect("need");
    assert!(
        (need.needed - 0.85 * 5.0_f64.sqrt() / 2.0).abs() < 1e-9,
        "{need:?}"
    );
    assert_eq!(need.limiting, [RowSource::Ellipsoid(1)]);
    // Around another center: ‖x − (1, 0)‖ ≤ 3 lets (a, 0) with a ≥ 0 reach λ 4, since λ (x − c) scales about the origin.
    let off = Constraints::new(2, 2)
        .state_ellipsoid_around(1.0 / 9.0, vec![1.0, 0.0])
        .and_then(|c| c.input_ellipsoid(0.25))
        .expect("off center");
    let need = scaling_need(&self::problem(off, 0.9), &SetPoint::state([3.2, 0.0])).expect("need");
    assert!((need.needed - 0.8).abs() < 1e-9, "{need:?}");
    let mut controller = Controller::new(design(&problem)).expect("controller");
    let simulation = Simulation {
        initial_state: vec![-2.0, 2.0],
        steps: 20,
        set_points: vec![ScheduledSetPoint {
            from_step: 0,
            set_point: SetPoint::state([5.0, 0.0]),
        }],
        disturbance: None,
    };
    let run = simulate(&mut controller, &simulation, None).expect("run");
    assert!(run.summary.worst_violation <= 1e-9);
    let performance = Performance::of(&run, &problem).expect("performance");
    assert_eq!(performance.margins.len(), 2);
    let outside = Simulation {
        initial_state: vec![-2.5, 2.5],
        ..simulation
    };
    let error = simulate(&mut controller, &outside, None)
        .expect_err("outside")
        .to_string();
    assert!(error.contains("ellipsoid[0]"), "{error}");
}

#[test]
fn what_is_not_there_for_ellipsoids_says_so() {
    let ingredients = design(&problem(discs(), 0.9));
    let text = |e: DesignError| e.to_string();
    assert!(text(ingredients.maximal_admissible_set().expect_err("set")).contains("no polytope"));
    for formulation in [Formulation::Explicit, Formulation::NoTerminalConstraint] {
        let error =
            Controller::with_formulation(ingredients.clone(), formulation).expect_err("refused");
        assert!(text(error).contains("\"implicit\" with ellipsoidal constraints"));
    }
    let error = analysis::terminal_set(&ingredients, (0, 1)).expect_err("set");
    assert!(text(error).contains("no polytope"));
    // Without a bound on the input a direction is free, and is named.
    let open = Constraints::new(2, 2)
        .state_ellipsoid(vec![1.0, 0.0])
        .expect("cylinder");
    let error = TerminalIngredients::design(&problem(open, 0.9), &DesignOptions::default());
    assert!(
        matches!(error, Err(DesignError::Unbounded { .. })),
        "{error:?}"
    );
}

/// The implicit terminal cost of remark 2 rests on K, Q, R and M̃ alone: it comes for free.
#[test]
fn the_implicit_terminal_cost_works_with_ellipsoids() {
    let problem = problem(discs(), 0.9).with_terminal_cost(TerminalCost::Implicit);
    let mut controller = Controller::new(design(&problem)).expect("controller");
    let step = controller
        .step(&[-2.0, 2.0], &SetPoint::state([2.0, 0.5]))
        .expect("step");
    let exact = Controller::new(design(&self::problem(discs(), 0.9)))
        .expect("controller")
        .step(&[-2.0, 2.0], &SetPoint::state([2.0, 0.5]))
        .expect("step");
    assert!(step.cost >= exact.cost && step.status == StepStatus::Optimal);
}

#[test]
fn a_step_cut_short_falls_back_on_the_shifted_candidate() {
    let mut controller = Controller::new(design(&problem(discs(), 0.9))).expect("controller");
    let set_point = SetPoint::state([2.0, 0.5]);
    let mut x = vec![-2.0, 2.0];
    let first = controller.step(&x, &set_point).expect("first step");
    x = first.predicted_states[1].clone();
    controller.set_limits(Some(1), None);
    let second = controller.step(&x, &set_point).expect("candidate");
    assert_eq!(
        second.status,
        StepStatus::Candidate(CandidateReason::IterationLimit)
    );
    assert!(second.violation <= 1e-9 && second.cost < first.cost);
    // Where the candidate does not fit, the step says so, and the input is in U all the same.
    let elsewhere = controller.step(&[2.5, 1.5], &set_point).expect("elsewhere");
    assert!(elsewhere.violation > 0.1, "{}", elsewhere.violation);
    let size = |u: &[f64]| u[0].hypot(u[1]);
    assert!(
        size(&elsewhere.input) <= 2.0 + 1e-12,
        "{:?}",
        elsewhere.input
    );
    controller.set_limits(None, Some(std::time::Duration::ZERO));
    let late = controller.step(&[1.0, 0.0], &set_point).expect("late");
    assert_eq!(
        late.status,
        StepStatus::Candidate(CandidateReason::Deadline)
    );
    // Without a step before there is nothing to fall back on.
    controller.reset();
    let error = controller.step(&[1.0, 0.0], &set_point).expect_err("new");
    assert!(matches!(error, StepError::IterationLimit { .. }), "{error}");
    controller.set_limits(None, None);
    let error = controller
        .step(&[2.9, 2.9], &set_point)
        .expect_err("outside");
    assert!(
        matches!(error, StepError::Infeasible { gap, .. } if gap > 0.0),
        "{error}"
    );
}

#[test]
fn problem_files_keep_ellipsoids() {
    let text = r#"
        [plant]
        A = [[1.0, 1.0], [0.0, 1.0]]
        B = [[0.0, 0.5], [1.0, 0.5]]
        operating_point = { state = [0.5, 0.0], input = [0.0, 0.0] }
        [constraints]
        [[constraints.ellipsoid]]
        state = [[0.2, 0.1], [0.1, 0.3]]
        center = [0.4, 0.1]
        [[constraints.ellipsoid]]
        input = 0.25
        [[constraints.ellipsoid]]
        C = [[0.1, 0.0]]
        D = [[0.0, 0.1]]
        [weights]
        Q = 1.0
        R = 1.0
        O = 1.0
    "#;
    let folder = std::path::Path::new(".");
    let file = ProblemFile::parse(text, folder).expect("file");
    assert_eq!(file.problem.norms().len(), 3);
    assert_eq!(
        ProblemFile::parse(&file.to_toml(), folder).expect("again"),
        file
    );
    for (from, to, part) in [
        (
            "input = 0.25",
            "input = -0.25",
            "smallest eigenvalue is -2.5",
        ),
        ("input = 0.25", "input = 0.0", "not zero"),
        (
            "input = 0.25",
            "inputs = 0.25",
            "constraints.ellipsoid[1].input",
        ),
        ("input = 0.25", "input = 0.25\nstate = 1.0", "more than one"),
        (
            "input = 0.25",
            "center = [0.0, 0.0]",
            "constraints.ellipsoid[1].state",
        ),
        (
            "center = [0.4, 0.1]",
            "center = [0.4]",
            "constraints.ellipsoid[0].center",
        ),
        (
            "center = [0.4, 0.1]",
            "center = [4.0, 0.1]",
            "ellipsoid[0] leaves it",
        ),
        (
            "D = [[0.0, 0.1]]",
            "D = [[0.1]]",
            "constraints.ellipsoid[2].D",
        ),
        (
            "D = [[0.0, 0.1]]",
            "center = [0.0, 0.1]",
            "center beside state or input",
        ),
    ] {
        assert!(text.contains(from));
        let error = ProblemFile::parse(&text.replace(from, to), folder)
            .expect_err(to)
            .to_string();
        assert!(error.contains(part), "{to}: {error}");
    }
}
