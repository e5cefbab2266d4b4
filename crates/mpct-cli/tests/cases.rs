//! The drone and the carts through the command, from the printed file to the end of the closed loop.

mod common;

use common::Folder;
use serde_json::Value;
use std::f64::consts::FRAC_PI_4;

fn numbers(v: &Value) -> Vec<f64> {
    let list = v.as_array().expect("a list");
    list.iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// Within `bound` in size, up to the tolerance of the contract.
fn inside(values: &[f64], bound: impl Fn(usize) -> f64) -> bool {
    let mut sized = values.iter().enumerate();
    sized.all(|(i, v)| v.abs() <= bound(i) + 1e-8)
}

/// Inside the constraints at every step, cost falling between set-point changes, horizon as published.
fn closed_loop(
    case: &[&str],
    steps: usize,
    horizon: u64,
    state: impl Fn(usize) -> f64,
    input: impl Fn(usize) -> f64,
) -> Value {
    let folder = Folder::new();
    let mut arguments = vec!["example"];
    arguments.extend(case);
    folder.write("case.toml", folder.run(&arguments).stdout());
    let run = folder.run(&["simulate", "case.toml", "--json"]).json();
    assert_eq!(run["terminal_horizon"], horizon);
    let list = run["steps"].as_array().expect("steps");
    assert_eq!(list.len(), steps);
    for (k, step) in list.iter().enumerate() {
        assert!(inside(&numbers(&step["x"]), &state), "step {k}");
        assert!(inside(&numbers(&step["u"]), &input), "step {k}");
    }
    for (k, pair) in list.windows(2).enumerate() {
        if pair[0]["setpoint"] == pair[1]["setpoint"] {
            let (now, next) = (pair[0]["cost"].as_f64(), pair[1]["cost"].as_f64());
            let (now, next) = (now.unwrap(), next.unwrap());
            assert!(next <= now + 1e-6 * (1.0 + now), "step {k}: {now} {next}");
        }
    }
    run
}

#[test]
// The limit of the angles as the problem file rounds it.
#[allow(clippy::approx_constant)]
fn the_drone_flies_through_its_set_points() {
    let run = closed_loop(
        &["drone"],
        900,
        92,
        |i| if (6..9).contains(&i) { FRAC_PI_4 } else { 3.0 },
        |i| if i == 0 { 1.5 } else { 0.043 },
    );
    let last = numbers(&run["summary"]["final_artificial_state"]);
    assert!((last[2] - 0.5).abs() < 1e-3 && last[0].abs() < 1e-3);
}

#[test]
fn the_carts_follow_their_set_points() {
    let run = closed_loop(
        &["carts", "--count", "5"],
        600,
        13,
        |i| if i % 2 == 0 { 4.0 } else { 1.0 },
        |_| 1.0,
    );
    let last = numbers(&run["summary"]["final_artificial_state"]);
    let positions = last.iter().step_by(2);
    assert!(positions.clone().all(|r| (r - 0.3).abs() < 1e-3));
}
