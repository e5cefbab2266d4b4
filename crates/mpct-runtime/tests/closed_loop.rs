//! The academic plant in closed loop, with everything that can go wrong.

mod common;

use common::{Lcg, Problem, academic, full, tables_of};
use mpct_runtime::{
    Budget, Controller, StepError, StepStatus, Tables, WarmStart, Why, Workspace, cast_tables,
};

fn with_controller<R>(
    problem: &Problem,
    with_gram: bool,
    run: impl FnOnce(&mut Controller<'_, f64>) -> R,
) -> R {
    let dims = problem.dims;
    let buffer = tables_of(problem, with_gram);
    let tables = Tables::from_slice(dims, &buffer)
        .unwrap()
        .with_shift(&problem.shift)
        .unwrap();
    let (mut numbers, mut indices) = (
        vec![f64::NAN; dims.workspace_len()],
        vec![7; dims.index_len()],
    );
    run(&mut Controller::new(
        tables,
        Workspace::new(dims, &mut numbers, &mut indices).unwrap(),
    )
    .unwrap())
}

fn inside(u: &[f64]) -> bool {
    u.iter().all(|v| v.abs() <= 2.0 * (1.0 + 1e-15))
}

/// One optimum, checked: input in U, residuals below 1e-8.
fn checked(
    problem: &Problem,
    c: &mut Controller<'_, f64>,
    x: &[f64],
    r: &[f64],
) -> (Vec<f64>, f64) {
    let step = c.step(x, r, Budget::unlimited()).unwrap();
    assert_eq!(step.status, StepStatus::Optimal);
    assert!(step.stationarity < 1e-8 && step.violation < 1e-9);
    let (u, z, cost) = (step.input.to_vec(), step.solution.to_vec(), step.cost);
    assert!(inside(&u));
    let y = full(problem.dims.rows, c.multipliers());
    assert!(problem.residual(x, r, &z, &y) < 1e-8);
    (u, cost)
}

#[test]
fn goes_to_the_set_point_with_every_warm_start() {
    let problem = academic();
    let r = [1.0, -0.5, 0.0, 1.0];
    let starts = [WarmStart::Keep, WarmStart::Shift, WarmStart::Cold];
    for (warm, with_gram) in starts.into_iter().flat_map(|w| [(w, false), (w, true)]) {
        with_controller(&problem, with_gram, |c| {
            c.set_warm_start(warm);
            let mut x = vec![-2.5, 0.5];
            for _ in 0..200 {
                let (u, _) = checked(&problem, c, &x, &r);
                x = problem.next(&x, &u);
                assert!(x.iter().all(|v| v.abs() <= 3.0 + 1e-8));
            }
            assert!(
                (x[0] - 1.0).abs() < 1e-3 && (x[1] + 0.5).abs() < 1e-3,
                "{x:?}"
            );
        });
    }
}

#[test]
fn the_candidate_is_feasible_and_costs_less() {
    let problem = academic();
    let r = [2.0, 0.0, 0.0, 0.0];
    with_controller(&problem, true, |c| {
        let mut x = vec![-2.0, -0.3];
        let (u, _) = checked(&problem, c, &x, &r);
        x = problem.next(&x, &u);
        for _ in 0..30 {
            // A clock that is always over: never a QP solved again.
            let mut over = || true;
            let step = c
                .step(&x, &r, Budget::unlimited().until(&mut over))
                .unwrap();
            assert_eq!(step.status, StepStatus::Candidate(Why::Deadline));
            assert!(step.violation <= 1e-9, "{}", step.violation);
            let u = step.input.to_vec();
            assert!(inside(&u));
            x = problem.next(&x, &u);
        }
        checked(&problem, c, &x, &r);
    });
}

#[test]
fn more_budget_never_costs_more_at_the_same_state() {
    let problem = academic();
    let (x, r) = ([-2.9, 0.9], [2.9, 0.0, 0.0, 0.0]);
    let mut last = f64::INFINITY;
    for iterations in 0..30 {
        with_controller(&problem, true, |c| {
            // A plan made for another set-point; then everything changes.
            let first = c
                .step(&[-2.9, 0.9], &[-2.9, 0.0, 0.0, 0.0], Budget::unlimited())
                .unwrap()
                .input
                .to_vec();
            let next = problem.next(&x, &first);
            let step = c.step(&next, &r, Budget::iterations(iterations)).unwrap();
            assert!(step.violation <= 1e-9 && inside(step.input) && step.iterations <= iterations);
            if step.status == StepStatus::Optimal {
                assert!(step.cost <= last + 1e-6);
            }
            last = last.min(step.cost);
        });
    }
}

#[test]
fn bad_steps_poison_nothing() {
    let problem = academic();
    let r = [1.0, 0.0, 0.0, 0.0];
    with_controller(&problem, true, |c| {
        let x = [0.5, 0.2];
        let (u, cost) = checked(&problem, c, &x, &r);
        for (bad_x, bad_r) in [
            ([f64::NAN, 0.0], r),
            ([0.0, f64::INFINITY], r),
            ([0.0, 0.0], [f64::NAN, 0.0, 0.0, 0.0]),
            ([1e300, -1e300], r),
            ([f64::MAX, f64::MAX], [f64::MAX; 4]),
            ([1e30, 0.0], [1e30; 4]),
            ([50.0, 50.0], r),
            ([0.0, 0.0], [1e12, -1e12, 0.0, 0.0]),
        ] {
            if let Ok(step) = c.step(&bad_x, &bad_r, Budget::unlimited()) {
                assert!(inside(step.input));
            }
            let (again, cost_again) = checked(&problem, c, &x, &r);
            assert!(
                (u[0] - again[0]).abs() < 1e-8 && (cost - cost_again).abs() < 1e-8 * cost.abs()
            );
        }
        assert_eq!(
            c.step(&[1.0, f64::NAN], &r, Budget::unlimited())
                .unwrap_err(),
            StepError::StateNotFinite { index: 1 }
        );
        assert_eq!(
            c.step(&[1.0], &r, Budget::unlimited()).unwrap_err(),
            StepError::WrongLength {
                what: "state",
                expected: 2,
                found: 1
            }
        );
        c.reset();
        let mut over = || true;
        assert_eq!(
            c.step(&x, &r, Budget::unlimited().until(&mut over))
                .unwrap_err(),
            StepError::NoCandidate { why: Why::Deadline }
        );
    });
}

/// Two loops, `f64` and `f32`, each on its own state, until they differ by more than allowed.
fn compare_precisions(
    problem: &Problem,
    with_gram: bool,
    seed: u64,
    period: usize,
    spread: &[f64],
    limits: &[f64],
) {
    let dims = problem.dims;
    let buffer = tables_of(problem, with_gram);
    let mut single = vec![0.0_f32; buffer.len()];
    let tables = cast_tables(dims, &buffer, &mut single).unwrap();
    let (mut numbers, mut indices) = (
        vec![0.0_f32; dims.workspace_len()],
        vec![0; dims.index_len()],
    );
    let mut small = Controller::new(
        tables,
        Workspace::new(dims, &mut numbers, &mut indices).unwrap(),
    )
    .unwrap();
    with_controller(problem, with_gram, |c| {
        let mut random = Lcg(seed);
        let u_max = &problem.plant.u_max;
        let (mut x, mut x32) = (vec![0.0; dims.states], vec![0.0; dims.states]);
        let mut r = vec![0.0; dims.set_point];
        for k in 0..6000 {
            if k % period == 0 {
                r.iter_mut()
                    .zip(spread)
                    .for_each(|(v, s)| *v = s * random.signed());
            }
            let step = c.step(&x, &r, Budget::unlimited()).unwrap();
            assert_eq!(step.status, StepStatus::Optimal, "{k}");
            let (u, z) = (step.input.to_vec(), step.solution.to_vec());
            let y = full(dims.rows, c.multipliers());
            assert!(problem.residual(&x, &r, &z, &y) < 1e-8, "{k}");
            let (xs, rs): (Vec<f32>, Vec<f32>) = (
                x32.iter().map(|&v| v as f32).collect(),
                r.iter().map(|&v| v as f32).collect(),
            );
            let step = small
                .step(&xs, &rs, Budget::unlimited())
                .unwrap_or_else(|e| panic!("{k}: {e}"));
            assert_eq!(step.status, StepStatus::Optimal, "{k}");
            assert!(step.violation <= 1e-4);
            let u32: Vec<f64> = step.input.iter().map(|&v| f64::from(v)).collect();
            x = problem.next(&x, &u);
            x32 = problem.next(&x32, &u32);
            for ((a, b), limit) in u.iter().zip(&u32).zip(u_max) {
                assert!((a - b).abs() < 1e-3, "{k} {u:?} {u32:?}");
                assert!(b.abs() <= limit * (1.0 + 1e-4));
            }
            for ((a, b), limit) in x.iter().zip(&x32).zip(limits) {
                assert!((a - b).abs() < *limit, "seed {seed} step {k} {x:?} {x32:?}");
            }
        }
    });
}

#[test]
fn single_precision_follows_double_precision() {
    for seed in [11, 100, 101] {
        for with_gram in [false, true] {
            compare_precisions(&academic(), with_gram, seed, 40, &[3.5, 0.5], &[1e-3; 2]);
        }
    }
}

/// States within 10⁻³ of their bounds, inputs within 10⁻³. Not within 10⁻³ in absolute terms: a velocity on its bound is
/// differentiated twice on the way to the body rates, and there the worst of twelve seeds (105, this one is kept) was 1.16·10⁻³ rad/s
/// of 3. A torque may differ by 3·10⁻⁴ of 0.043 N m in a single step.
#[test]
fn single_precision_flies_the_drone() {
    let problem = common::drone(12);
    let spread = [3.5, 3.5, 3.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9];
    let limits: Vec<f64> = problem.plant.x_max.iter().map(|v| 1e-3 * v).collect();
    for seed in [11, 100, 105, 106] {
        compare_precisions(&problem, false, seed, 150, &spread, &limits);
    }
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let problem = common::drone(12);
    let run = |with_gram| {
        with_controller(&problem, with_gram, |c| {
            let (mut x, mut r) = (vec![0.0; 12], vec![0.0; 16]);
            (r[0], r[1], r[8]) = (1.0, -2.0, 0.5);
            let mut bits = Vec::new();
            for _ in 0..100 {
                let u = c.step(&x, &r, Budget::unlimited()).unwrap().input.to_vec();
                bits.extend(u.iter().map(|v| v.to_bits()));
                x = problem.next(&x, &u);
            }
            bits
        })
    };
    assert_eq!(run(false), run(false));
    assert_eq!(run(true), run(true));
}

/// FNV-1a of the inputs of 300 steps of the academic plant in `f32`, set-points that jump.
fn fingerprint(with_gram: bool) -> u64 {
    let problem = academic();
    let dims = problem.dims;
    let buffer = tables_of(&problem, with_gram);
    let mut single = vec![0.0_f32; buffer.len()];
    let tables = cast_tables(dims, &buffer, &mut single).unwrap();
    let (mut numbers, mut indices) = (
        vec![0.0_f32; dims.workspace_len()],
        vec![0; dims.index_len()],
    );
    let workspace = Workspace::new(dims, &mut numbers, &mut indices).unwrap();
    let mut c = Controller::new(tables, workspace).unwrap();
    let (mut random, mut x, mut r) = (Lcg(21), vec![0.0; 2], [0.0_f32; 4]);
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for k in 0..300 {
        if k % 30 == 0 {
            r = [
                (3.5 * random.signed()) as f32,
                random.signed() as f32,
                0.0,
                0.0,
            ];
        }
        let measured = [x[0] as f32, x[1] as f32];
        let u: Vec<f32> = c
            .step(&measured, &r, Budget::unlimited())
            .unwrap()
            .input
            .to_vec();
        for byte in u.iter().flat_map(|v| v.to_bits().to_le_bytes()) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        }
        x = problem.next(&x, &u.iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
    }
    hash
}

/// The number was found on x86-64. It is the same wherever IEEE 754 arithmetic is, and changes when the source changes the order
/// of an operation: then it is to be stored anew.
#[test]
fn inputs_in_single_precision_have_the_stored_bits() {
    assert_eq!(fingerprint(false), 12_867_970_574_866_688_728);
    // Products of rows are of no use in f32, and ignored.
    assert_eq!(fingerprint(true), fingerprint(false));
}

/// Random states inside, on the border, outside; random set-points, budgets, faults.
fn soak(steps: u32, with_gram: bool) {
    let problem = academic();
    with_controller(&problem, with_gram, |c| {
        let mut random = Lcg(99);
        let (mut x, mut r) = (vec![0.0, 0.0], [0.0; 4]);
        let (mut optimal, mut candidates, mut infeasible, mut none) = (0, 0, 0, 0);
        for k in 0..steps {
            match random.below(40) {
                0 => x = vec![3.0 * random.signed(), 3.0 * random.signed()],
                1 => {
                    x = vec![
                        if random.uniform() < 0.5 { 3.0 } else { -3.0 },
                        random.signed(),
                    ]
                }
                2 => x = vec![20.0 * random.signed(), 20.0 * random.signed()],
                3 | 4 => x.iter_mut().for_each(|v| *v += 0.05 * random.signed()),
                5 => {
                    let _ = c.step(&[f64::NAN, 1e308], &r, Budget::unlimited());
                }
                6 => c.claim_active(&[k % 200, 3, 3, u32::MAX, k % 7]),
                7 => c.set_warm_start(
                    [WarmStart::Keep, WarmStart::Shift, WarmStart::Cold][random.below(3)],
                ),
                8 if random.uniform() < 0.1 => c.reset(),
                9 | 10 => r = [10.0 * random.signed(), random.signed(), 0.0, 0.0],
                11 => r = [x[0], x[1], 0.0, 0.0],
                _ => {}
            }
            let budget = if random.uniform() < 0.3 {
                random.below(6) as u32
            } else {
                u32::MAX
            };
            let mut left = random.below(20);
            let mut clock = || {
                left = left.saturating_sub(1);
                left == 0
            };
            let mut limits = Budget::iterations(budget);
            if random.uniform() < 0.1 {
                limits = limits.until(&mut clock);
            }
            let result = c
                .step(&x, &r, limits)
                .map(|s| (s.status, s.input.to_vec(), s.solution.to_vec(), s.violation));
            match result {
                Ok((status, u, z, violation)) => {
                    assert!(inside(&u), "{k} {u:?}");
                    if status == StepStatus::Optimal {
                        optimal += 1;
                        let y = full(problem.dims.rows, c.multipliers());
                        let residual = problem.residual(&x, &r, &z, &y);
                        assert!(residual < 1e-8, "{k} {residual:e}");
                    } else {
                        candidates += 1;
                        assert_ne!(
                            status,
                            StepStatus::Candidate(Why::SolverFailed),
                            "{k} {x:?} {r:?}"
                        );
                        if violation <= 1e-9 {
                            let zero = vec![0.0; problem.dims.rows];
                            let (f, b) = (problem.linear(&x, &r), problem.bound(&x));
                            let v = mpct_runtime::verify(
                                &problem.hessian,
                                &f,
                                &problem.rows,
                                &b,
                                &z,
                                &zero,
                            )
                            .unwrap();
                            assert!(v.primal <= 2e-9, "{k} {}", v.primal);
                        }
                    }
                    x = problem.next(&x, &u);
                }
                Err(StepError::Infeasible { radius }) => {
                    infeasible += 1;
                    let (image, bound, least) =
                        problem.farkas(&x, &full(problem.dims.rows, c.proof()));
                    assert!(
                        least >= 0.0 && bound < 0.0 && radius > 1e6 && image * 1e6 <= -bound,
                        "{k}"
                    );
                    x = vec![random.signed(), 0.3 * random.signed()];
                }
                Err(StepError::NoCandidate { why }) => {
                    assert_ne!(why, Why::SolverFailed, "{k} {x:?} {r:?}");
                    none += 1;
                }
                Err(other) => panic!("{k}: {other:?}"),
            }
        }
        assert!(
            optimal > steps / 2 && candidates > 0 && infeasible > 0,
            "{optimal} {candidates} {infeasible} {none}"
        );
    });
}

#[test]
fn soak_of_a_hundred_thousand_steps() {
    soak(100_000, false);
    soak(100_000, true);
}

#[test]
#[ignore = "slow: ten times the soak above"]
fn soak_of_a_million_steps() {
    // With products of rows both ways are walked: they leave what is delicate to the rows.
    soak(1_000_000, true);
}
