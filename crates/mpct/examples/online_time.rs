//! Nanoseconds of every step of a closed loop.
//!
//! ```text
//! cargo run --release -p mpct --example online_time                        the academic plant and the drone, a table
//! … -- problem.toml schedule.csv steps repetitions out.csv                 for benchmarks/closed_loop.py
//! ```
//!
//! A line of the schedule is the step from which a set-point holds, and its state. The loop is driven by the checked optimum of
//! the desk's controller. A line of the answer:
//! `runtime_ns, runtime_cold_ns, desk_ns, desk_cold_ns, iterations, cold_iterations, active, x…, u…`. Times are the smallest of the
//! repetitions, so that other programs on the machine do not count; "cold" is a step after `reset`; "runtime" is the step of
//! `mpct_runtime` alone, from the measured state and the set-point to the input, "desk" is `Controller::step`, which also
//! checks the answer, tells whether the set-point is admissible and predicts. Where the controller has no dense tables, the first
//! two are empty.

use mpct::runtime::banded::BandedController;
use mpct::runtime::{self, Budget, Tables, Workspace};
use mpct::{Controller, DesignOptions, ProblemFile, SetPoint, TerminalIngredients, cases};
use std::error::Error;
use std::fmt::Write as _;
use std::time::Instant;

/// What is known about one step.
#[derive(Clone, Default)]
struct Record {
    runtime: Option<[u64; 2]>,
    desk: [u64; 2],
    iterations: [usize; 2],
    active: usize,
    state: Vec<f64>,
    input: Vec<f64>,
}

/// What is known about the answers.
#[derive(Default)]
struct Accuracy {
    violation: f64,
    /// Largest of the residuals of `mpct_runtime::verify`.
    residual: f64,
    /// Largest difference between the inputs of the runtime and of the desk.
    apart: f64,
    /// Variables and rows of the program.
    variables: usize,
    rows: usize,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match &arguments[..] {
        [] => {
            println!("ns a step         runtime mean    worst    desk mean    worst");
            for (name, file) in [("academic", cases::academic()), ("drone", cases::drone())] {
                let ingredients =
                    TerminalIngredients::design(&file.problem, &DesignOptions::default())?;
                let simulation = file.simulation.as_ref().ok_or("no simulation")?;
                let schedule: Vec<(usize, Vec<f64>)> = simulation
                    .set_points
                    .iter()
                    .map(|s| (s.from_step, s.set_point.state.clone()))
                    .collect();
                let (records, _) = run(
                    ingredients,
                    simulation.initial_state.clone(),
                    &schedule,
                    300,
                    2,
                )?;
                let column = |of: &dyn Fn(&Record) -> u64| {
                    let sum: u64 = records.iter().map(of).sum();
                    let worst = records.iter().map(of).max().unwrap_or(0);
                    (sum / records.len() as u64, worst)
                };
                let (mean, worst) = column(&|r| r.runtime.map_or(0, |t| t[0]));
                let (desk, desk_worst) = column(&|r| r.desk[0]);
                println!("{name:16} {mean:13} {worst:8} {desk:12} {desk_worst:8}");
            }
            Ok(())
        }
        [problem, schedule, steps, repetitions, out] => {
            let file = ProblemFile::read(std::path::Path::new(problem))?;
            let ingredients =
                TerminalIngredients::design(&file.problem, &DesignOptions::default())?;
            let schedule = std::fs::read_to_string(schedule)?
                .lines()
                .map(|line| {
                    let mut numbers = line.split(',');
                    let from = numbers.next().unwrap_or_default().trim().parse()?;
                    let state: Result<Vec<f64>, _> = numbers.map(|v| v.trim().parse()).collect();
                    Ok((from, state?))
                })
                .collect::<Result<Vec<_>, Box<dyn Error>>>()?;
            let initial = file
                .simulation
                .as_ref()
                .map(|s| s.initial_state.clone())
                .ok_or("the problem file has no simulation")?;
            let (records, accuracy) = run(
                ingredients,
                initial,
                &schedule,
                steps.parse()?,
                repetitions.parse()?,
            )?;
            std::fs::write(out, table(&records)?)?;
            println!(
                "{{\"violation\": {:e}, \"residual\": {:e}, \"apart\": {:e}, \"variables\": {}, \"rows\": {}}}",
                accuracy.violation,
                accuracy.residual,
                accuracy.apart,
                accuracy.variables,
                accuracy.rows
            );
            Ok(())
        }
        _ => Err("arguments: problem.toml schedule.csv steps repetitions out.csv".into()),
    }
}

fn table(records: &[Record]) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    for r in records {
        match r.runtime {
            Some([warm, cold]) => write!(out, "{warm},{cold},")?,
            None => write!(out, ",,")?,
        }
        write!(
            out,
            "{},{},{},{},{}",
            r.desk[0], r.desk[1], r.iterations[0], r.iterations[1], r.active
        )?;
        for v in r.state.iter().chain(&r.input) {
            write!(out, ",{v:?}")?;
        }
        out.push('\n');
    }
    Ok(out)
}

fn set_point(schedule: &[(usize, Vec<f64>)], k: usize, states: usize) -> Vec<f64> {
    let now = schedule.iter().rev().find(|(from, _)| *from <= k);
    now.map_or_else(|| vec![0.0; states], |(_, state)| state.clone())
}

fn run(
    ingredients: TerminalIngredients,
    initial: Vec<f64>,
    schedule: &[(usize, Vec<f64>)],
    steps: usize,
    repetitions: usize,
) -> Result<(Vec<Record>, Accuracy), Box<dyn Error>> {
    let mut desk = Controller::new(ingredients)?;
    let problem = desk.ingredients().problem().clone();
    let plant = problem.plant();
    let (n, m) = (plant.states(), plant.inputs());
    let at = plant.operating_point().clone();
    let mut records = Vec::<Record>::new();
    let mut accuracy = Accuracy {
        variables: desk.variables(),
        rows: desk.rows(),
        ..Accuracy::default()
    };
    for repetition in 0..repetitions.max(1) {
        desk.reset();
        let mut x = initial.clone();
        for k in 0..steps {
            let r = SetPoint::state(set_point(schedule, k, n));
            let start = Instant::now();
            let step = desk.step(&x, &r)?;
            let elapsed = start.elapsed().as_nanos() as u64;
            if repetition == 0 {
                records.push(Record {
                    desk: [u64::MAX; 2],
                    iterations: [step.iterations, 0],
                    state: x.clone(),
                    input: step.input.clone(),
                    ..Record::default()
                });
                accuracy.violation = accuracy.violation.max(step.violation);
            }
            records[k].desk[0] = records[k].desk[0].min(elapsed);
            x = next(&problem, &x, &step.input);
        }
        for (k, record) in records.iter_mut().enumerate() {
            let r = SetPoint::state(set_point(schedule, k, n));
            desk.reset();
            let start = Instant::now();
            let step = desk.step(&record.state, &r)?;
            record.desk[1] = record.desk[1].min(start.elapsed().as_nanos() as u64);
            record.iterations[1] = step.iterations;
        }
    }
    let Some((dims, numbers)) = desk.runtime_tables() else {
        // The desk checks every optimum to 1e-8 and keeps the number to itself.
        accuracy.residual = f64::NAN;
        let setpoints: Vec<Vec<f64>> = (0..steps).map(|k| set_point(schedule, k, n)).collect();
        banded(&desk, &setpoints, repetitions, &mut records, &mut accuracy)?;
        return Ok((records, accuracy));
    };
    let (mut memory, mut indices) = (vec![0.0; dims.workspace_len()], vec![0; dims.index_len()]);
    let workspace = Workspace::new(dims, &mut memory, &mut indices)?;
    let mut target = runtime::Controller::new(Tables::from_slice(dims, numbers)?, workspace)?;
    let input = at.input.clone();
    let shifted = |k: usize, state: &[f64]| -> (Vec<f64>, Vec<f64>) {
        let minus = |v: &[f64]| v.iter().zip(&at.state).map(|(v, o)| v - o).collect();
        let mut r: Vec<f64> = minus(&set_point(schedule, k, n));
        r.extend(std::iter::repeat_n(0.0, dims.set_point - n));
        (minus(state), r)
    };
    for repetition in 0..repetitions.max(1) {
        for is_cold in [false, true] {
            target.reset();
            for k in 0..records.len() {
                let (x, r) = shifted(k, &records[k].state);
                if is_cold {
                    target.reset();
                }
                let start = Instant::now();
                let step = target.step(&x, &r, Budget::unlimited())?;
                let elapsed = start.elapsed().as_nanos() as u64;
                let u: Vec<f64> = step.input.iter().zip(&input).map(|(u, o)| u + o).collect();
                let solution = step.solution.to_vec();
                let times = records[k].runtime.get_or_insert([u64::MAX; 2]);
                times[usize::from(is_cold)] = times[usize::from(is_cold)].min(elapsed);
                if repetition == 0 {
                    for (a, b) in u.iter().zip(&records[k].input) {
                        accuracy.apart = accuracy.apart.max((a - b).abs());
                    }
                    let active: Vec<(usize, f64)> = target.multipliers().collect();
                    records[k].active = active.len();
                    let qp = desk.qp(
                        &records[k].state,
                        &SetPoint::state(set_point(schedule, k, n)),
                    )?;
                    let nz = qp.linear.len();
                    let mut y = vec![0.0; qp.bounds.len()];
                    active.iter().for_each(|&(i, v)| y[i] = v);
                    let found = runtime::verify(
                        qp.hessian.as_slice(),
                        &qp.linear,
                        qp.rows.as_slice(),
                        &qp.bounds,
                        &solution[..nz],
                        &y,
                    )
                    .ok_or("shapes")?;
                    accuracy.residual = accuracy.residual.max(found.worst());
                    accuracy.violation = accuracy.violation.max(found.primal);
                }
            }
        }
    }
    debug_assert_eq!(m, input.len());
    Ok((records, accuracy))
}

/// The runtime alone, for plants of many subsystems.
fn banded(
    desk: &Controller,
    setpoints: &[Vec<f64>],
    repetitions: usize,
    records: &mut [Record],
    accuracy: &mut Accuracy,
) -> Result<(), Box<dyn Error>> {
    let at = desk.ingredients().problem().plant().operating_point();
    let Some(tables) = desk.runtime_banded_tables() else {
        return Ok(());
    };
    let (numbers, indices) = (
        vec![0.0; tables.workspace_len()],
        vec![0; tables.index_len()],
    );
    let mut target = BandedController::new(&tables, numbers, indices)?;
    let minus = |v: &[f64]| -> Vec<f64> { v.iter().zip(&at.state).map(|(v, o)| v - o).collect() };
    for repetition in 0..repetitions.max(1) {
        for is_cold in [false, true] {
            target.reset(&tables);
            for (record, setpoint) in records.iter_mut().zip(setpoints) {
                let mut r = minus(setpoint);
                r.resize(tables.set_point(), 0.0);
                let x = minus(&record.state);
                if is_cold {
                    target.reset(&tables);
                }
                let start = Instant::now();
                let step = target.step(&tables, &x, &r, Budget::unlimited())?;
                let elapsed = start.elapsed().as_nanos() as u64;
                let times = record.runtime.get_or_insert([u64::MAX; 2]);
                times[usize::from(is_cold)] = times[usize::from(is_cold)].min(elapsed);
                if repetition == 0 && !is_cold {
                    for ((u, o), other) in step.input.iter().zip(&at.input).zip(&record.input) {
                        accuracy.apart = accuracy.apart.max((u + o - other).abs());
                    }
                    record.active = target.multipliers(&tables).count();
                }
            }
        }
    }
    Ok(())
}

/// x⁺ = A x + B u around the operating point.
fn next(problem: &mpct::Problem, x: &[f64], u: &[f64]) -> Vec<f64> {
    let plant = problem.plant();
    let at = plant.operating_point();
    let minus =
        |v: &[f64], o: &[f64]| -> Vec<f64> { v.iter().zip(o).map(|(v, o)| v - o).collect() };
    let ax = plant.a().mul_vec(&minus(x, &at.state));
    let bu = plant.b().mul_vec(&minus(u, &at.input));
    (0..x.len()).map(|i| ax[i] + bu[i] + at.state[i]).collect()
}
