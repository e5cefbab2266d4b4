//! The three cases of section 4, written out from the published values and not from the library's problem files.

use super::linear::{Mat, zeros};
use super::random::matrix;
use mpct::{Constraints, Plant, Problem, Weights};

/// λ of the tables of horizons.
pub const SCALINGS: [f64; 8] = [0.99, 0.90, 0.89, 0.79, 0.69, 0.59, 0.49, 0.39];
/// M̃ of the academic case for [`SCALINGS`], first form (Table 1) and second form.
pub const ACADEMIC: [(usize, usize); 8] = [
    (10, 13),
    (5, 6),
    (5, 6),
    (4, 5),
    (3, 5),
    (3, 4),
    (3, 4),
    (2, 4),
];
/// M̃ of the drone for [`SCALINGS`], first form (Table 1) and second form.
pub const DRONE: [(usize, usize); 8] = [
    (203, 244),
    (92, 119),
    (88, 116),
    (64, 90),
    (50, 75),
    (39, 63),
    (31, 53),
    (25, 45),
];

/// Section 4.1; A and B from Limón et al. 2008, section 4.
pub fn academic(scaling: f64) -> Problem {
    let plant = Plant::discrete(
        matrix(&vec![vec![1.0, 1.0], vec![0.0, 1.0]]),
        matrix(&vec![vec![0.0, 0.5], vec![1.0, 0.5]]),
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
        .with_name("academic")
}

/// The continuous-time matrices of section 4.2 for any number of carts; spring 0.5 N/m and damper 0.2 N s/m are not
/// printed there.
pub fn carts_matrices(count: usize) -> (Mat, Mat) {
    let (spring, damper) = (0.5, 0.2);
    let (mut a, mut b) = (zeros(2 * count, 2 * count), zeros(2 * count, count));
    for i in 0..count {
        a[2 * i][2 * i + 1] = 1.0;
        b[2 * i + 1][i] = 50.0;
        for j in [i.wrapping_sub(1), i + 1] {
            if j < count {
                a[2 * i + 1][2 * i] -= spring;
                a[2 * i + 1][2 * i + 1] -= damper;
                a[2 * i + 1][2 * j] += spring;
                a[2 * i + 1][2 * j + 1] += damper;
            }
        }
    }
    (a, b)
}

/// Section 4.2; N = 5 and O = 10⁴ I are not printed there.
pub fn carts(count: usize, scaling: f64) -> Problem {
    let (a, b) = carts_matrices(count);
    let plant = Plant::continuous(matrix(&a), matrix(&b), 0.02).expect("plant");
    let limits: Vec<f64> = (0..2 * count)
        .map(|i| if i % 2 == 0 { 4.0 } else { 1.0 })
        .collect();
    let lower: Vec<f64> = limits.iter().map(|v| -v).collect();
    let constraints = Constraints::new(2 * count, count)
        .state_bounds(&lower, &limits)
        .and_then(|c| c.input_bounds(&vec![-1.0; count], &vec![1.0; count]))
        .expect("constraints");
    let q: Vec<f64> = (0..2 * count)
        .map(|i| if i % 2 == 0 { 1.0 } else { 1.5 })
        .collect();
    Problem::new(plant, constraints, Weights::new(q, 20.0, 1e4))
        .and_then(|p| p.with_prediction_horizon(5))
        .and_then(|p| p.with_scaling(scaling))
        .expect("problem")
        .with_name(format!("{count} carts"))
}

/// The continuous-time matrices of section 4.3: hover of a quadrotor.
pub fn drone_matrices() -> (Mat, Mat) {
    let (mass, g) = (0.6, 9.81);
    let inertia = [0.009_169_13, 0.009_169_13, 0.010_080_64];
    let (mut a, mut b) = (zeros(12, 12), zeros(12, 4));
    for i in 0..3 {
        a[i][3 + i] = 1.0;
        a[6 + i][9 + i] = 1.0;
        b[9 + i][1 + i] = 1.0 / inertia[i];
    }
    a[3][7] = -g;
    a[4][6] = g;
    b[5][0] = -1.0 / mass;
    (a, b)
}

/// Section 4.3; the bounds on angles and rates are assumed.
pub fn drone(scaling: f64) -> Problem {
    let (a, b) = drone_matrices();
    let plant = Plant::continuous(matrix(&a), matrix(&b), 0.04).expect("plant");
    let angle = std::f64::consts::FRAC_PI_4;
    let limits = [
        3.0, 3.0, 3.0, 3.0, 3.0, 3.0, angle, angle, angle, 3.0, 3.0, 3.0,
    ];
    let inputs = [1.5, 0.043, 0.043, 0.043];
    let constraints = Constraints::new(12, 4)
        .state_bounds(&limits.map(|v| -v), &limits)
        .and_then(|c| c.input_bounds(&inputs.map(|v| -v), &inputs))
        .expect("constraints");
    Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e6))
        .and_then(|p| p.with_prediction_horizon(5))
        .and_then(|p| p.with_scaling(scaling))
        .expect("problem")
        .with_name("drone")
}
