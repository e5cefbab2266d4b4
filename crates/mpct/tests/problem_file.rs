//! Law: a problem file that is written reads back to the same problem, number by number.

use mpct::simulation::{Disturbance, ScheduledSetPoint, Simulation};
use mpct::{
    Constraints, FileError, Formulation, Labels, Matrix, NoTerminalConstraint, Plant, Problem,
    ProblemFile, SetPoint, SparseMatrix, Task, TerminalCost, Weight, Weights,
};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::path::Path;

/// Numbers of every size, whole ones and zeros among them.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        -9.0..9.0_f64,
        (-9..9_i32).prop_map(f64::from),
        (-1.0..1.0_f64, -30..30_i32).prop_map(|(v, e)| v * 10.0_f64.powi(e)),
    ]
}

fn numbers(len: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(number(), len)
}

/// Distances from the operating point to a bound.
fn room(len: usize) -> impl Strategy<Value = Vec<f64>> {
    let one = prop_oneof![3 => 1e-3..1e3_f64, 1 => Just(f64::INFINITY)];
    prop::collection::vec(one, len)
}

/// A dense matrix, or a large one with few entries.
fn matrix(rows: usize, cols: usize) -> impl Strategy<Value = SparseMatrix> {
    numbers(rows * cols).prop_map(move |v| Matrix::new(rows, cols, v).unwrap().into())
}

fn weight(n: usize) -> impl Strategy<Value = Weight> {
    prop_oneof![
        (1e-3..1e6_f64).prop_map(Weight::Scalar),
        prop::collection::vec(1e-3..1e6_f64, n).prop_map(Weight::Diagonal),
        prop::collection::vec(-1.0..1.0_f64, n * n).prop_map(move |v| {
            let square = Matrix::new(n, n, v).unwrap();
            let mut definite = Matrix::zeros(n, n);
            for i in 0..n {
                for j in 0..n {
                    let dot: f64 = (0..n).map(|k| square.get(i, k) * square.get(j, k)).sum();
                    definite.set(i, j, dot + if i == j { 0.5 } else { 0.0 });
                }
            }
            Weight::Matrix(definite.into())
        }),
    ]
}

fn plant(n: usize, m: usize) -> impl Strategy<Value = Plant> {
    let parts = (
        matrix(n, n),
        matrix(n, m),
        prop::option::of(1e-3..10.0_f64),
        any::<bool>(),
        prop::option::of((numbers(n), numbers(m))),
        prop::option::of(prop::collection::vec(any::<String>(), n)),
    );
    parts.prop_map(move |(a, b, time, continuous, at, names)| {
        let continued = time.filter(|_| continuous).and_then(|time| {
            // Some random plants overflow within the sampling time; those stay discrete.
            Plant::continuous(a.clone(), b.clone(), time).ok()
        });
        let mut plant = continued.unwrap_or_else(|| Plant::discrete(a, b).unwrap());
        if let Some(time) = time.filter(|_| !continuous) {
            plant = plant.with_sampling_time(time).unwrap();
        }
        if let Some((x, u)) = at {
            plant = plant.with_operating_point(x, u).unwrap();
        }
        if let Some(state_names) = names {
            let labels = Labels {
                state_names,
                ..Labels::default()
            };
            plant = plant.with_labels(labels).unwrap();
        }
        plant
    })
}

type Rooms = (Vec<f64>, Vec<f64>, Vec<f64>, Vec<f64>);

fn constraints(plant: &Plant, rooms: Rooms, mixed: Vec<(Vec<f64>, Vec<f64>, f64)>) -> Constraints {
    let at = plant.operating_point();
    let moved = |from: &[f64], by: &[f64], sign: f64| -> Vec<f64> {
        from.iter().zip(by).map(|(x, d)| x + sign * d).collect()
    };
    let (n, m) = (plant.states(), plant.inputs());
    let mut constraints = Constraints::new(n, m)
        .state_bounds(
            &moved(&at.state, &rooms.0, -1.0),
            &moved(&at.state, &rooms.1, 1.0),
        )
        .unwrap()
        .input_bounds(
            &moved(&at.input, &rooms.2, -1.0),
            &moved(&at.input, &rooms.3, 1.0),
        )
        .unwrap();
    for (c, d, room) in mixed {
        let dot =
            |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() };
        let bound = dot(&c, &at.state) + dot(&d, &at.input);
        let c = Matrix::new(1, n, c).unwrap();
        let d = Matrix::new(1, m, d).unwrap();
        constraints = constraints
            .mixed(c, d, vec![bound + room * (1.0 + bound.abs())])
            .unwrap();
    }
    constraints
}

fn simulation(n: usize, m: usize) -> impl Strategy<Value = Simulation> {
    let set_point = (1..50_usize, numbers(n), prop::option::of(numbers(m)));
    let parts = (
        numbers(n),
        1..1000_usize,
        prop::collection::vec(set_point, 0..4),
        prop::option::of((room(n), any::<u64>())),
    );
    parts.prop_map(|(initial_state, steps, points, disturbance)| {
        let mut from_step = 0;
        let set_points = points
            .into_iter()
            .map(|(gap, state, input)| {
                from_step += gap;
                ScheduledSetPoint {
                    from_step,
                    set_point: SetPoint { state, input },
                }
            })
            .collect();
        Simulation {
            initial_state,
            steps,
            set_points,
            disturbance: disturbance.map(|(bound, seed)| Disturbance {
                bound: bound.iter().map(|b| b.min(1.0)).collect(),
                seed,
            }),
        }
    })
}

fn problem_file() -> impl Strategy<Value = ProblemFile> {
    (1..5_usize, 1..4_usize).prop_flat_map(|(n, m)| {
        let row = (numbers(n), numbers(m), 0.1..10.0_f64);
        let whats = (
            plant(n, m),
            (room(n), room(n), room(m), room(m)),
            prop::collection::vec(row, 0..3),
            (weight(n), weight(m), weight(n), prop::option::of(weight(m))),
        );
        let hows = (
            any::<String>(),
            any::<bool>(),
            (
                0..3_u8,
                any::<bool>(),
                0..9_usize,
                1.0..99.0_f64,
                prop::option::of(0.1..99.0_f64),
            ),
            1..100_usize,
            0.01..0.99_f64,
            prop::option::of(matrix(m, n)),
            prop::option::of(simulation(n, m)),
        );
        (whats, hows).prop_filter_map("no room beside the origin", |(whats, hows)| {
            let (plant, rooms, mixed, (q, r, o, o_input)) = whats;
            let (name, regulation, formulation, steps, scaling, gain, simulation) = hows;
            let (formulation, implicit_cost, extension, gamma, alpha) = formulation;
            // Beside a large operating point a small room is lost to rounding.
            let at = plant.operating_point();
            if at.state.iter().chain(&at.input).any(|v| v.abs() > 1e9) {
                return None;
            }
            let constraints = constraints(&plant, rooms, mixed);
            let mut weights = Weights::new(q, r, o);
            weights.offset_input = o_input;
            let mut problem = Problem::new(plant, constraints, weights)
                .ok()?
                .with_name(name)
                .with_prediction_horizon(steps)
                .unwrap()
                .with_scaling(scaling)
                .unwrap();
            if regulation {
                problem = problem.with_task(Task::Regulation);
            }
            if implicit_cost {
                problem = problem.with_terminal_cost(TerminalCost::Implicit);
            }
            problem = match formulation {
                0 => problem,
                1 => problem.with_formulation(Formulation::Explicit),
                _ => {
                    let mut choices = NoTerminalConstraint::new(extension, gamma).unwrap();
                    if let Some(alpha) = alpha {
                        choices = choices.with_alpha(alpha).unwrap();
                    }
                    problem.with_no_terminal_constraint(choices)
                }
            };
            if let Some(gain) = gain {
                problem = problem.with_gain(gain.to_dense()).unwrap();
            }
            Some(ProblemFile {
                problem,
                simulation,
            })
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        rng_seed: RngSeed::Fixed(20250601),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn written_files_read_back_to_the_same(file in problem_file()) {
        let text = file.to_toml();
        let again = ProblemFile::parse(&text, Path::new("."));
        prop_assert_eq!(again.as_ref(), Ok(&file), "{}", text);
    }

    /// Whatever is done to a good file, it is read or refused with a message of a few lines.
    #[test]
    fn damaged_files_are_refused_with_a_short_message(
        at in 0.0..1.0_f64,
        cut in 0..40_usize,
        put in "[\\x20-\\x7e\\n]{0,8}",
    ) {
        let good = mpct::cases::academic().to_toml();
        let from = (at * good.len() as f64) as usize;
        let to = (from + cut).min(good.len());
        let damaged = format!("{}{put}{}", &good[..from], &good[to..]);
        if let Err(error) = ProblemFile::parse(&damaged, Path::new(".")) {
            prop_assert!(error.to_string().len() < 1000, "{}", error);
        }
    }
}

fn refused(from: &str, to: &str) -> FileError {
    let good = mpct::cases::academic().to_toml();
    assert!(good.contains(from), "`{from}` is not in the file");
    ProblemFile::parse(&good.replacen(from, to, 1), Path::new(".")).unwrap_err()
}

#[test]
fn messages_name_the_line() {
    for (from, to, line, part) in [
        ("scaling =", "scalling =", 24, "controller.scaling"),
        ("scaling = 0.9", "scaling = true", 24, "a number"),
        (
            "[[1.0, 1.0], [0.0, 1.0]]",
            "[\n[1.0, 1.0],\n[0.0]]",
            6,
            "row 1 has 1",
        ),
        (
            "[[1.0, 1.0], [0.0, 1.0]]",
            "[\n[1.0, 'a'],\n[0, 1]]",
            5,
            "plant.A[0][1]",
        ),
        ("from_step = 100", "from_step = -1", 36, "whole number"),
    ] {
        let good = mpct::cases::academic().to_toml();
        let message = refused(from, to).to_string();
        assert!(
            message.starts_with(&format!("line {line}: ")) && message.contains(part),
            "{message}\n{good}"
        );
    }
}

#[test]
fn large_keys_and_control_characters_stay_out_of_messages() {
    let long = refused("[plant]", &format!("{} = 1\n[plant]", "a".repeat(100_000)));
    assert!(long.to_string().len() < 300, "{long}");
    let steering = refused("[plant]", "\"\\u001b[31mred\" = 1\n[plant]");
    assert!(!steering.to_string().contains('\u{1b}'), "{steering}");
    let text = refused("task = \"tracking\"", "task = \"\\u001b[31m\"");
    assert!(!text.to_string().contains('\u{1b}'), "{text}");
}

#[test]
fn sparse_matrices() {
    let a = "[[1.0, 1.0], [0.0, 1.0]]";
    let good = mpct::cases::academic();
    let text = good.to_toml();
    // Entries in any order; those at the same place add up.
    let entries =
        "{ shape = [2, 2], entries = [[1, 1, 0.25], [0, 1, 1], [1, 1, 0.75], [0, 0, 1]] }";
    let sparse = ProblemFile::parse(&text.replacen(a, entries, 1), Path::new(".")).unwrap();
    assert_eq!(sparse, good);
    for (value, parts) in [
        ("{ shape = [2, 2] }", &["missing key `plant.A.entries`"][..]),
        ("{ entries = [] }", &["missing key `plant.A.shape`"]),
        (
            "{ shape = [2], entries = [] }",
            &["plant.A.shape", "1 numbers"],
        ),
        (
            "{ shape = [2, 2.5], entries = [] }",
            &["plant.A.shape", "whole"],
        ),
        (
            "{ shape = [2, 4e9], entries = [] }",
            &["plant.A.shape", "200000"],
        ),
        (
            "{ shape = [2, 2], entries = [[0, 0]] }",
            &["plant.A.entries[0]"],
        ),
        (
            "{ shape = [2, 2], entries = [[0, -1, 1]] }",
            &["plant.A.entries[0]"],
        ),
        (
            "{ shape = [2, 2], entries = [[2, 0, 1]] }",
            &["plant.A.entries", "2 x 2"],
        ),
        (
            "{ csv = 'A.csv', shape = [2, 2] }",
            &["plant.A.shape", "both"],
        ),
        ("{ cvs = 'A.csv' }", &["plant.A.cvs", "plant.A.csv"]),
    ] {
        let message = refused(a, value).to_string();
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }
}

#[test]
fn horizons_beyond_all_memory_are_refused() {
    let message = refused("prediction_horizon = 10", "prediction_horizon = 4000000000");
    let message = message.to_string();
    assert!(
        message.contains("at most 10000") && message.contains("4000000000"),
        "{message}"
    );
}

#[test]
fn choices_left_over_from_another_formulation_are_not_written() {
    let mut file = mpct::cases::academic();
    let choices = NoTerminalConstraint::new(2, 20.0).unwrap();
    file.problem = file
        .problem
        .with_no_terminal_constraint(choices)
        .with_formulation(Formulation::Implicit);
    let again = ProblemFile::parse(&file.to_toml(), Path::new(".")).unwrap();
    assert_eq!(again, mpct::cases::academic());
}
