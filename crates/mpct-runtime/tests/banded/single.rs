//! The same problems in f32, against f64 and the dense rows.

use super::Walk;
use super::common::Lcg;
use super::judge::{self, Answer};
use super::problem::{Case, Kind, Owned};
use mpct_runtime::{Budget, StepError, StepStatus};

fn widened(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&v| f64::from(v)).collect()
}

/// (optimal, infeasible, other), worst violation and worst distance to f64 in energy, relative.
fn compare(
    seed: u64,
    rounds: usize,
    steps: usize,
    nasty: bool,
    drift: bool,
) -> ([usize; 3], f64, f64) {
    let mut random = Lcg(seed);
    let (mut counts, mut worst, mut far) = ([0; 3], 0.0_f64, 0.0_f64);
    for _ in 0..rounds {
        let mut kind = Kind::random(&mut random, 100);
        kind.nasty = nasty;
        (kind.decades, kind.conditioning) = (kind.decades.min(1.0), 2.0);
        let case = Case::random(&mut random, kind);
        let (single, double) = (Owned::<f32>::new(&case), Owned::<f64>::new(&case));
        let (single, double) = (single.tables().unwrap(), double.tables().unwrap());
        single.check_values().unwrap();
        let (mut a, mut b) = (judge::controller(&single), judge::controller(&double));
        let mut walk = Walk::new(&case);
        walk.advance(&mut random, &case, 2.0, 0.5, 1000);
        let slope: Vec<f64> = (0..case.nr).map(|_| 1e-4 * random.signed()).collect();
        for _ in 0..steps {
            if drift {
                walk.r.iter_mut().zip(&slope).for_each(|(r, s)| *r += s);
            } else {
                walk.advance(&mut random, &case, 2.0, 0.5, 4);
            }
            let x: Vec<f32> = walk.x.iter().map(|&v| v as f32).collect();
            let r: Vec<f32> = walk.r.iter().map(|&v| v as f32).collect();
            let (xd, rd) = (widened(&x), widened(&r));
            let truth = judge::step(
                &case,
                &double,
                &mut b,
                (&xd, &rd),
                Budget::unlimited(),
                false,
            );
            match a.step(&single, &x, &r, Budget::unlimited()) {
                Ok(step) if step.status == StepStatus::Optimal => {
                    counts[0] += 1;
                    let z = widened(step.solution);
                    let (rows, bounds, _) = case.one_sided(&xd);
                    worst = worst.max(judge::excess(&rows, &bounds, &z));
                    assert!(judge::inside(
                        &case,
                        &widened(step.input)
                            .iter()
                            .map(|u| u / (1.0 + 1e-6))
                            .collect::<Vec<_>>()
                    ));
                    if truth == Answer::Optimal && !nasty {
                        let best = b.step(&double, &xd, &rd, Budget::unlimited()).unwrap();
                        let apart: Vec<f64> =
                            z.iter().zip(best.solution).map(|(p, q)| p - q).collect();
                        let size = judge::quadratic(&case.h, best.solution);
                        far = far.max((judge::quadratic(&case.h, &apart) / (1.0 + size)).sqrt());
                    }
                }
                Err(StepError::Infeasible { .. }) => {
                    counts[1] += 1;
                    assert_ne!(truth, Answer::Optimal, "f32 disproves what f64 solves");
                }
                Ok(_) | Err(StepError::NoCandidate { .. }) => counts[2] += 1,
                Err(other) => panic!("{other:?}"),
            }
        }
    }
    println!("f32: {counts:?}, violation {worst:e}, distance {far:e}");
    (counts, worst, far)
}

#[test]
fn sane_problems() {
    let ([optimal, infeasible, other], worst, far) = compare(51, 60, 12, false, false);
    assert!(
        optimal > 700 && infeasible == 0 && other == 0,
        "{optimal} {infeasible} {other}"
    );
    assert!(worst < 1e-4 && far < 1e-3, "{worst:e} {far:e}");
}

/// Changes below the last place of what they are added to must be seen in the end.
#[test]
fn slow_drift() {
    let ([optimal, _, other], worst, _) = compare(52, 6, 3000, false, true);
    assert!(optimal > 17_000 && other == 0, "{optimal} {other}");
    assert!(worst < 1e-4, "{worst:e}");
}

#[test]
fn nasty_problems() {
    // Gaps of 1e-6 are below what f32 can tell from none: it may give up there.
    let ([optimal, _, other], worst, _) = compare(53, 60, 12, true, false);
    assert!(other * 50 < optimal, "{optimal} {other}");
    assert!(worst < 1e-3, "{worst:e}");
}
