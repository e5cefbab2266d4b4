//! The plants of section 4, written down once more.

use mpct::{Constraints, DesignOptions, Matrix, Plant, Problem, TerminalIngredients, Weights};

/// Section 4.1.
pub fn academic(scaling: f64) -> Problem {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
        Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
    )
    .expect("plant");
    let constraints = Constraints::new(2, 2)
        .state_bounds(&[-3.0; 2], &[3.0; 2])
        .and_then(|c| c.input_bounds(&[-2.0; 2], &[2.0; 2]))
        .expect("constraints");
    Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e4))
        .and_then(|p| p.with_prediction_horizon(10))
        .and_then(|p| p.with_scaling(scaling))
        .expect("problem")
}

/// A double integrator with a weak input, x⁺ = [1 1; 0 1] x + [0.5; 1] u, |x| ≤ 3, |u| ≤ 0.3, N = 2: what the terminal
/// constraint is decides which states are attracted.
pub fn weak() -> Problem {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
        Matrix::from_rows(&[[0.5], [1.0]]),
    )
    .expect("plant");
    let constraints = Constraints::new(2, 1)
        .state_bounds(&[-3.0; 2], &[3.0; 2])
        .and_then(|c| c.input_bounds(&[-0.3], &[0.3]))
        .expect("constraints");
    Problem::new(plant, constraints, Weights::new(1.0, 1.0, 1e3))
        .and_then(|p| p.with_prediction_horizon(2))
        .expect("problem")
}

/// Section 4.3 with the values that reproduce the paper's M̃.
pub fn drone() -> Problem {
    let (g, mass) = (9.81, 0.6);
    let mut a = Matrix::zeros(12, 12);
    let mut b = Matrix::zeros(12, 4);
    for i in 0..3 {
        a.set(i, 3 + i, 1.0);
        a.set(6 + i, 9 + i, 1.0);
    }
    a.set(3, 7, -g);
    a.set(4, 6, g);
    b.set(5, 0, -1.0 / mass);
    for (i, inertia) in [0.009_169_13, 0.009_169_13, 0.010_080_64]
        .into_iter()
        .enumerate()
    {
        b.set(9 + i, 1 + i, 1.0 / inertia);
    }
    let angle = std::f64::consts::FRAC_PI_4;
    let x = [
        3.0, 3.0, 3.0, 3.0, 3.0, 3.0, angle, angle, angle, 3.0, 3.0, 3.0,
    ];
    let u = [1.5, 0.043, 0.043, 0.043];
    let constraints = Constraints::new(12, 4)
        .state_bounds(&x.map(|v| -v), &x)
        .and_then(|c| c.input_bounds(&u.map(|v| -v), &u))
        .expect("constraints");
    let plant = Plant::continuous(a, b, 0.04).expect("plant");
    Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e6))
        .and_then(|p| p.with_prediction_horizon(5))
        .expect("problem")
}

/// The terminal ingredients with default options.
pub fn design(problem: &Problem) -> TerminalIngredients {
    TerminalIngredients::design(problem, &DesignOptions::default()).expect("design")
}
