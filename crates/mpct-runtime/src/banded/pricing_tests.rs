//! The bounds never hide a violated row: every answer against a look at all rows.

use super::super::test_problem::{Arrays, INDICES, Lcg, NUMBERS, NZ, PAIRS, STATES};
use super::super::workspace::divide;
use crate::Scalar;

#[test]
fn a_violated_row_is_found_whenever_there_is_one() {
    let mut random = Lcg(9);
    let (mut found, mut none, mut spared) = (0, 0, 0);
    for trial in 0..12 {
        let arrays = Arrays::random(&mut random, trial % 4, 9.5);
        let tables = arrays.tables();
        let (mut numbers, mut indices) = ([f64::NAN; NUMBERS], [u32::MAX; INDICES]);
        let (n, i) = (tables.workspace_len(), tables.index_len());
        let mut parts = divide(&tables, &mut numbers[..n], &mut indices[..i]).unwrap();
        let [_, widest] = parts.clear(&tables);
        let mut x = [0.0; STATES];
        for _ in 0..400 {
            // What the solver does between two answers.
            match random.below(8) {
                0 => {
                    let size = [1e-3, 1e-1, 1.0][random.below(3)];
                    x.iter_mut()
                        .for_each(|v| *v = 0.9 * *v + 0.1 * size * random.signed());
                    parts.measure_state(&tables, &x);
                }
                1 => {
                    // A row comes or goes.
                    let pair = random.below(PAIRS);
                    parts.side[pair] = u32::from(parts.side[pair] == 0);
                    parts.forget_row(&tables, pair);
                }
                2 => {
                    // The centre of an active row; it goes back to 0 when the row is not active.
                    let pair = random.below(PAIRS);
                    if parts.side[pair] != 0 {
                        parts.centre[pair] = 1e4 * random.signed();
                    } else {
                        parts.centre[pair] = 0.0;
                    }
                }
                _ => {
                    let from = random.below(NZ);
                    let to = (from + random.below(NZ / 2)).min(NZ);
                    let size = [1e-6, 1e-2, 0.5][random.below(3)];
                    let t = random.signed();
                    parts.direction.fill(f64::NAN);
                    for v in from..to {
                        parts.direction[v] =
                            size * random.signed() / parts.unit[v] - 0.01 * parts.z[v];
                        parts.z[v] += t * parts.direction[v];
                    }
                    parts.moved_variables(&tables, widest, from..to, t);
                }
            }
            let (mut worst, mut excesses) = (0.0, [f64::NEG_INFINITY; PAIRS]);
            for pair in (0..PAIRS).filter(|&p| parts.side[p] == 0) {
                let value: f64 = (0..STATES)
                    .filter(|s| tables.data.rows_state.window(pair).contains(s))
                    .map(|s| {
                        tables.data.rows_state.row(pair)
                            [s - tables.data.rows_state.window(pair).start]
                            * x[s]
                    })
                    .sum::<f64>()
                    + tables
                        .data
                        .rows
                        .window(pair)
                        .zip(tables.data.rows.row(pair))
                        .map(|(v, g)| g * parts.z[v])
                        .sum::<f64>();
                let centre = parts.centre[pair] / parts.stiff[pair];
                let bound = tables.data.upper[pair];
                let excess =
                    (value - bound + centre.max(0.0)).max(-value - bound + (-centre).max(0.0));
                excesses[pair] = excess;
                worst = f64::max(worst, excess - f64::PRIMAL);
            }
            let answer = parts.price(&tables).unwrap();
            spared += parts.moved.iter().filter(|&&m| m > 0.0).count();
            match answer {
                Some(row) => {
                    found += 1;
                    // Back towards a point at which all rows hold.
                    for v in 0..NZ {
                        parts.direction[v] = -0.7 * parts.z[v];
                        parts.z[v] += parts.direction[v];
                    }
                    parts.moved_variables(&tables, widest, 0..NZ, 1.0);
                    x.iter_mut().for_each(|v| *v *= 0.5);
                    parts.measure_state(&tables, &x);
                    parts.centre.fill(0.0);
                    assert_eq!(parts.side[row.pair], 0);
                    assert!(
                        row.by > f64::PRIMAL && (row.by - excesses[row.pair]).abs() < 1e-12,
                        "{row:?} {worst}"
                    );
                }
                None => {
                    none += 1;
                    assert!(worst < 1e-12, "{worst:e}");
                }
            }
        }
    }
    assert!(found > 300 && none > 500, "{found} {none}");
    // Otherwise nothing was hidden that could have been missed.
    assert!(spared > 5000, "{spared}");
}

/// What is not a number is an error and not a row that holds.
#[test]
fn not_a_number_is_found() {
    let arrays = Arrays::random(&mut Lcg(4), 0, 9.5);
    let tables = arrays.tables();
    let (mut numbers, mut indices) = ([0.0; NUMBERS], [0; INDICES]);
    let (n, i) = (tables.workspace_len(), tables.index_len());
    for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
        let mut parts = divide(&tables, &mut numbers[..n], &mut indices[..i]).unwrap();
        let [_, widest] = parts.clear(&tables);
        assert!(matches!(parts.price(&tables), Ok(None)));
        parts.direction[60] = bad;
        parts.z[60] += bad;
        parts.moved_variables(&tables, widest, 60..61, 1.0);
        assert!(parts.price(&tables).is_err(), "{bad}");
    }
}
