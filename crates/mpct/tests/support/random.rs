//! Random plants with fixed seeds.
//!
//! Some are open-loop unstable, some have integrators (eigenvalue exactly 1), some have more inputs than states, so
//! that M_θx lacks full column rank. Bounds are asymmetric and some are missing, rows mix states and inputs, weights
//! have entries off the diagonal. Everything is drawn so that it is valid by construction; what the library refuses
//! fails the test that asked for it.

use super::linear::{self, Mat};
use mpct::{Constraints, Matrix, Plant, Problem, Weights};

/// SplitMix64 (Steele, Lea, Flood 2014): the same numbers on every machine and for ever.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(
            seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .wrapping_add(0x1234_5678),
        )
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in low..=high.
    pub fn integer(&mut self, low: usize, high: usize) -> usize {
        low + (self.next() % (high - low + 1) as u64) as usize
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }

    pub fn matrix(&mut self, rows: usize, cols: usize, size: f64) -> Mat {
        (0..rows)
            .map(|_| (0..cols).map(|_| self.uniform(-size, size)).collect())
            .collect()
    }

    pub fn vector(&mut self, n: usize, size: f64) -> Vec<f64> {
        (0..n).map(|_| self.uniform(-size, size)).collect()
    }

    /// V Vᵀ + diagonal: positive definite, with entries off the diagonal.
    fn weight(&mut self, n: usize, size: f64) -> Mat {
        let v = self.matrix(n, n, size.sqrt() / 2.0);
        let mut w = linear::mul(&v, &linear::transpose(&v));
        for (i, row) in w.iter_mut().enumerate() {
            row[i] += size * self.uniform(0.3, 1.0);
        }
        w
    }
}

/// What a random plant is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Spectral radius below 1.
    Stable,
    /// An eigenvalue outside the unit circle.
    Unstable,
    /// Eigenvalue exactly 1.
    Integrating,
    /// More inputs than states: equilibria with equal states and different inputs.
    OverActuated,
}

/// The kind of the plant with this seed.
pub fn kind(seed: u64) -> Kind {
    match seed % 4 {
        0 => Kind::Stable,
        1 => Kind::Unstable,
        2 => Kind::Integrating,
        _ => Kind::OverActuated,
    }
}

pub fn matrix(m: &Mat) -> Matrix {
    Matrix::from_vecs("a matrix of the tests", m).expect("rows of equal length")
}

/// The tracking problem with this seed: n ≤ 8, m ≤ 4.
pub fn problem(seed: u64) -> Problem {
    let kind = kind(seed);
    let mut random = Random::new(seed);
    let (n, m) = match kind {
        Kind::OverActuated => {
            let n = random.integer(1, 3);
            (n, random.integer(n + 1, 4))
        }
        _ => {
            let n = random.integer(1, 8);
            (n, random.integer(1, n.min(4)))
        }
    };
    let a = loop {
        let a = random.matrix(n, n, 1.0);
        // The bound is tight enough after 2^8 steps; a nearly nilpotent draw is no use.
        let radius = linear::spectral_radius_bound(&a, 8);
        if radius < 0.05 {
            continue;
        }
        let wanted = match kind {
            Kind::Unstable => random.uniform(1.02, 1.15),
            _ => random.uniform(0.4, 0.97),
        };
        let mut a: Mat = a
            .iter()
            .map(|row| row.iter().map(|v| v * wanted / radius).collect())
            .collect();
        if kind == Kind::Integrating {
            // The last state sums up the others: a column of the identity, and eigenvalue exactly 1.
            for (i, row) in a.iter_mut().enumerate() {
                row[n - 1] = if i == n - 1 { 1.0 } else { 0.0 };
            }
        }
        break a;
    };
    // A dense random B reaches every mode.
    let b = random.matrix(n, m, 1.0);
    let mut bounds = |count: usize, low: f64, high: f64, missing: f64| -> (Vec<f64>, Vec<f64>) {
        let (mut lower, mut upper) = (Vec::new(), Vec::new());
        for _ in 0..count {
            lower.push(-random.uniform(low, high));
            upper.push(random.uniform(low, high));
            // At most one side: every direction stays bounded by the terminal dynamics together.
            if random.chance(missing) {
                if random.chance(0.5) {
                    *lower.last_mut().expect("pushed") = f64::NEG_INFINITY;
                } else {
                    *upper.last_mut().expect("pushed") = f64::INFINITY;
                }
            }
        }
        (lower, upper)
    };
    let (state_lower, state_upper) = bounds(n, 1.0, 6.0, 0.1);
    let (input_lower, input_upper) = bounds(m, 0.5, 3.0, 0.0);
    let mut constraints = Constraints::new(n, m)
        .state_bounds(&state_lower, &state_upper)
        .expect("state bounds")
        .input_bounds(&input_lower, &input_upper)
        .expect("input bounds");
    let rows = random.integer(0, 3);
    if rows > 0 {
        let c = random.matrix(rows, n, 1.0);
        let d = random.matrix(rows, m, 1.0);
        let bound = (0..rows).map(|_| random.uniform(1.0, 6.0)).collect();
        constraints = constraints
            .mixed(matrix(&c), matrix(&d), bound)
            .expect("mixed rows");
    }
    let weights = Weights::new(
        matrix(&random.weight(n, 1.0)),
        matrix(&random.weight(m, 2.0)),
        matrix(&random.weight(n, 1000.0)),
    );
    let scaling = random.uniform(0.5, 0.95);
    let horizon = random.integer(2, 6);
    Problem::new(
        Plant::discrete(matrix(&a), matrix(&b)).expect("plant"),
        constraints,
        weights,
    )
    .expect("problem")
    .with_name(format!("random {seed}"))
    .with_scaling(scaling)
    .expect("scaling")
    .with_prediction_horizon(horizon)
    .expect("horizon")
}
