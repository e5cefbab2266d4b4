//! The three case studies of section 4, as self-contained problem files.
//!
//! ```
//! let file = mpct::cases::academic();
//! assert_eq!(file.problem.plant().states(), 2);
//! assert!(mpct::cases::text(&file).starts_with('#'));
//! # Ok::<(), mpct::DesignError>(())
//! ```

use crate::control::SetPoint;
use crate::error::DesignError;
use crate::matrix::{Matrix, SparseMatrix};
use crate::problem::file::ProblemFile;
use crate::problem::{Constraints, Labels, Plant, Problem, Weights};
use crate::simulation::{ScheduledSetPoint, Simulation};
use std::f64::consts::FRAC_PI_4;

/// Largest number of carts for which a file is made.
pub const MAX_CARTS: usize = 100_000;

/// The data of the cases are constants of this file; a test builds all of them.
fn built<T>(result: Result<T, DesignError>) -> T {
    match result {
        Ok(value) => value,
        Err(error) => unreachable!("a built-in case is refused: {error}"),
    }
}

fn schedule(set_points: &[(usize, Vec<f64>)]) -> Vec<ScheduledSetPoint> {
    set_points
        .iter()
        .map(|(from_step, state)| ScheduledSetPoint {
            from_step: *from_step,
            set_point: SetPoint::state(state.clone()),
        })
        .collect()
}

fn box_around(upper_state: &[f64], upper_input: &[f64]) -> Result<Constraints, DesignError> {
    let minus = |v: &[f64]| -> Vec<f64> { v.iter().map(|x| -x).collect() };
    Constraints::new(upper_state.len(), upper_input.len())
        .state_bounds(&minus(upper_state), upper_state)?
        .input_bounds(&minus(upper_input), upper_input)
}

/// The words of a text, which has no blank inside of a word.
fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(String::from).collect()
}

/// The plant of section 4.1: two states, two inputs. The last set-point is not admissible.
pub fn academic() -> ProblemFile {
    built(try_academic())
}

fn try_academic() -> Result<ProblemFile, DesignError> {
    let plant = Plant::discrete(
        Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]),
        Matrix::from_rows(&[[0.0, 0.5], [1.0, 0.5]]),
    )?
    .with_sampling_time(1.0)?;
    let problem = Problem::new(
        plant,
        box_around(&[3.0; 2], &[2.0; 2])?,
        Weights::new(10.0, 100.0, 1e4),
    )?
    .with_name("academic")
    .with_prediction_horizon(10)?
    .with_scaling(0.9)?;
    Ok(ProblemFile {
        problem,
        simulation: Some(Simulation {
            initial_state: vec![0.0, 0.0],
            steps: 210,
            set_points: schedule(&[
                (0, vec![2.0, 0.5]),
                (50, vec![-2.0, -0.5]),
                (100, vec![1.0, 0.25]),
                (150, vec![5.0, 1.0]),
            ]),
            disturbance: None,
        }),
    })
}

/// The quadrotor of section 4.3: twelve states, four inputs, linearised at hover.
pub fn drone() -> ProblemFile {
    built(try_drone())
}

fn try_drone() -> Result<ProblemFile, DesignError> {
    let (gravity, mass, jx, jy, jz) = (9.81, 0.6, 0.00916913, 0.00916913, 0.01008064);
    // States: p (3), v (3), roll, pitch, yaw, rates (3). Inputs: thrust deviation, three torques.
    let mut a: Vec<(usize, usize, f64)> = Vec::new();
    for i in 0..3 {
        a.push((i, 3 + i, 1.0));
        a.push((6 + i, 9 + i, 1.0));
    }
    a.push((3, 7, -gravity));
    a.push((4, 6, gravity));
    let b = [
        (5, 0, -1.0 / mass),
        (9, 1, 1.0 / jx),
        (10, 2, 1.0 / jy),
        (11, 3, 1.0 / jz),
    ];
    let plant = Plant::continuous(
        SparseMatrix::from_triplets(12, 12, &a)?,
        SparseMatrix::from_triplets(12, 4, &b)?,
        0.04,
    )?
    .with_labels(Labels {
        state_names: words("px py pz vx vy vz roll pitch yaw roll_rate pitch_rate yaw_rate"),
        state_units: words("m m m m/s m/s m/s rad rad rad rad/s rad/s rad/s"),
        input_names: words("thrust roll_torque pitch_torque yaw_torque"),
        input_units: ["N", "N m", "N m", "N m"].map(String::from).to_vec(),
    })?;
    let mut upper = vec![3.0; 12];
    upper[6..9].fill(FRAC_PI_4);
    let constraints = box_around(&upper, &[1.5, 0.043, 0.043, 0.043])?;
    let problem = Problem::new(plant, constraints, Weights::new(10.0, 100.0, 1e6))?
        .with_name("drone")
        .with_prediction_horizon(5)?
        .with_scaling(0.9)?;
    let at = |p: [f64; 3], yaw: f64| {
        let mut x = vec![0.0; 12];
        x[..3].copy_from_slice(&p);
        x[8] = yaw;
        x
    };
    Ok(ProblemFile {
        problem,
        simulation: Some(Simulation {
            initial_state: vec![0.0; 12],
            steps: 900,
            set_points: schedule(&[
                (0, at([1.0, 1.0, 1.0], 0.3)),
                (225, at([-2.3, 1.5, 2.0], -0.5)),
                (450, at([2.3, -2.3, -1.0], 0.0)),
                (675, at([0.0, 0.0, 0.5], 0.0)),
            ]),
            disturbance: None,
        }),
    })
}

/// The chain of carts of section 4.2: two states and one input a cart.
///
/// # Errors
/// [`DesignError::OutOfRange`] for a count of 0, or above [`MAX_CARTS`].
pub fn carts(count: usize) -> Result<ProblemFile, DesignError> {
    if !(1..=MAX_CARTS).contains(&count) {
        return Err(DesignError::OutOfRange {
            what: "the number of carts".into(),
            expected: format!("1 to {MAX_CARTS}"),
            found: count.to_string(),
        });
    }
    let (spring, damper, gain) = (0.5, 0.2, 50.0);
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for i in 0..count {
        let (position, speed) = (2 * i, 2 * i + 1);
        a.push((position, speed, 1.0));
        b.push((speed, i, gain));
        let neighbours = [i.checked_sub(1), Some(i + 1).filter(|&j| j < count)];
        for j in neighbours.into_iter().flatten() {
            a.push((speed, position, -spring));
            a.push((speed, speed, -damper));
            a.push((speed, 2 * j, spring));
            a.push((speed, 2 * j + 1, damper));
        }
    }
    let n = 2 * count;
    let plant = Plant::continuous(
        SparseMatrix::from_triplets(n, n, &a)?,
        SparseMatrix::from_triplets(n, count, &b)?,
        0.02,
    )?
    .with_labels(Labels {
        state_names: (1..=count)
            .flat_map(|i| [format!("r{i}"), format!("v{i}")])
            .collect(),
        state_units: words(&"m m/s ".repeat(count)),
        input_names: (1..=count).map(|i| format!("u{i}")).collect(),
        input_units: Vec::new(),
    })?;
    let alternate = |odd: f64, even: f64| -> Vec<f64> {
        (0..n)
            .map(|k| if k % 2 == 0 { even } else { odd })
            .collect()
    };
    let constraints = box_around(&alternate(1.0, 4.0), &vec![1.0; count])?;
    let problem = Problem::new(
        plant,
        constraints,
        Weights::new(alternate(1.5, 1.0), 20.0, 1e4),
    )?
    .with_name(format!("carts-{count}"))
    .with_prediction_horizon(5)?
    .with_scaling(0.9)?;
    // Positions that repeat along the chain; neighbours pull in different directions.
    let positions = |pattern: [f64; 5]| -> Vec<f64> {
        (0..n)
            .map(|k| {
                if k % 2 == 0 {
                    pattern[(k / 2) % 5]
                } else {
                    0.0
                }
            })
            .collect()
    };
    Ok(ProblemFile {
        problem,
        simulation: Some(Simulation {
            initial_state: vec![0.0; n],
            steps: 600,
            set_points: schedule(&[
                (0, positions([1.0, -0.5, 0.8, -1.0, 0.2])),
                (200, positions([-1.0, 0.6, -0.4, 1.2, -0.8])),
                (400, positions([0.3, 0.3, 0.3, 0.3, 0.3])),
            ]),
            disturbance: None,
        }),
    })
}

/// The problem file of a case, headed by comments that say where its numbers come from.
pub fn text(file: &ProblemFile) -> String {
    let name = file.problem.name();
    let comments = match name {
        "academic" => ACADEMIC,
        "drone" => DRONE,
        _ if name.starts_with("carts") => CARTS,
        _ => "",
    };
    format!("{comments}{}", file.to_toml())
}

const ACADEMIC: &str = "\
# The academic plant of section 4.1 of Luque, Chanfreut, Limon, Maestre, Automatica 179 (2025) 112436.
# A and B are those of Limon et al., Automatica 44 (2008); with Q, R, O and N of the paper, the terminal horizon is 5.
# The paper does not print its set-points; these are chosen. The last one is not admissible on purpose.

";
const DRONE: &str = "\
# The quadrotor of section 4.3 of Luque, Chanfreut, Limon, Maestre, Automatica 179 (2025) 112436.
# States: position px, py, pz [m]; velocity vx, vy, vz [m/s]; roll, pitch, yaw [rad]; their rates [rad/s].
# Inputs: deviation of the thrust from hover [N]; torques about roll, pitch, yaw [N m].
# Linearised at hover: p' = v, vx' = -g pitch, vy' = g roll, vz' = -F/m, angles' = rates, rates' = torques/J.
# The paper prints the input limits, Q, R, O, N, the scaling and the sampling time. The mass, the limits of position and
# velocity and the zero-order hold are those that reproduce its terminal horizons. The inertia, the limits of angles and
# rates, and the set-points are not printed; these are chosen, and do not change the terminal horizon.

";
const CARTS: &str = "\
# The chain of carts of section 4.2 of Luque, Chanfreut, Limon, Maestre, Automatica 179 (2025) 112436.
# States: displacement r [m] and velocity v [m/s] of each cart. Inputs: one force a cart, gain 50.
# The paper prints the limits, Q, R, the scaling and the sampling time. Masses (1 kg), springs (0.5 N/m), dampers
# (0.2 N s/m), both between neighbours, the prediction horizon, O and the set-points are chosen.

";

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn files_read_back_to_the_same_case() {
        for file in [academic(), drone(), carts(1).unwrap(), carts(7).unwrap()] {
            let again = ProblemFile::parse(&text(&file), Path::new(".")).unwrap();
            assert_eq!(again, file);
        }
    }

    #[test]
    fn the_examples_are_these_files() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
        for (name, file) in [
            ("academic", academic()),
            ("drone", drone()),
            ("carts-10", carts(10).unwrap()),
        ] {
            let stored = std::fs::read_to_string(folder.join(format!("{name}.toml"))).unwrap();
            assert_eq!(
                stored,
                text(&file),
                "{name}: write it anew with `mpct example`"
            );
        }
    }

    #[test]
    fn no_carts_and_too_many_are_refused() {
        assert!(carts(0).is_err());
        assert!(carts(MAX_CARTS + 1).is_err());
    }
}
