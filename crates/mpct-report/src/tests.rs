//! Structure of the page, on synthetic data.

use super::closed_loop::Kind;
use super::data::{DesignNumbers, Signal, StepRecord};
use super::page::render;
use super::picture::picture;
use super::*;

fn signal(name: &str, unit: &str, limit: f64) -> Signal {
    Signal {
        name: name.into(),
        unit: (!unit.is_empty()).then(|| unit.into()),
        lower: -limit,
        upper: limit,
    }
}

/// Decaying oscillations between set-points: `n` states, `m` inputs, `steps` steps.
fn synthetic(n: usize, m: usize, steps: usize) -> ReportData {
    let mut data = ReportData {
        name: "synthetic".into(),
        sampling_time: Some(0.04),
        continuous: true,
        cumulative_cost: 3.1548e6,
        ..ReportData::default()
    };
    data.states = (0..n)
        .map(|i| {
            signal(
                &format!("x{}", i + 1),
                "m",
                if i % 2 == 0 { 3.0 } else { 0.8 },
            )
        })
        .collect();
    data.inputs = (0..m)
        .map(|i| signal(&format!("u{}", i + 1), "N", 1.5))
        .collect();
    data.design = DesignNumbers {
        spectral_radius: 0.98,
        equation_3_residual: Some(3e-14),
        task: "tracking".into(),
        formulation: "implicit".into(),
        extension: None,
        prediction_horizon: 5,
        terminal_horizon: 92,
        minimal: true,
        condition: "exact".into(),
        scaling: 0.9,
        linear_programs: 812,
        seconds: 0.31,
        constraint_rows: 2 * (n + m),
        ellipsoids: 0,
        weights: "Q = 10 I, R = 100 I, O = 1e6 I".into(),
        spent: (0..n + m)
            .flat_map(|i| {
                ["≤", "≥ −"].map(|s| (format!("x{} {s} 3 m", i + 1), 93usize.saturating_sub(7 * i)))
            })
            .collect(),
        certificate: None,
        regions: Vec::new(),
    };
    let length = (steps / 4).max(1);
    for k in 0..steps {
        let part = k / length;
        let since = (k % length) as f64;
        let decay = (-since / 25.0).exp();
        let level = [2.0, -1.0, 0.0, 2.9][part % 4];
        let before = if part == 0 {
            0.0
        } else {
            [2.0, -1.0, 0.0, 2.9][(part - 1) % 4]
        };
        let reach = f64::min(level, 2.7);
        let row = |share: f64| -> Vec<f64> { (0..n).map(|i| share / (1.0 + i as f64)).collect() };
        let way = reach - before;
        data.steps.push(StepRecord {
            x: row(reach - way * decay * (since / 9.0).cos()),
            u: (0..m)
                .map(|i| 1.5 * decay * (since / 9.0 + i as f64).sin())
                .collect(),
            artificial_state: row(reach - way * (-since / 6.0).exp()),
            artificial_input: vec![0.0; m],
            set_point: row(level),
            cost: 1e6 * way.abs() * decay * decay + if level > reach { 4e4 } else { 0.0 },
            offset_cost: 1e5 * way.abs() * (-since / 6.0).exp()
                + if level > reach { 4e4 } else { 0.0 },
            admissible: level <= reach,
            status: "optimal".into(),
            iterations: 9 + k % 5,
            solve_seconds: 2e-4 * (1.0 + 0.3 * (k as f64).sin())
                + if since < 2.0 { 1e-3 } else { 0.0 },
        });
    }
    data.final_state = data.steps.last().map(|s| s.x.clone()).unwrap_or_default();
    data
}

/// Reads the page as XML (after its void `meta` elements are closed), and returns the names of its elements.
fn elements(page: &str) -> Vec<String> {
    let body = page.split_once("</style>").expect("a style sheet").1;
    let body = body.strip_suffix("</html>\n").expect("the end of the page");
    let mut open: Vec<String> = vec!["head".into()];
    let mut seen = Vec::new();
    let mut rest = body;
    while let Some(at) = rest.find('<') {
        let (text, tail) = rest.split_at(at);
        assert_text(text);
        let end = tail.find('>').expect("a tag ends");
        let tag = &tail[1..end];
        rest = &tail[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name), "elements nest");
            continue;
        }
        let name = tag.split([' ', '/']).next().expect("a name").to_string();
        let attributes = &tag[name.len()..];
        assert_eq!(attributes.matches('"').count() % 2, 0, "{tag}");
        for (i, part) in attributes.split('"').enumerate() {
            if i % 2 == 1 {
                assert_text(part);
            } else {
                assert!(!part.contains(['<', '&', '\'']), "{tag}");
            }
        }
        if !tag.ends_with('/') {
            open.push(name.clone());
        }
        seen.push(name);
    }
    assert_text(rest);
    assert!(open.is_empty(), "left open: {open:?}");
    seen
}

/// An ampersand starts one of the five entities.
fn assert_text(text: &str) {
    for tail in text.split('&').skip(1) {
        let entity = tail.split(';').next().unwrap_or("");
        assert!(
            ["amp", "lt", "gt", "quot", "#39"].contains(&entity),
            "{text}"
        );
    }
    assert!(!text.contains('>'), "{text}");
}

fn check(data: &ReportData) -> (String, Vec<String>) {
    let page = render(data);
    let elements = elements(&page);
    for bad in [
        "NaN", "inf", "http:", "https:", "//", "url(", "<script", "src=", "href=",
    ] {
        assert!(!page.contains(bad), "{bad} in the page");
    }
    (page, elements)
}

fn figures(elements: &[String]) -> usize {
    elements.iter().filter(|e| *e == "svg").count()
}

#[test]
fn a_page_shows_every_state_and_input() {
    let data = synthetic(12, 4, 400);
    let (page, elements) = check(&data);
    // 12 + 4 plots, cost, solve times, horizon, and 4 + 3 marks in the legends.
    assert_eq!(figures(&elements), 16 + 3 + 7);
    for part in [
        "M̃ = 92",
        "λ = 0.9",
        "812 linear programs",
        "time (s)",
        "x12 (m)",
        "artificial set-point",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(page.contains(r#"class="forbidden""#));
    assert!(page.contains("3 of them admissible"));
    assert!(page.len() < 400_000, "{}", page.len());
}

#[test]
fn two_hundred_carts_stay_readable() {
    let data = synthetic(400, 200, 2000);
    let (page, elements) = check(&data);
    assert!(figures(&elements) < 30, "{}", figures(&elements));
    assert!(page.contains("400 states in 2 groups"));
    assert!(page.contains(r#"class="band""#));
    assert!(page.len() < 2_000_000, "{}", page.len());
}

#[test]
fn odd_runs_have_a_page() {
    for steps in [0, 1, 2, 5] {
        check(&synthetic(2, 1, steps));
    }
    let mut constant = synthetic(3, 1, 50);
    for s in &mut constant.steps {
        s.x = vec![0.0, 1e9, -1e-12];
        s.u = vec![0.0];
        s.artificial_state = s.x.clone();
        s.set_point = s.x.clone();
        (s.cost, s.offset_cost, s.solve_seconds) = (0.0, 0.0, 0.0);
    }
    let (page, _) = check(&constant);
    assert!(page.contains("zero at every step"));

    let mut strange = synthetic(3, 2, 50);
    strange.sampling_time = None;
    strange.states[0].lower = f64::NEG_INFINITY;
    strange.states[0].upper = f64::INFINITY;
    strange.states[1].upper = f64::INFINITY;
    strange.design.spent.clear();
    strange.cumulative_cost = f64::MAX;
    for (k, s) in strange.steps.iter_mut().enumerate() {
        s.x[0] = if k % 7 == 3 { f64::NAN } else { 1e308 };
        s.x[1] = f64::INFINITY;
        s.artificial_state.clear();
        s.set_point[2] = f64::NAN;
        s.cost = f64::NAN;
        s.offset_cost = f64::NEG_INFINITY;
        s.solve_seconds = f64::NAN;
        s.status = "iteration_limit".into();
    }
    let page = render(&strange);
    elements(&page);
    assert!(page.contains("50 iteration_limit"));
}

#[test]
fn limits_at_infinity_are_not_drawn() {
    let mut data = synthetic(2, 1, 40);
    for s in data.states.iter_mut().chain(&mut data.inputs) {
        (s.lower, s.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    let (page, _) = check(&data);
    // Only the mark in the legend.
    assert_eq!(page.matches(r#"class="forbidden""#).count(), 1);
}

#[test]
fn names_are_escaped() {
    let mut data = synthetic(2, 1, 40);
    let nasty = "<script>alert(\"1\")</script> & 'co' \u{7}";
    data.name = nasty.into();
    data.states[0].name = nasty.into();
    data.inputs[0].unit = Some(nasty.into());
    data.design.spent[0].0 = nasty.into();
    data.design.weights = nasty.into();
    data.steps[3].status = nasty.into();
    let (page, elements) = check(&data);
    assert!(!elements.contains(&"script".to_string()));
    assert!(page.contains("&lt;script&gt;"));
}

#[test]
fn a_picture_holds_what_was_chosen() {
    let data = synthetic(3, 1, 80);
    let choice = Choice(vec![(Kind::State, 0), (Kind::Input, 0), (Kind::Input, 7)]);
    let picture = picture(&data, &choice);
    let (head, body) = picture.split_once("</style>").unwrap();
    assert!(head.starts_with("<svg xmlns=") && !head.contains('&'));
    let wrapped = format!(
        "</style></head><body><svg>{}</body></html>\n",
        body.trim_end()
    );
    let found = elements(&wrapped);
    assert_eq!(found.iter().filter(|e| *e == "g").count(), 2);
}

#[test]
fn without_terminal_constraint_less_is_promised() {
    let mut data = synthetic(2, 1, 80);
    assert!(render(&data).contains("Theorem 3"));
    data.design.extension = Some((3, 2.0));
    let (page, _) = check(&data);
    assert!(!page.contains("Theorem"));
    assert!(page.contains("stability region Υ") && page.contains("M̄ = 3"));
    data.steps[5].cost *= 100.0;
    assert!(render(&data).contains("the theory excludes inside of Υ"));
}

#[test]
fn settling_and_rises_are_measured() {
    let mut data = synthetic(1, 1, 4);
    for (s, (x, cost)) in
        data.steps
            .iter_mut()
            .zip([(0.0, 8.0), (0.9, 4.0), (1.0, 5.0), (1.0, 1.0)])
    {
        (s.x, s.artificial_state, s.set_point, s.cost) = (vec![x], vec![1.0], vec![1.0], cost);
    }
    let segments = data.segments();
    assert_eq!(segments.len(), 1);
    assert_eq!(segments[0].settled_after, Some(2));
    assert_eq!(segments[0].largest_rise, 1.0 / 8.0);
    data.steps[3].x = vec![0.5];
    assert_eq!(data.segments()[0].settled_after, None);
}

#[test]
fn a_real_run_has_a_page() {
    let file = mpct::cases::academic();
    let options = mpct::DesignOptions::default();
    let design = mpct::TerminalIngredients::design(&file.problem, &options).unwrap();
    let mut controller = mpct::Controller::new(design).unwrap();
    let run = mpct::simulate(&mut controller, &file.simulation.unwrap(), None).unwrap();
    let data = ReportData::new(controller.ingredients(), &run).with_proofs(&controller, &run);
    assert!(data.design.equation_3_residual.unwrap() < 1e-9);
    // The settling times of the library.
    let performance = mpct::analysis::Performance::of(&run, &file.problem).unwrap();
    let told: Vec<_> = data.segments().iter().map(|s| s.settled_after).collect();
    let measured: Vec<_> = performance.settling.iter().map(|s| s.steps).collect();
    assert_eq!(told, measured);
    let proof = data.design.certificate.clone().unwrap().unwrap();
    // The margin of `mpct verify`; one step less is too few.
    assert!(
        proof.smallest_margin > 1e-6 && proof.witness.unwrap() > 0.0,
        "{proof:?}"
    );
    assert!(
        ["x1", "x2", "u1", "u2"].contains(&proof.tightest_row.as_str()),
        "{proof:?}"
    );
    let (page, _) = check(&data);
    for part in [
        "M̃ = 5",
        "3 of them admissible",
        "x1 ≤ 3",
        "Q = 10 I",
        "does not rise",
        "smallest margin",
        "is too few",
        "number of steps",
    ] {
        assert!(page.contains(part), "{part}");
    }
}
