//! Random strictly convex problems, regular and nasty, against Clarabel and the independent checker.
//!
//! The right-hand side of a row is `1 + W x`; the tests use one state per row, `W = I`, so that any `b` can be had.

mod common;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus,
};
use common::{Lcg, Mat, Problem, full, tables_of};
use mpct_runtime::{Budget, Controller, Dims, StepError, StepStatus, Tables, Workspace};

struct Qp {
    nz: usize,
    rows: usize,
    h: Vec<f64>,
    g: Vec<f64>,
    f: Vec<f64>,
    b: Vec<f64>,
}

impl Qp {
    fn random(random: &mut Lcg, nz: usize, rows: usize, spread: f64) -> Self {
        let root = Mat::from(
            nz,
            nz,
            &(0..nz * nz).map(|_| random.signed()).collect::<Vec<_>>(),
        );
        let mut h = root.t().mul(&root);
        for i in 0..nz {
            let v = h.at(i, i) + 10.0_f64.powf(-spread * random.uniform());
            h.set(i, i, v);
        }
        let g = (0..nz * rows).map(|_| random.signed()).collect();
        let f = (0..nz).map(|_| 5.0 * random.signed()).collect();
        let b = (0..rows).map(|_| random.uniform()).collect();
        Self {
            nz,
            rows,
            h: h.data,
            g,
            f,
            b,
        }
    }

    fn row(&self, i: usize) -> Vec<f64> {
        self.g[i * self.nz..(i + 1) * self.nz].to_vec()
    }

    fn push(&mut self, row: &[f64], b: f64) {
        self.g.extend_from_slice(row);
        self.b.push(b);
        self.rows += 1;
    }

    /// As a controller's problem: `m = nz`, `N = 0`, state `b − 1`, set-point `f`.
    fn problem(&self) -> Problem {
        let dims = Dims {
            states: self.rows,
            inputs: self.nz,
            horizon: 0,
            set_point: self.nz,
            rows: self.rows,
            input_rows: 0,
        };
        let mut plant_free = common::academic();
        plant_free.dims = dims;
        plant_free.hessian = self.h.clone();
        plant_free.rows = self.g.clone();
        plant_free.rows_state = Mat::identity(self.rows).data;
        plant_free.linear_state = vec![0.0; self.nz * self.rows];
        plant_free.linear_set_point = Mat::identity(self.nz).data;
        plant_free.gain = vec![0.0; self.nz * self.rows];
        plant_free.feedforward = vec![0.0; self.nz * self.nz];
        plant_free.input_rows = Vec::new();
        plant_free
    }

    fn state(&self) -> Vec<f64> {
        self.b.iter().map(|b| b - 1.0).collect()
    }

    /// `(status, cost, z)` of the reference.
    fn reference(&self) -> (SolverStatus, f64, Vec<f64>) {
        let columns = |a: &Mat, upper: bool| {
            let (mut ptr, mut idx, mut val) = (vec![0], vec![], vec![]);
            for j in 0..a.cols {
                for i in 0..a.rows {
                    if !(upper && i > j) {
                        idx.push(i);
                        val.push(a.at(i, j));
                    }
                }
                ptr.push(idx.len());
            }
            CscMatrix::new(a.rows, a.cols, ptr, idx, val)
        };
        let p = columns(&Mat::from(self.nz, self.nz, &self.h), true);
        let a = columns(&Mat::from(self.rows, self.nz, &self.g), false);
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(1e-11)
            .tol_gap_rel(1e-11)
            .tol_feas(1e-11)
            .build()
            .unwrap();
        let mut solver = DefaultSolver::new(
            &p,
            &self.f,
            &a,
            &self.b,
            &[NonnegativeConeT(self.rows)],
            settings,
        )
        .unwrap();
        solver.solve();
        (
            solver.solution.status,
            solver.solution.obj_val,
            solver.solution.x.clone(),
        )
    }
}

#[derive(Debug, PartialEq, Clone, Copy)]
enum Answer {
    Optimal,
    Infeasible,
}

/// Solves by the rows alone and with their products, and checks whatever is claimed.
fn check(qp: &Qp, claim: &[u32], against_reference: bool) -> Answer {
    let answer = check_one(qp, claim, against_reference, false);
    assert_eq!(check_one(qp, claim, false, true), answer);
    answer
}

fn check_one(qp: &Qp, claim: &[u32], against_reference: bool, with_gram: bool) -> Answer {
    let problem = qp.problem();
    let dims = problem.dims;
    let buffer = tables_of(&problem, with_gram);
    let tables = Tables::from_slice(dims, &buffer).unwrap();
    let (mut numbers, mut indices) = (
        vec![f64::NAN; dims.workspace_len()],
        vec![u32::MAX; dims.index_len()],
    );
    let mut controller = Controller::new(
        tables,
        Workspace::new(dims, &mut numbers, &mut indices).unwrap(),
    )
    .unwrap();
    controller.claim_active(claim);
    let (x, r) = (qp.state(), qp.f.clone());
    let result = controller
        .step(&x, &r, Budget::unlimited())
        .map(|s| (s.status, s.cost, s.solution.to_vec(), s.violation));
    match result {
        Ok((status, cost, z, violation)) => {
            assert_eq!(status, StepStatus::Optimal);
            assert!(violation <= 1e-9);
            let y = full(qp.rows, controller.multipliers());
            let v = mpct_runtime::verify(&qp.h, &qp.f, &qp.g, &qp.b, &z, &y).unwrap();
            assert!(v.worst() < 1e-8, "{v:?}");
            if against_reference {
                let (status, reference, z_ref) = qp.reference();
                assert!(
                    matches!(status, SolverStatus::Solved | SolverStatus::AlmostSolved),
                    "{status:?}"
                );
                assert!(
                    (cost - reference).abs() < 1e-6 * (1.0 + reference.abs()),
                    "{cost} {reference}"
                );
                for (a, b) in z.iter().zip(z_ref) {
                    assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
                }
            }
            Answer::Optimal
        }
        Err(StepError::Infeasible { radius }) => {
            assert!(radius > 1e6);
            let (image, bound, least) = problem.farkas(&x, &full(qp.rows, controller.proof()));
            assert!(
                least >= 0.0 && bound < 0.0 && image * 1e6 <= -bound,
                "{image:e} {bound:e}"
            );
            if against_reference {
                assert!(!matches!(qp.reference().0, SolverStatus::Solved));
            }
            Answer::Infeasible
        }
        Err(other) => panic!("{other:?}"),
    }
}

#[test]
fn regular_problems() {
    let mut random = Lcg(1);
    for _ in 0..300 {
        let (nz, rows) = (1 + random.below(25), 1 + random.below(80));
        let qp = Qp::random(&mut random, nz, rows, 4.0);
        assert_eq!(check(&qp, &[], true), Answer::Optimal);
    }
}

#[test]
fn garbage_in_the_warm_start_is_harmless() {
    let mut random = Lcg(2);
    for _ in 0..300 {
        let qp = Qp::random(&mut random, 8, 40, 2.0);
        let claim: Vec<u32> = (0..random.below(60))
            .map(|_| {
                if random.uniform() < 0.2 {
                    u32::MAX - random.below(9) as u32
                } else {
                    random.below(50) as u32
                }
            })
            .collect();
        assert_eq!(check(&qp, &claim, true), Answer::Optimal);
    }
}

#[test]
fn duplicate_parallel_and_zero_rows() {
    let mut random = Lcg(3);
    for _ in 0..300 {
        let mut qp = Qp::random(&mut random, 6, 20, 2.0);
        for _ in 0..20 {
            let at = random.below(qp.rows);
            let (row, b) = (qp.row(at), qp.b[at]);
            match random.below(4) {
                0 => qp.push(&row, b),
                1 => qp.push(&row.iter().map(|v| 3.0 * v).collect::<Vec<_>>(), 3.0 * b),
                2 => qp.push(&[0.0; 6], random.uniform()),
                _ => {
                    // A combination of two rows: redundant, and active when both are.
                    let (other, c) = (qp.row(0), qp.b[0]);
                    let sum: Vec<f64> = row.iter().zip(&other).map(|(p, q)| p + q).collect();
                    qp.push(&sum, b + c);
                }
            }
        }
        assert_eq!(check(&qp, &[], true), Answer::Optimal);
    }
}

#[test]
fn equalities_written_as_pairs() {
    let mut random = Lcg(4);
    for _ in 0..300 {
        let mut qp = Qp::random(&mut random, 7, 0, 2.0);
        let z: Vec<f64> = (0..7).map(|_| random.signed()).collect();
        for _ in 0..1 + random.below(5) {
            let row: Vec<f64> = (0..7).map(|_| random.signed()).collect();
            let value: f64 = row.iter().zip(&z).map(|(a, b)| a * b).sum();
            qp.push(&row, value);
            qp.push(&row.iter().map(|v| -v).collect::<Vec<_>>(), -value);
        }
        for _ in 0..20 {
            let row: Vec<f64> = (0..7).map(|_| random.signed()).collect();
            let value: f64 = row.iter().zip(&z).map(|(a, b)| a * b).sum();
            qp.push(&row, value + random.uniform());
        }
        assert_eq!(check(&qp, &[], true), Answer::Optimal);
    }
}

#[test]
fn infeasible_problems_are_proved() {
    let mut random = Lcg(5);
    for _ in 0..300 {
        let mut qp = Qp::random(&mut random, 6, 15, 2.0);
        // Σ tᵢ · rowᵢ = 0 with Σ tᵢ bᵢ < 0.
        let (mut sum, mut total) = (vec![0.0; 6], 0.0);
        for _ in 0..1 + random.below(5) {
            let at = random.below(qp.rows);
            let t = random.uniform();
            sum.iter_mut()
                .zip(qp.row(at))
                .for_each(|(s, v)| *s -= t * v);
            total += t * qp.b[at];
        }
        qp.push(&sum, -total - 0.01 - random.uniform());
        assert_eq!(check(&qp, &[], true), Answer::Infeasible);
        let mut zero = Qp::random(&mut random, 6, 15, 2.0);
        zero.push(&[0.0; 6], -0.1);
        assert_eq!(check(&zero, &[3, 4], true), Answer::Infeasible);
    }
}

#[test]
fn many_rows_through_one_vertex() {
    let mut random = Lcg(6);
    for _ in 0..200 {
        let mut qp = Qp::random(&mut random, 5, 0, 1.0);
        for _ in 0..60 {
            let row: Vec<f64> = (0..5).map(|_| random.signed()).collect();
            let value: f64 = row.iter().map(|v| 0.3 * v).sum();
            qp.push(&row, value);
        }
        // Feasible or not, the answer must be right: the vertex itself satisfies every row.
        assert_eq!(check(&qp, &[], false), Answer::Optimal);
    }
}

/// What `f32` claims about problems of `f64`: never a false proof, and an optimum is feasible. It may give up.
#[test]
fn single_precision_claims_nothing_wrong() {
    single_precision(false);
    single_precision(true);
}

fn single_precision(with_gram: bool) {
    let mut random = Lcg(7);
    let (mut optimal, mut gave_up, mut infeasible, mut worst) = (0, 0, 0, 0.0_f64);
    for round in 0..600 {
        let mut qp = Qp::random(&mut random, 8, 40, 2.0);
        for _ in 0..10 {
            let at = random.below(qp.rows);
            let (row, b) = (qp.row(at), qp.b[at]);
            qp.push(&row, b);
        }
        let feasible = round % 3 != 0;
        if !feasible {
            let (row, b) = (qp.row(2), qp.b[2]);
            qp.push(&row.iter().map(|v| -v).collect::<Vec<_>>(), -b - 0.01);
        }
        let problem = qp.problem();
        let dims = problem.dims;
        let buffer = tables_of(&problem, with_gram);
        let mut single = vec![0.0_f32; buffer.len()];
        let tables = mpct_runtime::cast_tables(dims, &buffer, &mut single).unwrap();
        let (mut numbers, mut indices) = (
            vec![0.0_f32; dims.workspace_len()],
            vec![0; dims.index_len()],
        );
        let mut controller = Controller::new(
            tables,
            Workspace::new(dims, &mut numbers, &mut indices).unwrap(),
        )
        .unwrap();
        let x: Vec<f32> = qp.state().iter().map(|&v| v as f32).collect();
        let r: Vec<f32> = qp.f.iter().map(|&v| v as f32).collect();
        match controller.step(&x, &r, Budget::unlimited()) {
            Ok(step) => {
                assert!(feasible, "{round}");
                let z: Vec<f64> = step.solution.iter().map(|&v| f64::from(v)).collect();
                let image = Mat::from(qp.rows, qp.nz, &qp.g).apply(&z);
                worst = image
                    .iter()
                    .zip(&qp.b)
                    .fold(worst, |m, (a, b)| m.max(a - b));
                optimal += 1;
            }
            Err(StepError::Infeasible { .. }) => {
                assert!(!feasible, "{round}");
                infeasible += 1;
            }
            Err(_) => gave_up += 1,
        }
    }
    println!(
        "optimal {optimal} infeasible {infeasible} gave up {gave_up} worst violation {worst:e}"
    );
    assert!(
        worst < 1e-4 && gave_up <= 6,
        "{optimal} {infeasible} {gave_up} {worst:e}"
    );
}

/// One state per pair of opposite rows or single row; rows in the order given.
fn paired(qp: &Qp, pairs: usize, order: &[usize]) -> Problem {
    let (units, rows) = (qp.rows, qp.rows + pairs);
    let mut problem = qp.problem();
    problem.dims.states = units;
    problem.dims.rows = rows;
    problem.linear_state = vec![0.0; qp.nz * units];
    problem.gain = vec![0.0; qp.nz * units];
    (problem.rows, problem.rows_state) = (Vec::new(), Vec::new());
    for &row in order {
        let (unit, sign) = if row < 2 * pairs {
            (row / 2, if row % 2 == 0 { 1.0 } else { -1.0 })
        } else {
            (row - pairs, 1.0)
        };
        problem.rows.extend(qp.row(unit).iter().map(|v| sign * v));
        problem
            .rows_state
            .extend((0..units).map(|k| if k == unit { sign } else { 0.0 }));
    }
    problem
}

/// Opposite rows that stand together share their product. Expected: the answer of the same rows in an order in which no pair stands
/// together, one step after another, and the conditions of optimality.
#[test]
fn pairs_of_opposite_rows_are_as_good_as_rows_one_by_one() {
    let mut random = Lcg(6);
    let (mut at_upper, mut at_lower) = (0, 0);
    for round in 0..100 {
        let nz = 1 + random.below(12);
        // Pairs alone, singles alone, and groups of rows with both.
        let (pairs, singles) = [(1 + random.below(30), 0), (0, 9), (5, 7), (24, 30)][round % 4];
        let mut qp = Qp::random(&mut random, nz, pairs + singles, 2.0);
        let rows = 2 * pairs + singles;
        let together: Vec<usize> = (0..rows).collect();
        let apart: Vec<usize> = (0..rows)
            .filter(|row| row % 2 == 0)
            .chain((0..rows).filter(|row| row % 2 == 1))
            .collect();
        let problems = [
            paired(&qp, pairs, &together),
            paired(&qp, pairs, &apart),
            paired(&qp, pairs, &together),
        ];
        // The third with the products of rows.
        let numbers = [0, 1, 2].map(|i| tables_of(&problems[i], i == 2));
        let mut buffers = problems.each_ref().map(|p| {
            (
                vec![0.0; p.dims.workspace_len()],
                vec![0; p.dims.index_len()],
            )
        });
        let mut sources = problems.iter().zip(&numbers);
        let mut controllers = buffers.each_mut().map(|(numbers, indices)| {
            let (problem, tables) = sources.next().unwrap();
            let tables = Tables::from_slice(problem.dims, tables).unwrap();
            let workspace = Workspace::new(problem.dims, numbers, indices).unwrap();
            Controller::new(tables, workspace).unwrap()
        });
        for _ in 0..20 {
            let x: Vec<f64> = (0..qp.rows).map(|_| 0.9 * random.signed()).collect();
            if random.uniform() < 0.3 {
                qp.f = (0..nz).map(|_| 8.0 * random.signed()).collect();
            }
            let [one, other, third] = controllers.each_mut().map(|c| {
                let step = c.step(&x, &qp.f, Budget::unlimited()).unwrap();
                assert_eq!(step.status, StepStatus::Optimal);
                step.solution.to_vec()
            });
            for ((a, b), c) in one.iter().zip(&other).zip(&third) {
                let tolerance = 1e-7 * (1.0 + b.abs());
                assert!((a - b).abs() < tolerance, "{round}: {a} {b}");
                assert!((c - b).abs() < tolerance, "{round}: {c} {b}");
            }
            let y = full(rows, controllers[2].multipliers());
            assert!(
                problems[2].residual(&x, &qp.f, &third, &y) < 1e-8,
                "{round}"
            );
            let y = full(rows, controllers[0].multipliers());
            assert!(problems[0].residual(&x, &qp.f, &one, &y) < 1e-8, "{round}");
            for (row, y) in y
                .iter()
                .enumerate()
                .take(2 * pairs)
                .filter(|(_, y)| **y > 0.0)
            {
                assert!(*y > 0.0);
                if row % 2 == 0 {
                    at_upper += 1;
                } else {
                    at_lower += 1;
                }
            }
        }
    }
    assert!(at_upper > 100 && at_lower > 100, "{at_upper} {at_lower}");
}

/// Products that do not belong to the rows are refused, whichever entry is wrong.
#[test]
fn damaged_products_are_refused() {
    let mut random = Lcg(12);
    let qp = Qp::random(&mut random, 5, 9, 1.0);
    let problem = paired(&qp, 6, &(0..15).collect::<Vec<_>>());
    let (dims, mut numbers) = (problem.dims, tables_of(&problem, true));
    for at in dims.tables_len()..numbers.len() {
        let kept = numbers[at];
        for wrong in [kept + 1e-9, -2.0 * kept - 1.0, f64::NAN, f64::INFINITY] {
            numbers[at] = wrong;
            assert!(Tables::from_slice(dims, &numbers).is_err(), "{at} {wrong}");
        }
        numbers[at] = kept;
    }
    assert!(Tables::from_slice(dims, &numbers).is_ok());
    let short = numbers.len() - 1;
    assert!(Tables::from_slice(dims, &numbers[..short]).is_err());
    // Tables are whole without their products.
    assert!(Tables::from_slice(dims, &numbers[..dims.tables_len()]).is_ok());
}
