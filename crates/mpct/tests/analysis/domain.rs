//! The domain of attraction against a grid of feasibility problems.

use crate::cases::{academic, design, drone, weak};
use crate::oracle::{self, Terminal};
use mpct::analysis::{DomainOfAttraction, Membership};
use mpct::{Controller, DesignError, Formulation, Problem, Task};

/// Within this of the boundary, in units of rows with right-hand side 1, the oracle's own accuracy decides.
const BOUNDARY: f64 = 1e-6;

fn domains() -> Vec<(
    &'static str,
    DomainOfAttraction,
    mpct::TerminalIngredients,
    Terminal,
)> {
    domains_of(&academic(0.9))
}

/// Those of the academic plant are all the largest set that any controller can hold. With a weak input and N = 2 the
/// terminal constraint decides.
fn domains_of(
    problem: &Problem,
) -> Vec<(
    &'static str,
    DomainOfAttraction,
    mpct::TerminalIngredients,
    Terminal,
)> {
    let tracking = design(problem);
    let regulation = design(&problem.clone().with_task(Task::Regulation));
    let of = |i: &mpct::TerminalIngredients, f| {
        DomainOfAttraction::of(&Controller::with_formulation(i.clone(), f).expect("controller"))
    };
    let implicit = |i: &mpct::TerminalIngredients| Terminal::Implicit {
        steps: i.terminal_horizon(),
    };
    vec![
        (
            "tracking, implicit",
            of(&tracking, Formulation::Implicit),
            tracking.clone(),
            implicit(&tracking),
        ),
        (
            "tracking, explicit",
            of(&tracking, Formulation::Explicit),
            tracking.clone(),
            Terminal::Explicit,
        ),
        (
            "regulation, implicit",
            of(&regulation, Formulation::Implicit),
            regulation.clone(),
            implicit(&regulation),
        ),
        (
            "regulation, explicit",
            of(&regulation, Formulation::Explicit),
            regulation.clone(),
            Terminal::Explicit,
        ),
    ]
}

#[test]
fn membership_outline_and_oracle_agree_on_a_grid() {
    for (name, domain, ingredients, terminal) in domains().into_iter().chain(domains_of(&weak())) {
        let outline = domain.projection((0, 1)).expect("outline");
        assert!(outline.gap < 2e-6, "{name}: {outline:?}");
        let mut decided = [0, 0];
        for a in -6..=6 {
            for b in -6..=6 {
                let x = [0.53 * f64::from(a), 0.53 * f64::from(b)];
                let depth = oracle::depth(&ingredients, terminal, &x).depth;
                let inside = domain.contains(&x).expect("membership").is_inside();
                if depth.abs() > BOUNDARY {
                    assert_eq!(inside, depth > 0.0, "{name} at {x:?}: depth {depth}");
                    assert_eq!(outline.contains(x), inside, "{name} at {x:?}");
                    decided[usize::from(inside)] += 1;
                }
            }
        }
        assert!(decided[0] > 20 && decided[1] > 20, "{name}: {decided:?}");
    }
}

#[test]
fn every_vertex_is_on_the_boundary_by_the_oracle() {
    for (name, domain, ingredients, terminal) in domains().into_iter().chain(domains_of(&weak())) {
        let outline = domain.projection((0, 1)).expect("outline");
        for v in &outline.vertices {
            let beyond = v.map(|c| 1.0001 * c);
            let depth = |x: &[f64]| oracle::depth(&ingredients, terminal, x).depth;
            assert!(depth(v) > -BOUNDARY, "{name}: {v:?}");
            assert!(depth(&beyond) < -1e-7, "{name}: {v:?}");
        }
        // In the plane the section through the origin is the projection.
        let section = domain.section(&[0.0, 0.0], (0, 1)).expect("section");
        assert!(
            (section.area() - outline.area()).abs() < 1e-4 * outline.area(),
            "{name}"
        );
    }
}

#[test]
fn implicit_and_explicit_domains_are_equal_and_regulation_is_smaller() {
    let areas: Vec<f64> = domains()
        .iter()
        .map(|d| d.1.projection((0, 1)).expect("outline").area())
        .collect();
    assert!((areas[0] - areas[1]).abs() < 1e-4, "{areas:?}");
    assert!((areas[2] - areas[3]).abs() < 1e-4, "{areas:?}");
    assert!(areas[2] <= areas[0] + 1e-4, "{areas:?}");
    let short: Vec<f64> = domains_of(&weak())
        .iter()
        .map(|d| d.1.projection((0, 1)).expect("outline").area())
        .collect();
    assert!((short[0] - short[1]).abs() < 1e-4, "{short:?}");
    assert!((short[2] - short[3]).abs() < 1e-4, "{short:?}");
    assert!(short[2] < 0.99 * short[0], "{short:?}");
}

/// The academic plant and beside it x⁺ = 1.5 x + u with |u| ≤ 0.2, which nothing connects: the domain is a product.
#[test]
fn the_volume_of_a_product_is_the_product_of_the_volumes() {
    use mpct::{Constraints, Matrix, Plant, Weights};
    let weights = || Weights::new(10.0, 100.0, 1e4);
    let alone = Problem::new(
        Plant::discrete(Matrix::from_rows(&[[1.5]]), Matrix::from_rows(&[[1.0]])).expect("plant"),
        Constraints::new(1, 1)
            .state_bounds(&[-3.0], &[3.0])
            .and_then(|c| c.input_bounds(&[-0.2], &[0.2]))
            .expect("constraints"),
        weights(),
    )
    .and_then(|p| p.with_prediction_horizon(2))
    .expect("problem");
    let both = Problem::new(
        Plant::discrete(
            Matrix::from_rows(&[[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.5]]),
            Matrix::from_rows(&[[0.0, 0.5, 0.0], [1.0, 0.5, 0.0], [0.0, 0.0, 1.0]]),
        )
        .expect("plant"),
        Constraints::new(3, 3)
            .state_bounds(&[-3.0; 3], &[3.0; 3])
            .and_then(|c| c.input_bounds(&[-2.0, -2.0, -0.2], &[2.0, 2.0, 0.2]))
            .expect("constraints"),
        weights(),
    )
    .and_then(|p| p.with_prediction_horizon(2))
    .expect("problem");
    let of = |p: &Problem| {
        DomainOfAttraction::of(&Controller::new(design(p)).expect("controller"))
            .volume()
            .expect("volume")
    };
    let plane = of(&academic(0.9).with_prediction_horizon(2).expect("horizon"));
    let (line, space) = (of(&alone), of(&both));
    assert_eq!(
        (line.dimension, plane.dimension, space.dimension),
        (1, 2, 3)
    );
    // From ±0.4 on the input cannot win against 1.5 x; two steps from the terminal set do not get that far.
    assert!(line.value > 0.5 && line.value < 0.8, "{line:?}");
    let product = line.value * plane.value;
    assert!(
        (space.value - product).abs() < 1e-5 * product,
        "{space:?} {product}"
    );
    assert!(
        space.gap < 2e-6 && space.vertices >= 2 * plane.vertices,
        "{space:?} {plane:?}"
    );
    // Beyond three states nothing is offered, and the message says what is.
    let drone = DomainOfAttraction::of(&Controller::new(design(&drone())).expect("controller"));
    let e = drone.volume().expect_err("twelve states");
    assert!(
        e.to_string().contains("12") && e.to_string().contains("projections"),
        "{e}"
    );
}

#[test]
fn a_proof_of_exclusion_names_the_rows() {
    let (_, domain, ..) = domains().remove(0);
    let Membership::Outside { gap, radius, rows } =
        domain.contains(&[3.2, 0.0]).expect("membership")
    else {
        panic!("3.2 is outside of X");
    };
    assert!(gap > 0.0 && radius >= 1e6 && !rows.is_empty());
    // x ∈ X at step 0 is part of the domain.
    assert_eq!(rows[0].0.to_string(), "state_upper[0] at step 0");
    let Membership::Inside { candidate, slack } = domain.contains(&[0.1, 0.0]).expect("membership")
    else {
        panic!("near the origin");
    };
    assert_eq!(candidate.len(), 22);
    assert!(slack > 0.0);
}

#[test]
fn reach_agrees_with_bisection_by_the_oracle() {
    let (_, domain, ingredients, terminal) = domains().remove(0);
    for k in 0..8 {
        let angle = 0.3 + f64::from(k) * std::f64::consts::FRAC_PI_4;
        let v = [angle.cos(), angle.sin()];
        let reach = domain.reach(&v).expect("reach");
        assert!(reach.at_most - reach.distance < 1e-6, "{reach:?}");
        let (mut low, mut high) = (0.0, 10.0);
        for _ in 0..30 {
            let t = 0.5 * (low + high);
            let inside = oracle::depth(&ingredients, terminal, &v.map(|c| t * c)).depth >= 0.0;
            if inside { low = t } else { high = t }
        }
        assert!((reach.distance - low).abs() < 1e-5, "{reach:?} {low}");
        // From elsewhere, with another scale of the direction.
        let from = [0.5, -0.25];
        let twice = domain
            .reach_from(&from, &v.map(|c| 2.0 * c))
            .expect("reach");
        let once = domain.reach_from(&from, &v).expect("reach");
        assert!((2.0 * twice.distance - once.distance).abs() < 1e-6);
    }
}

#[test]
fn the_drone_is_projected_and_cut() {
    let ingredients = design(&drone());
    let domain = DomainOfAttraction::of(&Controller::new(ingredients.clone()).expect("controller"));
    let outline = domain.projection((0, 3)).expect("outline");
    let section = domain.section(&[0.0; 12], (0, 3)).expect("section");
    assert!(outline.gap < 2e-6 && section.gap < 2e-6);
    assert!(section.area() <= outline.area() * (1.0 + 1e-6));
    let terminal = Terminal::Implicit {
        steps: ingredients.terminal_horizon(),
    };
    for v in section.vertices.iter().step_by(5) {
        for (share, sign) in [(0.999, 1.0), (1.001, -1.0)] {
            let mut x = vec![0.0; 12];
            (x[0], x[3]) = (share * v[0], share * v[1]);
            let depth = oracle::depth(&ingredients, terminal, &x).depth;
            assert!(depth * sign > 0.0, "{v:?} {share} {depth}");
        }
    }
}

#[test]
fn bad_questions_are_answered_with_their_numbers() {
    let (_, domain, ..) = domains().remove(0);
    for coordinates in [(0, 0), (0, 2), (7, 1)] {
        let e = domain.projection(coordinates).expect_err("coordinates");
        assert!(
            e.to_string()
                .contains(&format!("{} and {}", coordinates.0, coordinates.1)),
            "{e}"
        );
        assert!(domain.section(&[0.0, 0.0], coordinates).is_err());
    }
    let e = domain.reach(&[0.0, 0.0]).expect_err("zero direction");
    assert!(e.to_string().contains("direction"), "{e}");
    assert!(matches!(
        domain.reach(&[1.0]),
        Err(DesignError::Shape { .. })
    ));
    assert!(matches!(
        domain.reach(&[f64::NAN, 0.0]),
        Err(DesignError::NotFinite { .. })
    ));
    assert!(matches!(
        domain.contains(&[f64::INFINITY, 0.0]),
        Err(DesignError::NotFinite { .. })
    ));
    let e = domain
        .reach_from(&[9.0, 0.0], &[1.0, 0.0])
        .expect_err("outside");
    assert!(e.to_string().contains("outside"), "{e}");
    assert!(domain.projection_within((0, 1), 0.0).is_err());
    assert!(domain.projection_within((0, 1), f64::NAN).is_err());
}
