//! Section 3.5 against the facts, the oracle, and closed loops.

use crate::cases::{academic, design};
use crate::oracle::{self, Terminal};
use mpct::analysis::{AlphaBounds, AlphaScope, DomainOfAttraction, StabilityRegion};
use mpct::{
    Controller, DesignError, NoTerminalConstraint, ScheduledSetPoint, SetPoint, Simulation, Task,
    simulate,
};

/// The set-point of Figure 2.
const FIGURE_2: [f64; 2] = [-0.5688, -0.0523];

fn choices(steps: usize, gamma: f64) -> NoTerminalConstraint {
    NoTerminalConstraint::new(steps, gamma).expect("choices")
}

fn controller(steps: usize, gamma: f64, alpha: Option<f64>, scaling: f64) -> Controller {
    let mut c = choices(steps, gamma);
    if let Some(alpha) = alpha {
        c = c.with_alpha(alpha).expect("alpha");
    }
    Controller::new(design(&academic(scaling).with_no_terminal_constraint(c))).expect("controller")
}

#[test]
fn alpha_and_d_are_the_independent_ones() {
    let bounds = |scaling: f64| {
        let problem = academic(scaling).with_no_terminal_constraint(choices(1, 20.0));
        AlphaBounds::of(&design(&problem), &SetPoint::state(FIGURE_2)).expect("bounds")
    };
    let at_09 = bounds(0.9);
    assert!((at_09.largest(AlphaScope::EveryEquilibrium) - 1.845).abs() < 1e-3);
    assert!((bounds(0.6).largest(AlphaScope::EveryEquilibrium) - 29.5).abs() < 0.05);
    assert!((at_09.largest(AlphaScope::AroundSetPoint) - 121.0).abs() < 0.5);
    assert!((25.0 * at_09.stage_cost_ratio - 2.2253).abs() < 1e-4);
    let throughout = at_09.largest(AlphaScope::ThroughoutRegion);
    assert!(throughout > 1.845 && throughout < 121.0, "{throughout}");
    // The paper's α = 25 is safe for every artificial set-point that Υ of Figure 2 allows, not at its centre alone.
    let figure_2 = academic(0.9).with_no_terminal_constraint(choices(2, 20.0));
    let figure_2 = AlphaBounds::of(&design(&figure_2), &SetPoint::state(FIGURE_2)).expect("bounds");
    let largest = figure_2.largest(AlphaScope::ThroughoutRegion);
    assert!((largest - 83.05).abs() < 0.01, "{largest}");
}

#[test]
fn every_level_set_lies_in_the_constraints_by_sampling() {
    // Points of Ψα for the largest α: x = M_θx θ + √α P^(-1/2) direction, θ at vertices of a box scaled into λΘ.
    let problem = academic(0.9).with_no_terminal_constraint(choices(2, 20.0));
    let ingredients = design(&problem);
    let bounds = AlphaBounds::of(&ingredients, &SetPoint::state([0.0, 0.0])).expect("bounds");
    let alpha = bounds.largest(AlphaScope::EveryEquilibrium);
    let p = ingredients.terminal_weight();
    let steady = ingredients.steady_states();
    let rows = problem.rows();
    let mut worst = f64::NEG_INFINITY;
    for a in 0..60 {
        let ray = f64::from(a) * std::f64::consts::TAU / 60.0;
        let direction = [ray.cos(), ray.sin()];
        // The longest θ on the ray.
        let reach = |v: &[f64]| {
            let (x, u) = (
                steady.state_basis().mul_vec(v),
                steady.input_basis().mul_vec(v),
            );
            let (cx, du) = (rows.c.mul_vec(&x), rows.d.mul_vec(&u));
            cx.iter().zip(&du).map(|(a, b)| a + b).fold(0.0, f64::max)
        };
        let theta = direction.map(|c| 0.9 * c / reach(&direction));
        let xs = steady.state_basis().mul_vec(&theta);
        let us = steady.input_basis().mul_vec(&theta);
        for b in 0..360 {
            let ray = f64::from(b) * std::f64::consts::TAU / 360.0;
            let e = [ray.cos(), ray.sin()];
            let pe = p.mul_vec(&e);
            let size = (alpha / (pe[0] * e[0] + pe[1] * e[1])).sqrt();
            let e = e.map(|c| size * c);
            let du = ingredients.gain().mul_vec(&e);
            let x: Vec<f64> = xs.iter().zip(&e).map(|(a, b)| a + b).collect();
            let u: Vec<f64> = us.iter().zip(&du).map(|(a, b)| a + b).collect();
            let (cx, du) = (rows.c.mul_vec(&x), rows.d.mul_vec(&u));
            for (a, b) in cx.iter().zip(&du) {
                worst = worst.max(a + b);
            }
        }
    }
    // Inside, and not by much: the bound is the largest.
    assert!(worst <= 1.0 + 1e-9 && worst > 0.98, "{worst}");
}

#[test]
fn the_cost_and_the_feasible_set_are_those_of_35() {
    for (steps, gamma) in [(0, 1.0), (2, 20.0), (4, 3.0)] {
        let mut controller = controller(steps, gamma, None, 0.9);
        let ingredients = controller.ingredients().clone();
        let terminal = Terminal::None { steps, gamma };
        let domain = DomainOfAttraction::of(&controller);
        for x in [
            [0.3, -0.2],
            [-2.0, 1.0],
            [2.9, -1.2],
            [1.0, 2.5],
            [2.9, 2.9],
        ] {
            let depth = oracle::depth(&ingredients, terminal, &x).depth;
            let inside = domain.contains(&x).expect("membership").is_inside();
            assert_eq!(inside, depth > 0.0, "{x:?} {depth}");
            if inside {
                let (cost, v) =
                    oracle::optimal_cost(&ingredients, terminal, &x, &FIGURE_2).expect("oracle");
                controller.reset();
                let step = controller
                    .step(&x, &SetPoint::state(FIGURE_2))
                    .expect("step");
                assert!(
                    (step.cost - cost).abs() < 1e-5 * (1.0 + cost),
                    "{} {cost}",
                    step.cost
                );
                let u0 = &v[(10 + steps + 1) * 2..(10 + steps + 1) * 2 + 2];
                for (a, b) in step.input.iter().zip(u0) {
                    assert!((a - b).abs() < 1e-3, "{:?} {u0:?}", step.input);
                }
            }
        }
    }
}

#[test]
fn membership_and_outline_of_the_region_agree_with_the_oracle() {
    let controller = controller(2, 20.0, Some(25.0), 0.9);
    let set_point = SetPoint::state(FIGURE_2);
    let region =
        StabilityRegion::of(&controller, &set_point, AlphaScope::ThroughoutRegion).expect("region");
    assert!((region.stage_cost_bound() - 2.2253).abs() < 1e-4);
    assert!((region.level() - (12.0 * region.stage_cost_bound() + 500.0)).abs() < 1e-9);
    let outline = region.projection((0, 1)).expect("outline");
    assert!(
        outline.gap < 2e-4 && outline.vertices.len() > 8,
        "{outline:?}"
    );
    let terminal = Terminal::None {
        steps: 2,
        gamma: 20.0,
    };
    let mut seen = [0, 0];
    for a in -7..=7 {
        for b in -7..=7 {
            let x = [0.41 * f64::from(a), 0.41 * f64::from(b)];
            let cost = match oracle::depth(controller.ingredients(), terminal, &x).depth {
                d if d < 0.0 => f64::INFINITY,
                _ => {
                    oracle::optimal_cost(controller.ingredients(), terminal, &x, &FIGURE_2)
                        .expect("oracle")
                        .0
                }
            };
            if (cost - region.level()).abs() > 1e-2 * region.level() {
                let inside = region.contains(&x).expect("membership").is_inside();
                assert_eq!(inside, cost < region.level(), "{x:?} {cost}");
                assert_eq!(outline.contains(x), inside, "{x:?}");
                seen[usize::from(inside)] += 1;
            }
        }
    }
    assert!(seen[0] > 20 && seen[1] > 20, "{seen:?}");
    for v in &outline.vertices {
        let attraction = region.contains(v).expect("membership");
        assert!(
            attraction.cost <= region.level() * (1.0 + 1e-6),
            "{attraction:?}"
        );
        // The printed left-hand side is never the larger one.
        assert!(attraction.as_printed <= attraction.cost + 1e-6 * attraction.level);
    }
}

#[test]
fn the_region_grows_with_gamma_and_the_extension() {
    let set_point = SetPoint::state(FIGURE_2);
    let outlines: Vec<_> = [(0, 1.0), (2, 1.0), (4, 1.0), (4, 5.0), (4, 20.0)]
        .into_iter()
        .map(|(steps, gamma)| {
            let controller = controller(steps, gamma, Some(1.8), 0.9);
            let region = StabilityRegion::of(&controller, &set_point, AlphaScope::EveryEquilibrium)
                .expect("region");
            region.projection((0, 1)).expect("outline")
        })
        .collect();
    for pair in outlines.windows(2) {
        assert!(
            pair[1].area() >= pair[0].area() * (1.0 - 1e-3),
            "{} {}",
            pair[0].area(),
            pair[1].area()
        );
        let centre = FIGURE_2;
        for v in &pair[0].vertices {
            let drawn_in = [0, 1].map(|k| centre[k] + 0.999 * (v[k] - centre[k]));
            assert!(pair[1].contains(drawn_in), "{v:?}");
        }
    }
    assert!(outlines[4].area() > 2.0 * outlines[0].area());
}

#[test]
fn from_its_vertices_the_loop_converges_and_stays_inside() {
    for (alpha, scope) in [
        (1.8, AlphaScope::EveryEquilibrium),
        (25.0, AlphaScope::ThroughoutRegion),
    ] {
        let mut controller = controller(2, 20.0, Some(alpha), 0.9);
        let set_point = SetPoint::state(FIGURE_2);
        let starts = StabilityRegion::of(&controller, &set_point, scope)
            .and_then(|r| r.projection((0, 1)))
            .expect("outline")
            .vertices;
        for start in starts.iter().step_by(starts.len() / 6) {
            let simulation = Simulation {
                initial_state: start.to_vec(),
                steps: 60,
                set_points: vec![ScheduledSetPoint {
                    from_step: 0,
                    set_point: set_point.clone(),
                }],
                disturbance: None,
            };
            let run = simulate(&mut controller, &simulation, None).expect("run");
            let last = &run.summary.final_state;
            assert!(
                (last[0] - FIGURE_2[0]).hypot(last[1] - FIGURE_2[1]) < 1e-4,
                "{last:?}"
            );
            assert!(run.summary.worst_violation < 1e-7);
            let region = StabilityRegion::of(&controller, &set_point, scope).expect("region");
            let mut before = f64::INFINITY;
            for step in run.steps.iter().take(12) {
                let a = region.contains(&step.x).expect("membership");
                assert!(a.cost <= before + 1e-6 * region.level(), "V* must fall");
                before = a.cost;
            }
        }
    }
}

#[test]
fn reach_agrees_with_bisection_by_the_oracle() {
    let controller = controller(2, 20.0, Some(1.8), 0.9);
    let set_point = SetPoint::state(FIGURE_2);
    let region =
        StabilityRegion::of(&controller, &set_point, AlphaScope::EveryEquilibrium).expect("region");
    let terminal = Terminal::None {
        steps: 2,
        gamma: 20.0,
    };
    let ingredients = controller.ingredients();
    // The set-point is admissible: its least offset cost is 0.
    let inside = |x: &[f64]| {
        oracle::depth(ingredients, terminal, x).depth >= 0.0
            && oracle::optimal_cost(ingredients, terminal, x, &FIGURE_2)
                .is_some_and(|c| c.0 <= region.level())
    };
    let from = [-0.5, 0.1];
    for k in 0..6 {
        let angle = 0.2 + f64::from(k) * std::f64::consts::FRAC_PI_3;
        let v = [angle.cos(), angle.sin()];
        for (start, reach) in [
            (FIGURE_2, region.reach(&v)),
            (from, region.reach_from(&from, &v)),
        ] {
            let reach = reach.expect("reach");
            let (mut low, mut high) = (0.0, 8.0);
            for _ in 0..30 {
                let t = 0.5 * (low + high);
                if inside(&[start[0] + t * v[0], start[1] + t * v[1]]) {
                    low = t;
                } else {
                    high = t;
                }
            }
            assert!(
                (reach.distance - low).abs() < 1e-4 && reach.at_most >= reach.distance,
                "{reach:?} {low}"
            );
        }
    }
    let volume = region.volume().expect("volume");
    let area = region.projection((0, 1)).expect("outline").area();
    assert!((volume.value - area).abs() < 1e-9, "{volume:?} {area}");
    assert!(region.reach(&[0.0, 0.0]).is_err() && region.reach(&[f64::NAN, 1.0]).is_err());
    assert!(region.reach(&[1.0]).is_err());
    let e = region
        .reach_from(&[2.9, 2.9], &[1.0, 0.0])
        .expect_err("outside");
    assert!(e.to_string().contains("inside the stability region"), "{e}");
}

/// More states than two: membership, outlines and sections of the drone's region against costs by the oracle.
#[test]
fn the_region_of_a_plant_of_many_states_is_projected_and_cut() {
    let problem = crate::cases::drone().with_no_terminal_constraint(choices(20, 5.0));
    let controller = Controller::new(design(&problem)).expect("controller");
    let home = SetPoint::state([0.0; 12]);
    let region =
        StabilityRegion::of(&controller, &home, AlphaScope::EveryEquilibrium).expect("region");
    let terminal = Terminal::None {
        steps: 20,
        gamma: 5.0,
    };
    let section = region.section((0, 3)).expect("section");
    let projection = region.projection((0, 3)).expect("outline");
    assert!(section.area() > 0.0 && section.area() < projection.area());
    for v in section.vertices.iter().step_by(section.vertices.len() / 4) {
        for (share, inside) in [(0.99, true), (1.01, false)] {
            let mut x = vec![0.0; 12];
            (x[0], x[3]) = (share * v[0], share * v[1]);
            let (cost, _) =
                oracle::optimal_cost(controller.ingredients(), terminal, &x, &[0.0; 12])
                    .expect("oracle");
            assert_eq!(
                cost <= region.level(),
                inside,
                "{v:?} {cost} {}",
                region.level()
            );
            assert_eq!(region.contains(&x).expect("membership").is_inside(), inside);
        }
    }
    assert!(region.volume().is_err());
}

#[test]
fn bad_choices_are_refused_with_their_numbers() {
    for gamma in [0.99, f64::NAN, f64::INFINITY, -3.0] {
        let e = NoTerminalConstraint::new(2, gamma).expect_err("gamma");
        assert!(
            e.to_string().contains("gamma") && e.to_string().contains(&gamma.to_string()),
            "{e}"
        );
    }
    for alpha in [0.0, -1.0, f64::NAN] {
        assert!(choices(2, 1.0).with_alpha(alpha).is_err());
    }
    // M̄ ≥ M̃ = 5: the plain formulation would do.
    let design = design(&academic(0.9).with_no_terminal_constraint(choices(5, 2.0)));
    let e = Controller::new(design)
        .map(|_| ())
        .expect_err("too many steps");
    assert!(
        e.to_string().contains("terminal horizon, 5") && e.to_string().contains("implicit"),
        "{e}"
    );
    let paper = controller(2, 20.0, Some(25.0), 0.9);
    let set_point = SetPoint::state(FIGURE_2);
    let e = StabilityRegion::of(&paper, &set_point, AlphaScope::EveryEquilibrium)
        .map(|_| ())
        .expect_err("alpha");
    assert!(
        e.to_string().contains("1.8447") && e.to_string().contains("25"),
        "{e}"
    );
    assert!(matches!(e, DesignError::OutOfRange { .. }));
    let region =
        StabilityRegion::of(&paper, &set_point, AlphaScope::AroundSetPoint).expect("region");
    assert!(region.projection((1, 1)).is_err() && region.section((0, 3)).is_err());
    let plain = Controller::new(crate::cases::design(&academic(0.9))).expect("controller");
    assert!(StabilityRegion::of(&plain, &set_point, AlphaScope::EveryEquilibrium).is_err());
}

#[test]
fn regulation_has_a_region_too() {
    let problem = academic(0.9)
        .with_task(Task::Regulation)
        .with_no_terminal_constraint(choices(0, 4.0));
    let ingredients = design(&problem);
    assert!(ingredients.terminal_horizon() > 0);
    let controller = Controller::new(ingredients).expect("controller");
    let home = SetPoint::state([0.0, 0.0]);
    let region =
        StabilityRegion::of(&controller, &home, AlphaScope::EveryEquilibrium).expect("region");
    let outline = region.projection((0, 1)).expect("outline");
    assert!(outline.contains([0.0, 0.0]));
    for v in &outline.vertices {
        let cost = region.contains(v).expect("membership").cost;
        assert!(cost <= region.level() * (1.0 + 1e-6), "{cost}");
    }
}
