//! Is what the regime says true? Everything here works on the dense problem and shares nothing with the solver.

use super::problem::Case;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus,
};
use mpct_runtime::banded::{BandedController, BandedTables};
use mpct_runtime::{Budget, Scalar, StepError, StepStatus};

pub type Controller<T> = BandedController<T, Vec<T>, Vec<u32>>;

pub fn controller<T: Scalar>(tables: &BandedTables<'_, T>) -> Controller<T> {
    // Garbage in the memory must not matter.
    let numbers = vec![T::NAN; tables.workspace_len()];
    let indices = vec![u32::MAX; tables.index_len()];
    BandedController::new(tables, numbers, indices).unwrap()
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    Optimal,
    Infeasible,
    /// A step that was cut short or failed: what came back instead of the optimum.
    Other,
}

/// One step in f64, everything claimed checked; with `reference` also against Clarabel.
pub fn step(
    case: &Case,
    tables: &BandedTables<'_, f64>,
    controller: &mut Controller<f64>,
    (x, r): (&[f64], &[f64]),
    budget: Budget<'_>,
    reference: bool,
) -> Answer {
    let found = controller.step(tables, x, r, budget).map(|s| {
        (
            s.status,
            s.cost,
            s.solution.to_vec(),
            s.input.to_vec(),
            s.violation,
        )
    });
    let (g, b, which) = case.one_sided(x);
    match found {
        Ok((status, cost, z, input, violation)) => {
            assert!(inside(case, &input), "input outside U: {input:?}");
            if status != StepStatus::Optimal {
                let worst = excess(&g, &b, &z);
                // The candidate may have been moved inside of the rows: then the violation is that of the plan, below tolerance.
                assert!(
                    worst <= 1e-9 && violation <= 1e-9
                        || (worst - violation).abs() <= 1e-9 * (1.0 + worst),
                    "says {violation:e}, is {worst:e}"
                );
                return Answer::Other;
            }
            let f = case.linear(x, r);
            let y = Case::spread(&which, controller.multipliers(tables));
            let v = mpct_runtime::verify(&case.h, &f, &g, &b, &z, &y).unwrap();
            // Rows that nearly cancel have multipliers far larger than the terms of the stationarity condition: y times a residual is
            // measured against y times a right-hand side there.
            let pull = y
                .iter()
                .zip(&b)
                .fold(v.scale, |m, (y, b)| m.max(y * b.abs().max(1.0)));
            // Likewise the stationarity condition: its sum cannot be more exact than its terms.
            let mut terms = vec![0.0_f64; case.nz];
            for (y, row) in y.iter().zip(g.chunks_exact(case.nz)) {
                for (t, g) in terms.iter_mut().zip(row) {
                    *t += (y * g).abs();
                }
            }
            let term = terms.iter().fold(v.scale, |m, &t| m.max(t));
            let worst = [
                v.primal,
                v.dual / v.scale,
                v.stationarity / term,
                v.complementarity / pull,
                v.gap / pull,
            ];
            assert!(worst.iter().all(|&w| w <= 1e-8), "{v:?} {pull:e}");
            if reference {
                let (status, best, z_ref) = clarabel(case, &f, &g, &b);
                assert!(
                    status != SolverStatus::PrimalInfeasible,
                    "Clarabel says infeasible"
                );
                if status == SolverStatus::Solved {
                    let size = 1.0 + best.abs();
                    assert!((cost - best).abs() <= 1e-6 * size, "{cost} {best}");
                    let difference: Vec<f64> = z.iter().zip(&z_ref).map(|(a, b)| a - b).collect();
                    let energy = quadratic(&case.h, &difference);
                    assert!(energy <= 1e-6 * size, "{energy:e} {size:e}");
                }
            }
            Answer::Optimal
        }
        Err(StepError::Infeasible { radius }) => {
            assert!(radius >= 1e6);
            let y = Case::spread(&which, controller.proof(tables));
            let margin = farkas(case.nz, &g, &b, &y);
            if reference && margin > 1e-6 {
                let (status, ..) = clarabel(case, &case.linear(x, r), &g, &b);
                assert!(
                    status != SolverStatus::Solved,
                    "Clarabel solved it; margin {margin:e}"
                );
            }
            Answer::Infeasible
        }
        Err(StepError::NoCandidate { .. }) => Answer::Other,
        Err(other) => panic!("{other:?}"),
    }
}

/// Checks that `y` proves that no z with ‖z‖₁ ≤ 1e6 satisfies the rows. Returns by how much every one of them violates some row.
pub fn farkas(nz: usize, g: &[f64], b: &[f64], y: &[f64]) -> f64 {
    let (mut image, mut bound, mut total) = (vec![0.0; nz], 0.0, 0.0);
    for (i, &y) in y.iter().enumerate() {
        assert!(y >= 0.0);
        for (k, to) in image.iter_mut().enumerate() {
            *to += y * g[i * nz + k];
        }
        bound += y * b[i];
        total += y;
    }
    let largest = image.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!(total > 0.0, "an empty proof");
    assert!(
        bound < 0.0 && 0.99e6 * largest <= -bound,
        "{largest:e} {bound:e}"
    );
    (-bound - 1e3 * largest) / total
}

pub fn excess(g: &[f64], b: &[f64], z: &[f64]) -> f64 {
    g.chunks(z.len())
        .zip(b)
        .map(|(row, b)| row.iter().zip(z).map(|(p, q)| p * q).sum::<f64>() - b)
        .fold(0.0, f64::max)
}

pub fn quadratic(h: &[f64], z: &[f64]) -> f64 {
    h.chunks(z.len())
        .zip(z)
        .map(|(row, zi)| zi * row.iter().zip(z).map(|(p, q)| p * q).sum::<f64>())
        .sum()
}

/// `½ zᵀHz + fᵀz`.
pub fn cost(h: &[f64], f: &[f64], z: &[f64]) -> f64 {
    0.5 * quadratic(h, z) + f.iter().zip(z).map(|(p, q)| p * q).sum::<f64>()
}

pub fn inside(case: &Case, input: &[f64]) -> bool {
    case.input_rows.chunks(case.m).all(|row| {
        // Written so that NaN is outside.
        row.iter().zip(input).map(|(p, q)| p * q).sum::<f64>() <= 1.0 + 1e-12
    })
}

fn clarabel(case: &Case, f: &[f64], g: &[f64], b: &[f64]) -> (SolverStatus, f64, Vec<f64>) {
    let nz = case.nz;
    let columns = |a: &[f64], rows: usize, upper: bool| {
        let (mut ptr, mut idx, mut val) = (vec![0], vec![], vec![]);
        for j in 0..nz {
            for i in 0..rows {
                let v = a[i * nz + j];
                if v != 0.0 && !(upper && i > j) {
                    idx.push(i);
                    val.push(v);
                }
            }
            ptr.push(idx.len());
        }
        CscMatrix::new(rows, nz, ptr, idx, val)
    };
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .build()
        .unwrap();
    let mut solver = DefaultSolver::new(
        &columns(&case.h, nz, true),
        f,
        &columns(g, b.len(), false),
        b,
        &[NonnegativeConeT(b.len())],
        settings,
    )
    .unwrap();
    solver.solve();
    let s = &solver.solution;
    (s.status, s.obj_val, s.x.clone())
}
