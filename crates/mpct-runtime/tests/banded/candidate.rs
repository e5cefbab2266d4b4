//! Real controllers in the banded regime: the candidate of Theorems 3 and 4, and the dense regime as oracle.

use super::common::{self, Lcg, Mat, Plant, Problem};
use super::judge;
use super::problem::{Case, Owned};
use mpct_runtime::{Budget, NO_ROW, StepError, StepStatus, Why, Workspace, prepare};

/// Three carts between springs and dampers, as in section 4.2 of the paper; constants of the project.
fn carts(count: usize) -> Problem {
    let (n, m, step, spring, damper, force) = (2 * count, count, 0.02, 0.5, 0.2, 50.0);
    let size = n + m;
    let mut a = Mat::zeros(size, size);
    let mut m_u = Mat::zeros(m, m);
    for i in 0..count {
        a.set(2 * i, 2 * i + 1, 1.0);
        a.set(2 * i + 1, n + i, force);
        for other in [i.wrapping_sub(1), i + 1] {
            if other >= count {
                continue;
            }
            for (state, own, by) in [(0, 2 * i, spring), (1, 2 * i + 1, damper)] {
                let (v, w) = (
                    a.at(2 * i + 1, own) - by,
                    a.at(2 * i + 1, 2 * other + state) + by,
                );
                a.set(2 * i + 1, own, v);
                a.set(2 * i + 1, 2 * other + state, w);
            }
            let (v, w) = (
                m_u.at(i, i) + spring / force,
                m_u.at(i, other) - spring / force,
            );
            m_u.set(i, i, v);
            m_u.set(i, other, w);
        }
    }
    let (mut power, mut sum) = (Mat::identity(size), Mat::identity(size));
    for k in 1..20 {
        power = power.mul(&a).scaled(step / f64::from(k));
        sum = sum.add(&power, 1.0);
    }
    let (mut ad, mut bd, mut m_x) = (Mat::zeros(n, n), Mat::zeros(n, m), Mat::zeros(n, m));
    for i in 0..n {
        for j in 0..n {
            ad.set(i, j, sum.at(i, j));
        }
        for j in 0..m {
            bd.set(i, j, sum.at(i, n + j));
        }
    }
    for i in 0..m {
        m_x.set(2 * i, i, 1.0);
    }
    let plant = Plant {
        a: ad,
        b: bd,
        x_max: [4.0, 1.0].repeat(count),
        u_max: vec![1.0; m],
        m_x,
        m_u,
        q: 1.0,
        r: 20.0,
        o: 1e4,
    };
    common::condense(plant, 5, 14, 0.9)
}

/// The same problem with its variables by subsystem and states and set-point in an order of their own. Also which variable of the dense
/// regime stands where.
fn banded(p: &Problem, random: &mut Lcg) -> (Case, Vec<usize>) {
    let (n, m, nr, nz) = (
        p.dims.states,
        p.dims.inputs,
        p.dims.set_point,
        p.dims.variables(),
    );
    let stages = p.dims.horizon;
    let order: Vec<usize> = (0..m)
        .flat_map(|i| (0..=stages).map(move |j| j * m + i))
        .collect();
    let place = |v: usize| order.iter().position(|&o| o == v).unwrap() as u32;
    let mix = |random: &mut Lcg, count: usize| -> Vec<u32> {
        let mut out: Vec<u32> = (0..count as u32).collect();
        for k in (1..count).rev() {
            out.swap(k, random.below(k + 1));
        }
        out
    };
    let (state_order, set_point_order) = (mix(random, n), mix(random, nr));
    let columns = |a: &[f64], cols: usize, to: &[u32]| -> Vec<f64> {
        a.chunks(cols)
            .flat_map(|row| to.iter().map(|&j| row[j as usize]).collect::<Vec<_>>())
            .collect()
    };
    let rows = |a: &[f64], cols: usize| -> Vec<f64> {
        order
            .iter()
            .flat_map(|&v| a[v * cols..(v + 1) * cols].to_vec())
            .collect()
    };
    let variables: Vec<u32> = order.iter().map(|&v| v as u32).collect();
    let mut pairs: Vec<(Vec<f64>, Vec<f64>)> = (0..p.dims.rows / 2)
        .map(|k| {
            let g = columns(&p.rows[2 * k * nz..(2 * k + 1) * nz], nz, &variables);
            let w = columns(&p.rows_state[2 * k * n..(2 * k + 1) * n], n, &state_order);
            (g, w.iter().map(|v| -v).collect())
        })
        .collect();
    pairs.sort_by_key(|r| r.0.iter().position(|&v| v != 0.0).unwrap_or(0));
    let mut first_input = vec![0.0; m * nz];
    for i in 0..m {
        first_input[i * nz + place(i) as usize] = 1.0;
        for j in 0..m {
            first_input[i * nz + place(stages * m + j) as usize] = p.feedforward[i * m + j];
        }
    }
    let case = Case {
        nz,
        n,
        nr,
        m,
        h: columns(&rows(&p.hessian, nz), nz, &variables),
        fx: columns(&rows(&p.linear_state, n), n, &state_order),
        fr: columns(&rows(&p.linear_set_point, nr), nr, &set_point_order),
        upper: vec![1.0; pairs.len()],
        lower: vec![1.0; pairs.len()],
        g: pairs.iter().map(|r| r.0.clone()).collect(),
        v: pairs.iter().map(|r| r.1.clone()).collect(),
        gain: columns(&p.gain, n, &state_order),
        first_input,
        input_rows: p.input_rows.clone(),
        state_order,
        set_point_order,
        next_stage: order
            .iter()
            .map(|&v| match v {
                v if v >= stages * m => place(v),
                v if v + m < stages * m => place(v + m),
                _ => NO_ROW,
            })
            .collect(),
        group: 7,
    };
    (case, order)
}

/// The cost (9) of a plan, by simulation, and its first stage.
fn cost(p: &Problem, order: &[usize], x: &[f64], r: &[f64], plan: &[f64]) -> (f64, f64) {
    let (m, stages) = (p.dims.inputs, p.dims.horizon);
    let mut z = vec![0.0; plan.len()];
    for (k, &v) in order.iter().enumerate() {
        z[v] = plan[k];
    }
    let theta = &z[stages * m..];
    let (xs, us) = (p.plant.m_x.apply(theta), p.plant.m_u.apply(theta));
    let gain = Mat::from(m, p.dims.states, &p.gain);
    let square =
        |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(p, q)| (p - q) * (p - q)).sum() };
    let mut total = p.plant.o * square(&xs, &r[..xs.len()]);
    let (mut x, mut first) = (x.to_vec(), 0.0);
    for stage in 0..2000 {
        let from: Vec<f64> = x.iter().zip(&xs).map(|(p, q)| p - q).collect();
        let mut u: Vec<f64> = gain
            .apply(&from)
            .iter()
            .zip(&us)
            .map(|(p, q)| p + q)
            .collect();
        if stage < stages {
            for i in 0..m {
                u[i] += z[stage * m + i];
            }
        }
        let now = p.plant.q * square(&x, &xs) + p.plant.r * square(&u, &us);
        if stage == 0 {
            first = now;
        }
        total += now;
        x = p.next(&x, &u);
    }
    (total, first)
}

fn set_point(p: &Problem, random: &mut Lcg) -> Vec<f64> {
    // Now and then out of reach.
    let theta: Vec<f64> = (0..p.dims.inputs).map(|_| 5.0 * random.signed()).collect();
    let mut r = p.plant.m_x.apply(&theta);
    r.extend(p.plant.m_u.apply(&theta));
    r
}

fn problems() -> Vec<Problem> {
    vec![common::academic(), carts(2), carts(3)]
}

#[test]
fn closed_loop_like_the_dense_regime() {
    let mut random = Lcg(61);
    for p in problems() {
        let (case, order) = banded(&p, &mut random);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        tables.check_values().unwrap();
        let mut controller = judge::controller(&tables);
        let dims = p.dims;
        let (mut buffer, mut scratch) =
            (vec![0.0; dims.tables_len()], vec![0.0; dims.prepare_len()]);
        let dense_tables = prepare(&p.data(), &mut buffer, &mut scratch).unwrap();
        let (mut numbers, mut indices) =
            (vec![0.0; dims.workspace_len()], vec![0; dims.index_len()]);
        let workspace = Workspace::new(dims, &mut numbers, &mut indices).unwrap();
        let mut dense = mpct_runtime::Controller::new(dense_tables, workspace).unwrap();
        let (mut x, mut r) = (vec![0.0; dims.states], set_point(&p, &mut random));
        let mut active = 0;
        for k in 0..300 {
            if k % 50 == 0 {
                r = set_point(&p, &mut random);
            }
            let expected = dense.step(&x, &r, Budget::unlimited()).unwrap();
            let u_dense = expected.input.to_vec();
            let z_dense = expected.solution.to_vec();
            assert_eq!(expected.status, StepStatus::Optimal);
            let answer = judge::step(
                &case,
                &tables,
                &mut controller,
                (&x, &r),
                Budget::unlimited(),
                false,
            );
            assert_eq!(answer, judge::Answer::Optimal);
            active += controller.multipliers(&tables).count();
            let step = controller
                .step(&tables, &x, &r, Budget::unlimited())
                .unwrap();
            for (a, b) in step.input.iter().zip(&u_dense) {
                assert!((a - b).abs() < 1e-6, "{a} {b}");
            }
            for (&v, a) in order.iter().zip(step.solution) {
                assert!((a - z_dense[v]).abs() < 1e-6, "{a} {}", z_dense[v]);
            }
            x = p.next(&x, &u_dense);
        }
        assert!(active > 50, "{active}");
    }
}

/// Theorems 3 and 4 with any budget, as long as the state is the predicted one; the truth after a disturbance.
#[test]
fn the_candidate_is_what_the_theorems_say() {
    let mut random = Lcg(62);
    let (mut candidates, mut improved, mut violated) = (0, 0, 0);
    for p in problems() {
        let (case, order) = banded(&p, &mut random);
        let owned = Owned::<f64>::new(&case);
        let tables = owned.tables().unwrap();
        for round in 0..30 {
            let mut controller = judge::controller(&tables);
            let (mut x, mut r) = (vec![0.0; case.n], set_point(&p, &mut random));
            let step = controller
                .step(&tables, &x, &r, Budget::unlimited())
                .unwrap();
            let (mut plan, mut u) = (step.solution.to_vec(), step.input.to_vec());
            for k in 0..20 {
                let (last, stage) = cost(&p, &order, &x, &r, &plan);
                x = p.next(&x, &u);
                let is_disturbed = k == 19;
                if is_disturbed {
                    x.iter_mut().for_each(|v| *v += 0.3 * random.signed());
                }
                let limit = if round % 2 == 0 {
                    0
                } else {
                    random.below(12) as u32
                };
                if round % 3 == 2 && k == 5 {
                    // A new set-point: Theorem 3 holds, Theorem 4 speaks of the new cost.
                    r = set_point(&p, &mut random);
                }
                let (g, b, _) = case.one_sided(&x);
                let shifted: Vec<f64> = case
                    .next_stage
                    .iter()
                    .map(|&v| if v == NO_ROW { 0.0 } else { plan[v as usize] })
                    .collect();
                let step = match controller.step(&tables, &x, &r, Budget::iterations(limit)) {
                    Err(StepError::Infeasible { .. }) if is_disturbed => break,
                    other => other.unwrap(),
                };
                assert!(judge::inside(&case, step.input));
                let truth = judge::excess(&g, &b, step.solution);
                let (before, _) = cost(&p, &order, &x, &r, &shifted);
                let (now, _) = cost(&p, &order, &x, &r, step.solution);
                let size = 1e-9 * (1.0 + before.abs());
                if let StepStatus::Candidate(why) = step.status {
                    assert_eq!(why, Why::IterationLimit);
                    candidates += 1;
                    let claimed = step.violation;
                    let of_plan = judge::excess(&g, &b, &shifted);
                    assert!((claimed - of_plan).abs() < 1e-11, "{claimed:e} {of_plan:e}");
                    assert!(now <= before + size, "{now} {before}");
                    improved += usize::from(now < before - 1e3 * size);
                    if claimed > 1e-9 {
                        violated += 1;
                        assert_eq!(step.solution, shifted);
                    } else {
                        assert!(truth <= 1e-9, "{truth:e}");
                    }
                    let at = case.linear(&x, &r);
                    let own = judge::cost(&case.h, &at, step.solution);
                    assert!((step.cost - own).abs() <= 1e-9 * (1.0 + own.abs()));
                }
                if !is_disturbed {
                    assert!(truth <= 1e-9, "{truth:e}");
                    if !(round % 3 == 2 && k == 5) {
                        assert!(now <= last - stage + size, "{now} {last} {stage}");
                    }
                }
                (plan, u) = (step.solution.to_vec(), step.input.to_vec());
            }
        }
    }
    assert!(
        candidates > 500 && improved > 50 && violated > 10,
        "{candidates} {improved} {violated}"
    );
}
