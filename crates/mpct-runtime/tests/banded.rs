//! The banded regime: random problems against Clarabel and the independent checker, the same bits, faults, the candidate.

mod common;

#[path = "banded/candidate.rs"]
mod candidate;
#[path = "banded/faults.rs"]
mod faults;
#[path = "banded/judge.rs"]
mod judge;
#[path = "banded/problem.rs"]
mod problem;
#[path = "banded/single.rs"]
mod single;

use common::Lcg;
use judge::Answer;
use mpct_runtime::Budget;
use problem::{Case, Kind, Owned};

/// A state and a set-point that drift and jump.
struct Walk {
    x: Vec<f64>,
    r: Vec<f64>,
}

impl Walk {
    fn new(case: &Case) -> Self {
        Self {
            x: vec![0.0; case.n],
            r: vec![0.0; case.nr],
        }
    }

    /// `amplitude` of f; `state` of x; `squeeze` how often a state that closes gaps is near 1.
    fn advance(
        &mut self,
        random: &mut Lcg,
        case: &Case,
        amplitude: f64,
        state: f64,
        squeeze: usize,
    ) {
        let jump = random.below(4) == 0;
        for (table, &at) in case.state_order.iter().enumerate() {
            let x = &mut self.x[at as usize];
            if table % 2 == 1 {
                if jump || random.below(10) == 0 {
                    *x = if random.below(squeeze) == 0 {
                        [1.0, 0.999, 1.0 - 1e-5][random.below(3)]
                    } else {
                        0.0
                    };
                }
            } else if jump {
                *x = state * random.signed();
            } else {
                *x += 0.02 * state * random.signed();
            }
        }
        for r in &mut self.r {
            if jump {
                *r = amplitude * random.signed();
            } else {
                *r += 0.02 * amplitude * random.signed();
            }
        }
    }
}

/// Random sequences; returns (optimal, infeasible, other).
fn sequences(seed: u64, rounds: usize, largest: usize, sane: bool, reference: usize) -> [usize; 3] {
    let mut random = Lcg(seed);
    let mut counts = [0; 3];
    for round in 0..rounds {
        let mut kind = Kind::random(&mut random, largest);
        if sane {
            (kind.nasty, kind.conditioning) = (false, 2.0);
        }
        let case = Case::random(&mut random, kind);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        tables.check_values().unwrap();
        let mut controller = judge::controller(&tables);
        let mut walk = Walk::new(&case);
        let amplitude = 10.0_f64.powf(random.signed());
        let state = if sane || random.below(2) == 0 {
            0.5
        } else {
            5.0
        };
        for k in 0..8 {
            walk.advance(&mut random, &case, amplitude, state, 4);
            let at = (walk.x.as_slice(), walk.r.as_slice());
            let with_reference = (8 * round + k) % reference == 0;
            let answer = judge::step(
                &case,
                &tables,
                &mut controller,
                at,
                Budget::unlimited(),
                with_reference,
            );
            if answer == Answer::Other {
                println!("round {round} step {k}: {kind:?} amplitude {amplitude} state {state}");
            }
            counts[answer as usize] += 1;
        }
    }
    println!("optimal, infeasible, other: {counts:?}");
    counts
}

#[test]
fn regular_problems() {
    let [optimal, infeasible, other] = sequences(1, 60, 200, true, 5);
    assert!(
        optimal > 400 && infeasible == 0 && other == 0,
        "{optimal} {infeasible} {other}"
    );
}

#[test]
fn nasty_problems() {
    let [optimal, infeasible, other] = sequences(2, 120, 120, false, 5);
    assert!(
        optimal > 200 && infeasible > 50 && other == 0,
        "{optimal} {infeasible} {other}"
    );
}

#[test]
fn large_problems() {
    let [optimal, _, other] = sequences(3, 8, 400, false, 16);
    assert!(optimal > 10 && other == 0, "{optimal} {other}");
}

/// Everything mixed: drifts and jumps, states on the border and outside of what is feasible, faults, budgets from 0 up, resets.
#[test]
#[ignore = "slow: 1e6 random steps, minutes, each checked densely"]
fn soak() {
    let mut random = Lcg(77);
    let (mut counts, mut failed, mut steps) = ([0; 3], 0, 0);
    while steps < 1_000_000 {
        let kind = Kind::random(&mut random, 80);
        let case = Case::random(&mut random, kind);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        tables.check_values().unwrap();
        let mut controller = judge::controller(&tables);
        let mut walk = Walk::new(&case);
        let amplitude = 10.0_f64.powf(2.0 * random.signed());
        let state = [0.2, 1.0, 5.0, 50.0][random.below(4)];
        for _ in 0..50 {
            steps += 1;
            walk.advance(&mut random, &case, amplitude, state, 4);
            let at = (walk.x.as_slice(), walk.r.as_slice());
            match random.below(40) {
                0 => controller.reset(&tables),
                1 => {
                    let mut x = walk.x.clone();
                    x[0] = [f64::NAN, 1e300, -f64::MAX, f64::INFINITY][random.below(4)];
                    if let Ok(step) = controller.step(&tables, &x, &walk.r, Budget::unlimited()) {
                        assert!(judge::inside(&case, step.input));
                    }
                }
                _ => {}
            }
            let limit = random.below(60);
            let mut left = limit;
            let mut clock = || {
                left = left.saturating_sub(1);
                left == 0
            };
            let (budget, is_limited) = match random.below(6) {
                0 => (Budget::iterations(limit as u32), true),
                1 => (Budget::unlimited().until(&mut clock), true),
                _ => (Budget::unlimited(), false),
            };
            let reference = steps % 100 == 0;
            let answer = judge::step(&case, &tables, &mut controller, at, budget, reference);
            if answer == Answer::Other && !is_limited {
                failed += 1;
                println!("step {steps}: {kind:?}, f {amplitude:e}, x {state:e}");
            }
            counts[answer as usize] += 1;
        }
    }
    println!(
        "{steps} steps: optimal, infeasible, other {counts:?}; not limited and yet neither: {failed}"
    );
    assert!(counts.iter().all(|&c| c > 50_000), "{counts:?}");
    // Problems that are infeasible by less than about 1e-7 are neither solved nor proved.
    assert!(failed * 10_000 <= steps, "{failed} of {steps}");
}
