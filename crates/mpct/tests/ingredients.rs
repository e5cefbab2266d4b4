//! Discretisation, K, P, M_θ, the explicit set and the closest admissible equilibrium, each by an independent formula.

mod support;

use mpct::{DesignOptions, Problem, SetPoint, Task, TerminalIngredients};
use support::linear::{
    self, Mat, apply, combine, dense, distance, identity, largest, max_abs, mul, quadratic,
    transpose,
};
use support::random::{self, Kind, Random};
use support::reference::{Reference, SPENT, support_of};
use support::{cases, every};

fn design(problem: &Problem) -> TerminalIngredients {
    TerminalIngredients::design(problem, &DesignOptions::default())
        .unwrap_or_else(|e| panic!("{}: {e}", problem.name()))
}

/// Random plants and the three cases.
fn problems(seeds: std::ops::Range<u64>) -> Vec<Problem> {
    let mut problems: Vec<Problem> = seeds.map(random::problem).collect();
    problems.push(cases::academic(0.9));
    problems.push(cases::drone(0.9));
    problems.push(cases::carts(5, 0.9));
    problems
}

/// ∫₀ᵀ and e^{AT} by the power series of [A B; 0 0] on T/2^10, squared ten times.
fn exponential(a: &Mat, b: &Mat, time: f64) -> (Mat, Mat) {
    let (n, m) = (a.len(), b[0].len());
    let mut block = linear::zeros(n + m, n + m);
    for i in 0..n {
        for j in 0..n {
            block[i][j] = a[i][j] * time / 1024.0;
        }
        for j in 0..m {
            block[i][n + j] = b[i][j] * time / 1024.0;
        }
    }
    let mut sum = identity(n + m);
    let mut term = identity(n + m);
    for k in 1..20 {
        term = mul(&term, &block);
        for v in term.iter_mut().flatten() {
            *v /= f64::from(k);
        }
        sum = combine(1.0, &sum, 1.0, &term);
    }
    for _ in 0..10 {
        sum = mul(&sum, &sum);
    }
    let part = |from: usize, to: usize| -> Mat {
        sum[..n].iter().map(|row| row[from..to].to_vec()).collect()
    };
    (part(0, n), part(n, n + m))
}

#[test]
fn zero_order_hold_is_the_matrix_exponential() {
    let cases = [
        (cases::drone(0.9), cases::drone_matrices(), 0.04),
        (cases::carts(5, 0.9), cases::carts_matrices(5), 0.02),
    ];
    for (problem, (a, b), time) in cases {
        let (ad, bd) = exponential(&a, &b, time);
        let plant = problem.plant();
        for (ours, theirs) in [(dense(plant.a()), ad), (dense(plant.b()), bd)] {
            let difference = max_abs(&combine(1.0, &ours, -1.0, &theirs));
            assert!(difference <= 1e-12 * max_abs(&theirs), "{difference:.1e}");
        }
    }
}

#[test]
fn terminal_weight_solves_the_lyapunov_and_the_riccati_equation() {
    every(problems(0..40), |problem| {
        let ingredients = design(&problem);
        let r = Reference::new(&ingredients);
        let name = problem.name();
        let size = max_abs(&r.p);
        // (3).
        let f = r.closed_loop();
        let stage = combine(1.0, &r.q, 1.0, &mul(&transpose(&r.k), &mul(&r.r, &r.k)));
        let left = combine(1.0, &mul(&transpose(&f), &mul(&r.p, &f)), -1.0, &r.p);
        let lyapunov = max_abs(&combine(1.0, &left, 1.0, &stage)) / size;
        assert!(lyapunov <= 1e-11, "{name}: residual of (3) {lyapunov:.1e}");
        // P = Q + AᵀPA − AᵀPB (R + BᵀPB)⁻¹ BᵀPA and K = −(R + BᵀPB)⁻¹ BᵀPA.
        let pa = mul(&r.p, &r.a);
        let bpa = mul(&transpose(&r.b), &pa);
        let s = combine(1.0, &r.r, 1.0, &mul(&transpose(&r.b), &mul(&r.p, &r.b)));
        let gain = linear::solve(&s, &bpa).expect("R + BᵀPB is positive definite");
        let difference = max_abs(&combine(1.0, &r.k, 1.0, &gain)) / max_abs(&r.k).max(1e-300);
        assert!(difference <= 1e-8, "{name}: K differs by {difference:.1e}");
        let right = combine(
            1.0,
            &combine(1.0, &r.q, 1.0, &mul(&transpose(&r.a), &pa)),
            -1.0,
            &mul(&transpose(&bpa), &gain),
        );
        let riccati = max_abs(&combine(1.0, &right, -1.0, &r.p)) / size;
        assert!(riccati <= 1e-9, "{name}: Riccati residual {riccati:.1e}");
        assert!(max_abs(&combine(1.0, &r.p, -1.0, &transpose(&r.p))) <= 1e-14 * size);
        // Schur: a power of A + B K is a contraction; the stated spectral radius is about right.
        let bound = linear::spectral_radius_bound(&f, 14);
        let stated = ingredients.spectral_radius();
        assert!(bound < 1.0, "{name}: {bound}");
        assert!(
            stated <= bound * (1.0 + 1e-9) && bound <= stated + 0.01,
            "{name}: spectral radius {stated}, bounded by {bound}"
        );
    });
}

/// A gain of the user's own: P solves (3) for exactly this gain.
#[test]
fn a_gain_of_ones_own_gets_its_own_weight() {
    every(0..20, |seed| {
        let problem = random::problem(seed);
        let lqr = Reference::new(&design(&problem));
        let mut random = Random::new(1000 + seed);
        // Shorter steps towards the LQR gain of a plant stay stabilizing when they are small enough.
        let mut size = 0.2;
        let gain = loop {
            let gain: Mat = lqr
                .k
                .iter()
                .map(|row| {
                    row.iter()
                        .map(|v| v * (1.0 + random.uniform(-size, size)))
                        .collect()
                })
                .collect();
            let f = combine(1.0, &lqr.a, 1.0, &mul(&lqr.b, &gain));
            if linear::spectral_radius_bound(&f, 10) < 0.99 {
                break gain;
            }
            size /= 2.0;
        };
        let ingredients = design(
            &problem
                .with_gain(random::matrix(&gain))
                .expect("a gain of the right shape"),
        );
        let r = Reference::new(&ingredients);
        assert!(max_abs(&combine(1.0, &r.k, -1.0, &gain)) <= 1e-14 * max_abs(&gain));
        let f = r.closed_loop();
        let stage = combine(1.0, &r.q, 1.0, &mul(&transpose(&r.k), &mul(&r.r, &r.k)));
        let left = combine(1.0, &mul(&transpose(&f), &mul(&r.p, &f)), -1.0, &r.p);
        let residual = max_abs(&combine(1.0, &left, 1.0, &stage)) / max_abs(&r.p);
        assert!(
            residual <= 1e-11,
            "seed {seed}: residual of (3) {residual:.1e}"
        );
    });
}

/// (5): A x_s + B u_s = x_s for every column, and the columns are a basis of all of them.
#[test]
fn steady_states_are_all_equilibria() {
    every(problems(0..40), |problem| {
        let r = Reference::new(&design(&problem));
        let name = problem.name();
        let left = combine(1.0, &mul(&r.a, &r.mx), 1.0, &mul(&r.b, &r.mu));
        let residual = max_abs(&combine(1.0, &left, -1.0, &r.mx));
        let size = max_abs(&r.mx).max(max_abs(&r.mu));
        assert!(residual <= 1e-11 * size, "{name}: {residual:.1e}");
        let stacked: Mat = r.mx.iter().chain(&r.mu).cloned().collect();
        assert_eq!(
            linear::rank(&stacked, 1e-9),
            r.m,
            "{name}: independent columns"
        );
        // Null space of [A − I, B] has dimension m exactly when its rank is n.
        let pencil: Mat = (0..r.n)
            .map(|i| {
                let mut row: Vec<f64> = r.a[i].iter().chain(&r.b[i]).copied().collect();
                row[i] -= 1.0;
                row
            })
            .collect();
        assert_eq!(
            linear::rank(&pencil, 1e-9),
            r.n,
            "{name}: rank of [A − I, B]"
        );
    });
}

/// No row of the set can go, every row of the intersection (27) is implied by the set, and each of its rows by the
/// intersection.
fn assert_explicit_set(problem: &Problem) {
    let ingredients = design(problem);
    let r = Reference::new(&ingredients);
    let name = format!("{} ({:?})", problem.name(), problem.task());
    let set = ingredients
        .maximal_admissible_set()
        .unwrap_or_else(|e| panic!("{name}: {e}"));
    let rows = dense(set.rows());
    assert_eq!(rows.len(), set.len());
    let terminal = match problem.task() {
        Task::Tracking => r.tracking(),
        Task::Regulation => r.regulation(),
    };
    let intersection = terminal.intersection(ingredients.terminal_horizon());
    for (k, row) in rows.iter().enumerate() {
        let without = support_of(&rows, row, Some(k));
        assert!(
            without > 1.0 + 1e-9,
            "{name}: row {k} is redundant, its support over the others is {without}"
        );
        let inside = intersection
            .iter()
            .any(|other| distance(other, row) <= 1e-9 * (1.0 + largest(row)))
            || support_of(&intersection, row, None) <= SPENT;
        assert!(inside, "{name}: row {k} cuts the intersection (27)");
    }
    for (k, row) in intersection.iter().enumerate() {
        if rows
            .iter()
            .any(|other| distance(other, row) <= 1e-9 * (1.0 + largest(row)))
        {
            continue;
        }
        let support = support_of(&rows, row, None);
        assert!(
            support <= SPENT,
            "{name}: the set goes beyond row {k} of (27): {support}"
        );
    }
}

#[test]
fn explicit_sets_are_irredundant_and_equal_to_the_intersection() {
    for seed in 0..8 {
        assert_explicit_set(&random::problem(seed));
        assert_explicit_set(&random::problem(seed).with_task(Task::Regulation));
    }
    for scaling in [0.99, 0.69] {
        assert_explicit_set(&cases::academic(scaling));
    }
    assert_explicit_set(&cases::academic(0.9).with_task(Task::Regulation));
    assert_explicit_set(&cases::carts(3, 0.9));
}

#[test]
#[ignore = "slow: 60 random plants, 10 carts, and the drone with 402 rows"]
fn explicit_sets_of_many_plants_are_right() {
    assert_explicit_set(&cases::carts(10, 0.9));
    let drone = cases::drone(0.9);
    let rows = design(&drone)
        .maximal_admissible_set()
        .expect("an explicit set")
        .len();
    println!("drone: {rows} irredundant rows");
    assert!(rows <= 402, "{rows} rows: unspent ones alone are 402");
    assert_explicit_set(&drone);
    every(8..68, |seed| assert_explicit_set(&random::problem(seed)));
}

/// The closest admissible equilibrium against a program in (x_s, u_s), for set-points near and far.
#[test]
fn closest_admissible_equilibria_agree_with_the_reference() {
    every(problems(0..40), |problem| {
        let ingredients = design(&problem);
        let r = Reference::new(&ingredients);
        let mut random = Random::new(77);
        for (trial, size) in [0.05, 0.5, 2.0, 10.0, 100.0].into_iter().enumerate() {
            // Equilibria for the first and fourth trial, any state for the others.
            let theta = random.vector(r.m, size);
            let (state, equilibrium) = if trial % 3 == 0 {
                (apply(&r.mx, &theta), true)
            } else {
                (random.vector(r.n, size), r.n == 0)
            };
            let name = format!("{}, set-point {trial}", problem.name());
            let found = ingredients
                .steady_states()
                .closest_admissible(&problem, &SetPoint::state(state.clone()))
                .unwrap_or_else(|e| panic!("{name}: {e}"));
            let (xs, _, cost) = r.closest_equilibrium(&state, &vec![0.0; r.m]);
            let size = 1.0 + largest(&xs);
            // An equilibrium, within λ of the constraints, and as cheap as the reference's.
            let next = r.successor(&found.state, &found.input);
            assert!(distance(&next, &found.state) <= 1e-9 * size, "{name}");
            let violation = r.violation(&found.state, &found.input);
            assert!(
                violation <= r.scaling - 1.0 + 1e-8,
                "{name}: outside λΘ by {:.1e}",
                violation + 1.0 - r.scaling
            );
            let difference = linear::minus(&found.state, &state);
            let paid = quadratic(&r.o, &difference);
            assert!(
                (paid - found.offset_cost).abs() <= 1e-9 * (1.0 + paid),
                "{name}"
            );
            let slack = 1e-7 * quadratic(&r.o, &state).max(1e-3);
            assert!(
                (found.offset_cost - cost).abs() <= slack,
                "{name}: offset cost {} and {cost} by the reference",
                found.offset_cost
            );
            assert!(
                distance(&found.state, &xs) <= 1e-6 * size,
                "{name}: {:?} and {xs:?} by the reference",
                found.state
            );
            assert_eq!(
                found.admissible,
                distance(&xs, &state) <= 1e-7 * (1.0 + largest(&state)),
                "{name}: admissible, distance {:.1e}",
                distance(&xs, &state)
            );
            assert!(
                !(found.admissible && !equilibrium && r.m < r.n),
                "{name}: no random state is an equilibrium"
            );
            // The limiting rows are those that are active at the answer.
            let rows = r.equilibrium_rows();
            for (i, w) in rows.iter().enumerate() {
                let at = linear::dot(w, &found.parameter);
                let named = found.limiting.contains(&problem.rows().source[i]);
                if named {
                    assert!(
                        at >= r.scaling - 1e-5,
                        "{name}: row {i} does not limit: {at}"
                    );
                } else {
                    assert!(at <= r.scaling - 1e-9, "{name}: row {i} limits too: {at}");
                }
            }
            assert!(
                found.admissible || !found.limiting.is_empty() || r.m < r.n,
                "{name}: refused without a limiting row"
            );
        }
    });
}

/// More inputs than states: of the inputs that hold the same state, the one of least norm, where no bound forbids it.
#[test]
fn undetermined_inputs_are_the_least_ones() {
    let mut seen = 0;
    for seed in (0..60).filter(|&s| random::kind(s) == Kind::OverActuated) {
        let problem = random::problem(seed);
        let ingredients = design(&problem);
        let r = Reference::new(&ingredients);
        let state = Random::new(seed).vector(r.n, 0.05);
        // Least norm: u = Bᵀ (B Bᵀ)⁻¹ (x − A x).
        let needed = linear::minus(&state, &apply(&r.a, &state));
        let gram = mul(&r.b, &transpose(&r.b));
        let column: Mat = needed.iter().map(|v| vec![*v]).collect();
        let y = linear::solve(&gram, &column).expect("B has full row rank");
        let y: Vec<f64> = y.into_iter().map(|v| v[0]).collect();
        let least = linear::apply_transposed(&r.b, &y);
        if r.violation(&state, &least) > r.scaling - 1.0 {
            continue;
        }
        seen += 1;
        let found = ingredients
            .steady_states()
            .closest_admissible(&problem, &SetPoint::state(state.clone()))
            .expect("an equilibrium");
        assert!(found.admissible, "seed {seed}");
        assert!(distance(&found.state, &state) <= 1e-6, "seed {seed}");
        assert!(
            distance(&found.input, &least) <= 1e-5 * (1.0 + largest(&least)),
            "seed {seed}: {:?}, least norm {least:?}",
            found.input
        );
    }
    assert!(
        seen >= 8,
        "{seen} plants where no bound forbids the least input"
    );
}
