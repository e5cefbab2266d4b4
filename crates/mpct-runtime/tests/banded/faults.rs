//! Faults: nothing panics, nothing is poisoned, and the same inputs give the same bits whatever happened before.

use super::judge::{self, Answer, Controller};
use super::problem::{Case, Kind, Owned};
use super::{Walk, common::Lcg};
use mpct_runtime::banded::{BandedController, BandedTables};
use mpct_runtime::{Budget, StepError};

const KIND: Kind = Kind {
    blocks: 12,
    size: 3,
    width: 1,
    decades: 1.0,
    conditioning: 2.0,
    nasty: true,
};

fn case(seed: u64) -> Case {
    Case::random(&mut Lcg(seed), KIND)
}

/// What a step returned, bit for bit.
fn bits(
    controller: &mut Controller<f64>,
    tables: &BandedTables<'_, f64>,
    x: &[f64],
    r: &[f64],
    budget: Budget<'_>,
) -> Vec<u64> {
    match controller.step(tables, x, r, budget) {
        Ok(step) => {
            let mut out: Vec<u64> = step.solution.iter().map(|v| v.to_bits()).collect();
            out.extend(step.input.iter().map(|v| v.to_bits()));
            out.extend([step.cost, step.violation, step.stationarity].map(f64::to_bits));
            out.push(u64::from(step.iterations));
            out.extend(
                controller
                    .multipliers(tables)
                    .map(|e| e.0 as u64 ^ e.1.to_bits()),
            );
            out
        }
        Err(StepError::Infeasible { radius }) => vec![1, radius.to_bits()],
        Err(StepError::NoCandidate { .. }) => vec![2],
        Err(other) => panic!("{other:?}"),
    }
}

#[test]
fn same_bits_after_a_reset() {
    let mut random = Lcg(31);
    let mut optimal = 0;
    for seed in 0..20 {
        let case = case(seed);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        let (mut old, mut walk) = (judge::controller(&tables), Walk::new(&case));
        for k in 0..30 {
            walk.advance(&mut random, &case, 3.0, 2.0, 4);
            let budget = Budget::iterations([u32::MAX, 3, 0][k % 3]);
            bits(&mut old, &tables, &walk.x, &walk.r, budget);
        }
        let _ = old.step(&tables, &vec![1e300; case.n], &walk.r, Budget::unlimited());
        old.reset(&tables);
        let mut fresh = BandedController::new(
            &tables,
            vec![0.0; tables.workspace_len()],
            vec![0; tables.index_len()],
        )
        .unwrap();
        for k in 0..10 {
            walk.advance(&mut random, &case, 3.0, 0.5, 4);
            let limit = [u32::MAX, 7, u32::MAX, 0][k % 4];
            let [a, b] = [&mut old, &mut fresh]
                .map(|c| bits(c, &tables, &walk.x, &walk.r, Budget::iterations(limit)));
            assert_eq!(a, b, "problem {seed}, step {k}");
            optimal += usize::from(a.len() > case.nz);
        }
    }
    assert!(optimal > 100);
}

/// After each fault one step within reach must give the optimum.
#[test]
fn one_bad_step_does_not_poison_the_next() {
    let mut random = Lcg(32);
    for seed in 40..60 {
        let case = case(seed);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        let mut controller = judge::controller(&tables);
        let mut walk = Walk::new(&case);
        for fault in 0..40 {
            let (mut x, mut r) = (walk.x.clone(), walk.r.clone());
            let (i, j) = (random.below(case.n), random.below(case.nr));
            let huge = [1e9, 1e30, 1e155, 1e200, 1e300, f64::MAX][random.below(6)];
            match fault % 10 {
                0 => x[i] = [f64::NAN, f64::INFINITY, -f64::INFINITY][random.below(3)],
                1 => r[j] = [f64::NAN, f64::INFINITY, -f64::INFINITY][random.below(3)],
                2 => x[i] = huge,
                3 => r[j] = huge,
                4 => x.fill(-huge),
                5 => r.fill(huge),
                6 => x.truncate(random.below(case.n)),
                7 => r.push(0.0),
                _ => x.iter_mut().for_each(|v| *v = 1e3 * random.signed()),
            }
            let mut asked = 0;
            let after = random.below(20);
            let mut clock = || {
                asked += 1;
                asked > after
            };
            let budget = match random.below(4) {
                0 => Budget::unlimited().until(&mut clock),
                1 => Budget::iterations(random.below(30) as u32),
                _ => Budget::unlimited(),
            };
            match (fault % 10, controller.step(&tables, &x, &r, budget)) {
                (0, Err(StepError::StateNotFinite { index })) => assert_eq!(index, i),
                (1, Err(StepError::SetPointNotFinite { index })) => assert_eq!(index, j),
                (6 | 7, Err(StepError::WrongLength { .. })) => {}
                (0 | 1 | 6 | 7, other) => panic!("{other:?}"),
                (_, Ok(step)) => {
                    assert!(judge::inside(&case, step.input), "{:?}", step.input);
                    assert!(step.solution.iter().all(|v| v.is_finite()));
                }
                (_, Err(StepError::Infeasible { .. } | StepError::NoCandidate { .. })) => {}
                (_, Err(other)) => panic!("{other:?}"),
            }
            walk.advance(&mut random, &case, 1.0, 0.5, 1000);
            let at = (walk.x.as_slice(), walk.r.as_slice());
            let answer = judge::step(
                &case,
                &tables,
                &mut controller,
                at,
                Budget::unlimited(),
                false,
            );
            assert_eq!(answer, Answer::Optimal, "problem {seed}, fault {fault}");
        }
    }
}

#[test]
fn every_budget_ends_with_something_true() {
    let mut random = Lcg(33);
    let (mut optimal, mut other) = (0, 0);
    for seed in 70..80 {
        let case = case(seed);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        let mut controller = judge::controller(&tables);
        let mut walk = Walk::new(&case);
        for limit in 0..60 {
            walk.advance(&mut random, &case, 2.0, 0.5, 1000);
            let at = (walk.x.as_slice(), walk.r.as_slice());
            let mut stop = || true;
            let budget = if limit % 7 == 6 {
                Budget::unlimited().until(&mut stop)
            } else {
                Budget::iterations(limit)
            };
            match judge::step(&case, &tables, &mut controller, at, budget, false) {
                Answer::Optimal => optimal += 1,
                _ => other += 1,
            }
            if limit % 3 == 0 {
                let answer = judge::step(
                    &case,
                    &tables,
                    &mut controller,
                    at,
                    Budget::unlimited(),
                    false,
                );
                assert_eq!(answer, Answer::Optimal);
            }
        }
    }
    assert!(optimal > 50 && other > 50, "{optimal} {other}");
}

#[test]
fn wrong_memory_is_refused() {
    let owned = Owned::<f64>::new(&case(3));
    let tables = owned.tables().unwrap();
    let (n, i) = (tables.workspace_len(), tables.index_len());
    for (numbers, indices) in [(n - 1, i), (n + 1, i), (n, i - 1), (n, i + 1), (0, 0)] {
        assert!(BandedController::new(&tables, vec![0.0; numbers], vec![0; indices]).is_err());
    }
}

/// Steps with tables that the memory was not made for, among them such of the same sizes and such of the same length.
#[test]
fn other_tables_do_not_panic() {
    let mut random = Lcg(34);
    let small = Kind {
        blocks: 3,
        size: 2,
        ..KIND
    };
    let all: Vec<(Case, Owned<f64>)> = (0..40)
        .map(|seed| {
            let kind = if seed % 2 == 0 { KIND } else { small };
            let case = Case::random(&mut random, kind);
            let owned = Owned::new(&case);
            (case, owned)
        })
        .collect();
    let mut refused = 0;
    for (case, owned) in &all {
        let tables = owned.tables().unwrap();
        for (other_case, other) in &all {
            let mut controller = judge::controller(&tables);
            for tables in [owned.tables().unwrap(), other.tables().unwrap()] {
                let longest = case.nz.max(other_case.nz);
                let (x, r) = (
                    vec![0.3; tables.states()],
                    vec![2.0; tables.set_point().min(longest)],
                );
                let result = controller.step(&tables, &x, &r, Budget::unlimited());
                refused += usize::from(matches!(result, Err(StepError::WrongLength { .. })));
                assert!(controller.multipliers(&tables).count() <= tables.pairs());
                assert!(controller.proof(&tables).count() <= tables.pairs());
            }
        }
        // The same sizes, other numbers and windows.
        let mut controller = judge::controller(&tables);
        let x = vec![0.3; case.n];
        let _ = controller.step(&tables, &x, &vec![3.0; case.nr], Budget::unlimited());
        for _ in 0..10 {
            let mut other = owned.clone();
            for _ in 0..1 + random.below(4) {
                let h = &mut other.windows[3];
                let row = random.below(h.first.len());
                h.first[row] = h.first[row].saturating_sub(random.below(3) as u32);
            }
            let Ok(other) = other.tables() else { continue };
            let r: Vec<f64> = (0..case.nr).map(|_| 3.0 * random.signed()).collect();
            let _ = controller.step(&other, &x, &r, Budget::unlimited());
        }
    }
    assert!(refused > 1000);
}

/// Every index array altered at random: refused, or no step panics.
#[test]
fn damaged_tables() {
    let mut random = Lcg(35);
    let (mut refused, mut accepted) = (0, 0);
    for _ in 0..10 {
        let case = Case::random(&mut random, Kind { blocks: 5, ..KIND });
        let sound = Owned::<f64>::new(&case);
        for trial in 0..600 {
            let mut owned = sound.clone();
            damage(&mut random, &mut owned, trial % 20);
            let Ok(tables) = owned.tables() else {
                refused += 1;
                continue;
            };
            accepted += 1;
            let _ = tables.check_values();
            let mut controller = judge::controller(&tables);
            for k in 0..3 {
                let x = vec![0.4 * random.signed(); tables.states()];
                let r = vec![f64::from(k); tables.set_point()];
                let _ = controller.step(&tables, &x, &r, Budget::unlimited());
                let _ = controller.multipliers(&tables).count();
                let _ = controller.proof(&tables).count();
            }
        }
    }
    assert!(refused > 2000 && accepted > 500, "{refused} {accepted}");
}

fn damage(random: &mut Lcg, owned: &mut Owned<f64>, which: usize) {
    let value = match random.below(4) {
        0 => random.below(9) as u32,
        1 => u32::MAX - random.below(3) as u32,
        _ => random.below(60) as u32,
    };
    let other = match random.below(3) {
        0 => f64::NAN,
        1 => [f64::INFINITY, -1.0, 0.0, 1e300, -1e-300][random.below(5)],
        _ => 100.0 * random.signed(),
    };
    let at = |random: &mut Lcg, len: usize| random.below(len.max(1));
    match which {
        0..8 => {
            let w = &mut owned.windows[which];
            let (i, j) = (at(random, w.first.len()), at(random, w.start.len()));
            match random.below(3) {
                0 => w.first[i] = value,
                1 => w.start[j] = value,
                _ => {
                    // A window that is shorter by one, consistently.
                    for s in &mut w.start[i + 1..] {
                        *s = s.saturating_sub(1);
                    }
                    w.values.pop();
                }
            }
        }
        8..12 => {
            let w = &mut owned.windows[random.below(8)];
            if !w.values.is_empty() {
                let i = at(random, w.values.len());
                w.values[i] = other;
            }
        }
        12 => owned.windows[random.below(8)].columns = value as usize,
        13 => {
            let i = at(random, owned.groups.len());
            owned.groups[i] = value;
        }
        14 => {
            let i = at(random, owned.state_order.len());
            owned.state_order[i] = value;
        }
        15 => {
            let i = at(random, owned.set_point_order.len());
            owned.set_point_order[i] = value;
        }
        16 => {
            let i = at(random, owned.next_stage.len());
            owned.next_stage[i] = value;
        }
        17 => {
            let i = at(random, owned.scale.len());
            owned.scale[i] = other;
        }
        18 => {
            let i = at(random, owned.upper.len());
            (owned.upper[i], owned.lower[i]) = (other, f64::INFINITY);
        }
        _ => match random.below(5) {
            0 => drop(owned.upper.pop()),
            1 => drop(owned.scale.pop()),
            2 => drop(owned.groups.pop()),
            3 => drop(owned.next_stage.pop()),
            _ => drop(owned.state_order.pop()),
        },
    }
}

/// What the checks must find.
#[test]
fn checks_find_what_they_name() {
    let case = case(5);
    let sound = Owned::<f64>::new(&case);
    sound.tables().unwrap().check_values().unwrap();
    type Spoil = fn(&mut Owned<f64>);
    let shapes: [Spoil; 12] = [
        |o| o.state_order[0] = o.state_order[1],
        |o| o.set_point_order[0] = u32::MAX,
        |o| o.next_stage[2] = o.next_stage.len() as u32,
        |o| o.groups[0] = 1,
        |o| *o.groups.last_mut().unwrap() -= 1,
        |o| o.groups.insert(1, u32::MAX / 2),
        |o| o.groups.clear(),
        |o| o.windows[0].first[3] = 2,
        |o| *o.windows[3].first.last_mut().unwrap() = 0,
        |o| *o.windows[4].first.last_mut().unwrap() = u32::MAX,
        |o| o.lower.truncate(1),
        |o| o.windows[6].values.truncate(1),
    ];
    for (k, spoil) in shapes.iter().enumerate() {
        let mut owned = sound.clone();
        spoil(&mut owned);
        assert!(owned.tables().is_err(), "shape {k}");
    }
    for k in 0..8 {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut owned = sound.clone();
            owned.windows[k].values[0] = bad;
            assert!(
                owned.tables().unwrap().check_values().is_err(),
                "values {k}"
            );
        }
    }
    let values: [Spoil; 6] = [
        |o| o.upper[0] = f64::NAN,
        |o| o.lower[0] = 0.0,
        |o| o.upper[1] = -1.0,
        |o| o.scale[0] = 3.0,
        |o| o.scale[0] = f64::INFINITY,
        |o| o.windows[0].values[0] = -1.0,
    ];
    for (k, spoil) in values.iter().enumerate() {
        let mut owned = sound.clone();
        spoil(&mut owned);
        assert!(owned.tables().unwrap().check_values().is_err(), "value {k}");
    }
}

/// The step after a state of 1e300 answers as a controller does that never saw it: what such a state leaves behind, numbers of 1e299, would
/// round away everything.
#[test]
fn a_state_beyond_all_numbers_leaves_nothing_behind() {
    let mut random = Lcg(41);
    let (mut optimal, mut proved) = (0, 0);
    for seed in 0..400 {
        let kind = Kind::random(&mut random, 60);
        let state = [0.2, 1.0, 5.0, 50.0][random.below(4)];
        let case = Case::random(&mut random, kind);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        let (mut old, mut walk) = (judge::controller(&tables), Walk::new(&case));
        for _ in 0..4 {
            walk.advance(&mut random, &case, 10.0, state, 4);
            let _ = old.step(&tables, &walk.x, &walk.r, Budget::unlimited());
            let mut x = walk.x.clone();
            x[random.below(case.n)] = [1e300, -1e200, 1e30, 1e12][random.below(4)];
            let _ = old.step(&tables, &x, &walk.r, Budget::unlimited());
            let [after, fresh] = [&mut old, &mut judge::controller(&tables)].map(|c| {
                let at = (walk.x.as_slice(), walk.r.as_slice());
                judge::step(&case, &tables, c, at, Budget::unlimited(), false)
            });
            assert_eq!(after, fresh, "problem {seed}");
            optimal += usize::from(after == Answer::Optimal);
            proved += usize::from(after == Answer::Infeasible);
        }
    }
    assert!(optimal > 300 && proved > 20, "{optimal} {proved}");
}
