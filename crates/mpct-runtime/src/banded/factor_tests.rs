//! Updates, downdates and solutions against dense arithmetic.

use super::super::test_problem::{Arrays, INDICES, Lcg, NUMBERS, NZ, PAIRS};
use super::super::workspace::{Parts, divide};
use crate::banded::BandedTables;

type Dense = [[f64; NZ]; NZ];

/// H + Σ ρᵢ gᵢgᵢᵀ.
fn dense(tables: &BandedTables<'_, f64>, weights: &[f64; PAIRS]) -> Dense {
    let mut out = [[0.0; NZ]; NZ];
    for v in 0..NZ {
        for (w, &h) in tables
            .data
            .hessian
            .window(v)
            .zip(tables.data.hessian.row(v))
        {
            (out[v][w], out[w][v]) = (h, h);
        }
    }
    for (i, &weight) in weights.iter().enumerate() {
        let (at, row) = (tables.data.rows.window(i), tables.data.rows.row(i));
        for (v, g) in at.clone().zip(row) {
            for (w, k) in at.clone().zip(row) {
                out[v][w] += weight * g * k;
            }
        }
    }
    out
}

/// ‖L D Lᵀ − A‖ entry by entry, relative to the square root of the diagonal of H; `beyond` what the weights allow.
fn difference(parts: &Parts<'_, f64>, a: &Dense) -> f64 {
    let f = &parts.factor;
    let lower = |i: usize, j: usize| -> f64 {
        match i {
            _ if i == j => 1.0,
            _ if i > j && i < f.end[j] as usize => f.lower[f.start[j] as usize + i - j - 1],
            _ => 0.0,
        }
    };
    let mut worst = 0.0_f64;
    for i in 0..NZ {
        for j in 0..=i {
            let product: f64 = (0..=j)
                .map(|k| lower(i, k) * f.diagonal[k] * lower(j, k))
                .sum();
            worst = worst.max((product - a[i][j]).abs() / (parts.unit[i] * parts.unit[j]));
        }
    }
    worst
}

#[test]
fn updates_are_those_of_the_dense_matrix() {
    let (mut random, mut refused) = (Lcg(1), 0);
    for trial in 0..12 {
        let arrays = Arrays::random(
            &mut random,
            trial % 4,
            [9.5, 30.0, 300.0][trial as usize % 3],
        );
        let tables = arrays.tables();
        let (mut numbers, mut indices) = ([f64::NAN; NUMBERS], [u32::MAX; INDICES]);
        let (n, i) = (tables.workspace_len(), tables.index_len());
        let mut parts = divide(&tables, &mut numbers[..n], &mut indices[..i]).unwrap();
        parts.clear(&tables);
        let d = &tables.data;
        assert!(parts.factor.compute(&d.hessian, &d.rows, &[], parts.stiff));
        let mut weights = [0.0; PAIRS];
        assert!(difference(&parts, &dense(&tables, &weights)) < 1e-12);
        for change in 0..150 {
            let pair = random.below(PAIRS);
            let weight = if weights[pair] > 0.0 {
                -weights[pair]
            } else {
                [1.0, 1e2, 1e5][random.below(3)]
            };
            if !parts.factor.update(&d.rows, pair, weight, parts.scratch) {
                // Spoilt: computed afresh, as the solver does.
                refused += 1;
                weights[pair] += weight;
                let mut active = [0; PAIRS];
                let mut count = 0;
                for (k, &w) in weights.iter().enumerate() {
                    if w > 0.0 {
                        (active[count], parts.stiff[k]) = (k as u32, w);
                        count += 1;
                    }
                }
                let (active, stiff) = (&active[..count], &*parts.stiff);
                assert!(parts.factor.compute(&d.hessian, &d.rows, active, stiff));
            } else {
                weights[pair] += weight;
            }
            assert!(parts.scratch.iter().all(|&s| s == 0.0));
            if change % 30 == 29 {
                let found = difference(&parts, &dense(&tables, &weights));
                // 1e5 times the rounding of each change.
                assert!(found < 1e-8, "trial {trial}, change {change}: {found:e}");
            }
        }
    }
    assert!(refused < 100, "{refused}");
}

#[test]
fn a_pivot_that_vanishes_is_reported() {
    let arrays = Arrays::random(&mut Lcg(2), 0, 9.5);
    let tables = arrays.tables();
    let (mut numbers, mut indices) = ([0.0; NUMBERS], [0; INDICES]);
    let (n, i) = (tables.workspace_len(), tables.index_len());
    let mut parts = divide(&tables, &mut numbers[..n], &mut indices[..i]).unwrap();
    parts.clear(&tables);
    let d = &tables.data;
    assert!(parts.factor.compute(&d.hessian, &d.rows, &[], parts.stiff));
    for weight in [-1e3, f64::NAN, f64::INFINITY] {
        assert!(!parts.factor.update(&d.rows, 50, weight, parts.scratch));
        assert!(parts.scratch.iter().all(|&s| s == 0.0));
        assert!(parts.factor.compute(&d.hessian, &d.rows, &[], parts.stiff));
    }
    let weights = [0.0; PAIRS];
    assert!(difference(&parts, &dense(&tables, &weights)) < 1e-12);
}

/// Residuals of A x = b, in units of the variables.
fn residual(parts: &Parts<'_, f64>, a: &Dense, x: &[f64; NZ], b: &[f64; NZ]) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..NZ {
        let left: f64 = (0..NZ).map(|j| a[i][j] * x[j]).sum::<f64>() - b[i];
        worst = worst.max(left.abs() / parts.unit[i]);
    }
    worst
}

#[test]
fn solutions_are_those_of_the_dense_matrix() {
    let mut random = Lcg(3);
    let mut shorter = 0;
    for trial in 0..30 {
        let dominance = [9.5, 30.0, 300.0][trial as usize % 3];
        let arrays = Arrays::random(&mut random, trial % 4, dominance);
        let tables = arrays.tables();
        let (mut numbers, mut indices) = ([f64::NAN; NUMBERS], [u32::MAX; INDICES]);
        let (n, i) = (tables.workspace_len(), tables.index_len());
        let mut parts = divide(&tables, &mut numbers[..n], &mut indices[..i]).unwrap();
        parts.clear(&tables);
        let d = &tables.data;
        let mut weights = [0.0; PAIRS];
        let mut active = [0; 20];
        for (k, a) in active.iter_mut().enumerate() {
            *a = (10 * k + random.below(10)) as u32;
            weights[*a as usize] = parts.stiff[*a as usize];
        }
        assert!(
            parts
                .factor
                .compute(&d.hessian, &d.rows, &active, parts.stiff)
        );
        let a = dense(&tables, &weights);
        let mut b = [0.0; NZ];
        for (b, &u) in b.iter_mut().zip(parts.unit.iter()) {
            *b = random.signed() * u;
        }
        let mut x = b;
        parts.factor.solve(&mut x);
        // Terms of the size of ρ x.
        assert!(residual(&parts, &a, &x, &b) < 1e-9);
        for pair in (0..PAIRS).step_by(7) {
            let mut x = [f64::NAN; NZ];
            let range = parts.factor.solve_row(&d.rows, pair, &mut x);
            let at = d.rows.window(pair);
            assert!(range.start <= at.start && at.end <= range.end);
            assert!(x[range.clone()].iter().all(|v| v.is_finite()));
            shorter += usize::from(range.len() < NZ);
            x[..range.start].fill(0.0);
            x[range.end..].fill(0.0);
            let mut b = [0.0; NZ];
            b[at.clone()].copy_from_slice(d.rows.row(pair));
            let left = residual(&parts, &a, &x, &b);
            // What is left out, 2e-10 of the largest entry, appears times ρ = 1e5.
            assert!(left < 2e-5, "trial {trial}, pair {pair}: {left:e}");
        }
    }
    assert!(shorter > 100, "{shorter} truncated: the test must see some");
}
