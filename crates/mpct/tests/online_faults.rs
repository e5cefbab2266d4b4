//! What can go wrong at a sampling instant, at the desk's door: nothing of it may show in the next step.

use mpct::{
    CandidateReason, Controller, DesignOptions, Problem, SetPoint, StepError, StepStatus,
    TerminalIngredients, cases,
};
use std::time::Duration;

fn controller(problem: Problem) -> Controller {
    let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default()).unwrap();
    Controller::new(ingredients).unwrap()
}

fn next(controller: &Controller, x: &[f64], u: &[f64]) -> Vec<f64> {
    let plant = controller.ingredients().problem().plant();
    let (ax, bu) = (plant.a().mul_vec(x), plant.b().mul_vec(u));
    ax.iter().zip(&bu).map(|(a, b)| a + b).collect()
}

/// Expected: the answer of a controller that has seen nothing. The optimum is unique.
#[test]
fn faults_leave_no_trace() {
    let mut tried = controller(cases::academic().problem);
    let (x, home) = ([-1.0, 0.4], SetPoint::state([1.5, 0.2]));
    let expected = controller(cases::academic().problem)
        .step(&x, &home)
        .unwrap();
    type Fault = fn(&mut Controller);
    let faults: [(&str, Fault); 7] = [
        ("state not a number", |c| {
            let e = c.step(&[f64::NAN, 0.0], &SetPoint::state([0.0, 0.0]));
            assert!(matches!(e, Err(StepError::StateNotFinite { index: 0, .. })));
        }),
        ("set-point infinite", |c| {
            let e = c.step(&[0.0, 0.0], &SetPoint::state([0.0, f64::INFINITY]));
            assert!(matches!(
                e,
                Err(StepError::SetPointNotFinite { index: 1, .. })
            ));
        }),
        ("state of the wrong length", |c| {
            let e = c.step(&[0.0], &SetPoint::state([0.0, 0.0]));
            assert!(matches!(e, Err(StepError::WrongLength { .. })));
        }),
        ("state outside of the domain", |c| {
            let e = c.step(&[2.9, 2.9], &SetPoint::state([0.0, 0.0]));
            assert!(matches!(e, Err(StepError::Infeasible { radius, .. }) if radius >= 1e6));
            assert!(!c.infeasibility_proof().is_empty());
        }),
        ("state far outside", |c| {
            let e = c.step(&[1e12, -1e12], &SetPoint::state([0.0, 0.0]));
            assert!(matches!(e, Err(StepError::Infeasible { .. })), "{e:?}");
        }),
        ("set-point far outside", |c| {
            let step = c.step(&[0.0, 0.0], &SetPoint::state([1e9, -1e9])).unwrap();
            assert!(!step.admissible && step.status == StepStatus::Optimal);
        }),
        ("no time", |c| {
            c.set_limits(None, Some(Duration::ZERO));
            let step = c.step(&[-2.0, 0.1], &SetPoint::state([-2.5, 0.0]));
            match step {
                Ok(step) => {
                    assert_eq!(
                        step.status,
                        StepStatus::Candidate(CandidateReason::Deadline)
                    );
                    assert!(step.input.iter().all(|u| u.abs() <= 2.0));
                }
                Err(e) => assert!(matches!(e, StepError::IterationLimit { .. }), "{e:?}"),
            }
            c.set_limits(None, None);
        }),
    ];
    for (name, fault) in faults {
        fault(&mut tried);
        let again = tried.step(&x, &home).unwrap();
        assert_eq!(again.status, StepStatus::Optimal, "{name}");
        assert!(again.admissible, "{name}");
        for (a, b) in again.input.iter().zip(&expected.input) {
            assert!((a - b).abs() < 1e-9, "{name}: {a} {b}");
        }
        assert!(
            (again.cost - expected.cost).abs() < 1e-9 * expected.cost,
            "{name}"
        );
    }
}

/// Theorems 3 and 4: with no iteration allowed ever again the inputs stay admissible and the cost falls.
#[test]
fn a_controller_without_time_keeps_its_guarantees() {
    let mut c = controller(cases::academic().problem);
    let (mut x, r) = (vec![-2.5, 0.3], SetPoint::state([2.0, 0.0]));
    let first = c.step(&x, &r).unwrap();
    let mut cost = first.cost;
    x = next(&c, &x, &first.input);
    c.set_limits(None, Some(Duration::ZERO));
    for k in 0..40 {
        let step = c.step(&x, &r).unwrap();
        assert_eq!(
            step.status,
            StepStatus::Candidate(CandidateReason::Deadline)
        );
        assert!(step.violation <= 1e-9, "{k} {}", step.violation);
        assert!(
            step.cost <= cost * (1.0 + 1e-12),
            "{k} {} {cost}",
            step.cost
        );
        assert!(step.input.iter().all(|u| u.abs() <= 2.0));
        cost = step.cost;
        x = next(&c, &x, &step.input);
        assert!(x.iter().all(|v| v.abs() <= 3.0 + 1e-9));
    }
    // With iterations that are too few after a jump the reason is another one.
    let mut c = controller(cases::drone().problem);
    let mut far = vec![0.0; 12];
    (far[0], far[1], far[8]) = (2.9, -2.9, 0.7);
    c.step(&[0.0; 12], &SetPoint::state([0.0; 12])).unwrap();
    c.set_limits(Some(2), None);
    let step = c.step(&[0.0; 12], &SetPoint::state(far)).unwrap();
    assert_eq!(
        step.status,
        StepStatus::Candidate(CandidateReason::IterationLimit)
    );
    assert!(step.iterations == 2 && step.violation <= 1e-9, "{step:?}");
}

/// Iterations of a loop of 200 steps, and the most of one step.
fn iterations(c: &mut Controller, of: impl Fn(usize, &[f64]) -> SetPoint) -> (usize, usize) {
    c.reset();
    let mut x = vec![0.0; 12];
    let (mut sum, mut most) = (0, 0);
    for k in 0..200 {
        let step = c.step(&x, &of(k, &x)).unwrap();
        assert_eq!(step.status, StepStatus::Optimal, "{k}");
        (sum, most) = (sum + step.iterations, most.max(step.iterations));
        x = next(c, &x, &step.input);
    }
    (sum, most)
}

/// Set-points that cannot be reached, jump every step, are far outside or are the state itself: no step costs more than a few times
/// what an ordinary jump costs, and only those that jump every step cost that at every step.
#[test]
fn strange_set_points_cost_no_more_than_ordinary_ones() {
    let mut c = controller(cases::drone().problem);
    let at = |p: [f64; 3], yaw: f64| -> SetPoint {
        let mut state = vec![0.0; 12];
        state[..3].copy_from_slice(&p);
        state[8] = yaw;
        SetPoint::state(state)
    };
    let ordinary = iterations(&mut c, |k, _| {
        let side = if k / 50 % 2 == 0 { 2.0 } else { -2.0 };
        at([side, -side, side], 0.1 * side)
    });
    assert!(
        ordinary.1 > 5,
        "the ordinary jumps are no jumps: {ordinary:?}"
    );
    let limit = 2 * ordinary.1;
    let unreachable = iterations(&mut c, |_, _| at([2.9, 5.0, -3.5], 2.0));
    let far = iterations(&mut c, |_, _| at([1e6, -1e6, 1e6], 1e3));
    let own = iterations(&mut c, |_, x| SetPoint::state(x.to_vec()));
    let moving = iterations(&mut c, |_, _| {
        let mut state = vec![0.0; 12];
        state[3] = 1.0; // a speed: no equilibrium at all
        SetPoint::state(state)
    });
    let jumping = iterations(&mut c, |k, _| {
        let side = if k % 2 == 0 { 2.0 } else { -2.0 };
        at([side, side, -side], 0.3 * side)
    });
    for (name, found) in [
        ("unreachable", unreachable),
        ("far", far),
        ("own state", own),
        ("no equilibrium", moving),
        ("jumping", jumping),
    ] {
        assert!(found.1 <= limit, "{name}: {found:?} against {ordinary:?}");
    }
    for (name, found) in [
        ("unreachable", unreachable),
        ("far", far),
        ("own state", own),
    ] {
        assert!(
            found.0 <= 2 * ordinary.0,
            "{name}: {found:?} against {ordinary:?}"
        );
    }
}
