//! Microseconds per step on two problems: `cargo run --release -p mpct-runtime --example step_time`.
//!
//! Closed loop, repeated; the time of a step is its smallest over the repetitions, so that other programs on the machine do not count.
//! Set-point jumps every 120 steps. The drone here has 12 terminal stages instead of the pruned rows of 92, which gives
//! the same size (24 variables, about 580 rows) and the same dynamics.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Lcg, Problem, academic, drone, tables_of};
use mpct_runtime::{Budget, Controller, Scalar, StepStatus, WarmStart, Workspace, cast_tables};
use std::time::Instant;

const STEPS: usize = 12_000;
const REPETITIONS: usize = 10;

fn run<T: Scalar>(name: &str, problem: &Problem, warm: WarmStart, spread: &[f64], with_gram: bool) {
    let dims = problem.dims;
    let buffer = tables_of(problem, with_gram);
    let mut cast = vec![T::ZERO; buffer.len()];
    let tables = cast_tables(dims, &buffer, &mut cast)
        .unwrap()
        .with_shift(&problem.shift)
        .unwrap();
    let (mut times, mut iterations, mut most, mut optimal) =
        (vec![f64::INFINITY; STEPS], 0_u64, 0, 0);
    for _ in 0..REPETITIONS {
        let (mut numbers, mut indices) = (
            vec![T::ZERO; dims.workspace_len()],
            vec![0; dims.index_len()],
        );
        let workspace = Workspace::new(dims, &mut numbers, &mut indices).unwrap();
        let mut controller = Controller::new(tables, workspace).unwrap();
        controller.set_warm_start(warm);
        let mut random = Lcg(5);
        let mut x = vec![0.0; dims.states];
        let mut r = vec![T::ZERO; dims.set_point];
        (iterations, most, optimal) = (0, 0, 0);
        for k in 0..STEPS {
            if k % 120 == 0 {
                for (target, &s) in r.iter_mut().zip(spread) {
                    *target = T::from_f64(s * random.signed());
                }
            }
            let measured: Vec<T> = x.iter().map(|&v| T::from_f64(v)).collect();
            let start = Instant::now();
            let step = controller.step(&measured, &r, Budget::unlimited());
            times[k] = times[k].min(start.elapsed().as_secs_f64() * 1e6);
            match step {
                Ok(step) => {
                    iterations += u64::from(step.iterations);
                    most = most.max(step.iterations);
                    optimal += usize::from(step.status == StepStatus::Optimal);
                    let u: Vec<f64> = step.input.iter().map(|v| v.to_f64()).collect();
                    x = problem.next(&x, &u);
                }
                Err(_) => x.fill(0.0),
            }
        }
    }
    let total = times.len();
    times.sort_by(f64::total_cmp);
    println!(
        "{name:16} {:4} x {:4}  {warm:?}{}  steps {total} optimal {optimal}  us mean {:.2} median {:.2} p99 {:.2} worst {:.1}  iterations mean {:.2} most {most}",
        dims.variables(),
        dims.rows,
        if with_gram { ", products of rows" } else { "" },
        times.iter().sum::<f64>() / total as f64,
        times[total / 2],
        times[total * 99 / 100],
        times[total - 1],
        iterations as f64 / total as f64,
    );
}

fn main() {
    let (mut small, mut large) = (academic(), drone(12));
    // Around the gain of the cost, c and θ do not mix; what is left of that is rounding.
    for problem in [&mut small, &mut large] {
        for matrix in [
            &mut problem.hessian,
            &mut problem.linear_state,
            &mut problem.linear_set_point,
        ] {
            let largest = matrix.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
            for v in matrix.iter_mut().filter(|v| v.abs() < 1e-9 * largest) {
                *v = 0.0;
            }
        }
    }
    let far = [3.5, 3.5, 3.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9];
    for warm in [WarmStart::Keep, WarmStart::Shift, WarmStart::Cold] {
        run::<f32>("academic f32", &small, warm, &[3.0, 0.5], false);
        run::<f32>("drone-size f32", &large, warm, &far, false);
        for with_gram in [false, true] {
            run::<f64>("academic f64", &small, warm, &[3.0, 0.5], with_gram);
            run::<f64>("drone-size f64", &large, warm, &far, with_gram);
        }
    }
}
