//! Ellipsoidal constraints: the terminal horizon, its certificate, and closed loops, against polygons, samples and formulas.

mod support;

use mpct::certificate::{Certificate, VerifyOptions, verify};
use mpct::*;
use support::random::{self, Random};

#[test]
fn explore() {
    for seed in 0..40 {
        let problem = with_ellipsoids(seed);
        let t = std::time::Instant::now();
        let d = match TerminalIngredients::design(&problem, &DesignOptions::default()) { Ok(d) => d, Err(e) => { println!("{seed} {e}"); continue; } };
        let t1 = t.elapsed();
        let t = std::time::Instant::now();
        let v = Certificate::of(&d).map(|c| { let s = c.to_json(); (s.len(), verify(&s, VerifyOptions::default())) });
        let q: Vec<usize> = problem.norms().iter().map(|b| b.dimension()).collect();
        println!("{seed} {:?} n {} m {} p {} q {q:?} λ {:.2} M {} minimal {} programs {} {:?} cert {:?} {}", random::kind(seed), problem.plant().states(), problem.plant().inputs(), problem.rows().len(), problem.scaling(), d.terminal_horizon(), d.is_minimal(), d.linear_programs(), t1, t.elapsed(), match v { Ok((l, Ok(v))) => format!("{l} bytes margin {:e} {} tol {} norms {}", v.smallest_margin, v.tightest_row, v.rows_to_tolerance, v.ellipsoids), Ok((_, Err(e))) => e.to_string(), Err(e) => e.to_string() });
    }
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
            row.iter_mut().for_each(|v| *v /= radius * radius * n as f64);
        }
        random::matrix(&e)
    };
    let mut constraints = base
        .constraints()
        .clone()
        .state_ellipsoid_around(form(n, 2.0), vec![0.2; n])
        .unwrap();
    if seed % 2 == 0 {
        constraints = constraints.input_ellipsoid(form(m, 1.0)).unwrap();
    }
    if seed % 3 == 0 {
        constraints = constraints
            .norm_bound(random::matrix(&random.matrix(2, n, 0.3)), random::matrix(&random.matrix(2, m, 0.3)))
            .unwrap();
    }
    let weights = Weights::new(base.state_weight().clone(), base.input_weight().clone(), base.offset_weight().clone());
    Problem::new(base.plant().clone(), constraints, weights)
        .unwrap()
        .with_name(format!("ellipsoids {seed}"))
        .with_scaling(base.scaling())
        .unwrap()
        .with_prediction_horizon(base.prediction_horizon())
        .unwrap()
}
