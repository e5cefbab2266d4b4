//! What the commands print and write.

mod common;

use common::Folder;
use serde_json::Value;

fn example(folder: &Folder, arguments: &[&str]) -> String {
    let mut all = vec!["example"];
    all.extend(arguments);
    let answer = folder.run(&all);
    assert_eq!(answer.code(), 0, "{}", answer.stderr());
    folder.write("case.toml", answer.stdout());
    "case.toml".into()
}

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array()
        .expect("a list")
        .iter()
        .map(|x| x.as_f64().expect("a number"))
        .collect()
}

/// Terminal horizons at the scaling of the file, exact and sufficient (paper, tables 1 and 2; the rest computed).
#[test]
fn designs_have_the_published_horizons() {
    for (case, exact, sufficient) in [
        (&["academic"][..], 5, Some(6)),
        (&["drone"], 92, Some(119)),
        (&["carts", "--count", "3"], 13, None),
    ] {
        let folder = Folder::new();
        let file = example(&folder, case);
        let design = folder.run(&["design", &file, "--json"]).json();
        assert_eq!(design["terminal_horizon"], exact, "{case:?}");
        assert_eq!(design["condition"], "exact");
        if let Some(horizon) = sufficient {
            let design = folder
                .run(&["design", &file, "--condition", "sufficient", "--json"])
                .json();
            assert_eq!(design["terminal_horizon"], horizon, "{case:?}");
            assert_eq!(design["condition"], "sufficient");
        }
    }
}

#[test]
fn design_prints_every_key() {
    let folder = Folder::new();
    let file = example(&folder, &["academic"]);
    let design = folder
        .run(&["design", &file, "--explicit-set", "--json"])
        .json();
    assert_eq!(
        (design["n"].as_u64(), design["m"].as_u64()),
        (Some(2), Some(2))
    );
    assert_eq!(design["scaling"], 0.9);
    assert_eq!(design["task"], "tracking");
    for (key, rows, columns) in [("gain", 2, 2), ("terminal_weight", 2, 2)] {
        let m = design[key].as_array().expect(key);
        assert_eq!(m.len(), rows);
        assert!(m.iter().all(|r| numbers(r).len() == columns));
    }
    let basis = &design["steady_state_basis"];
    assert_eq!(basis["state"].as_array().map(Vec::len), Some(2));
    assert_eq!(basis["input"].as_array().map(Vec::len), Some(2));
    assert!(
        design["spectral_radius"]
            .as_f64()
            .is_some_and(|r| r > 0.0 && r < 1.0)
    );
    assert_eq!(design["constraint_rows"], 16);
    assert!(
        design["terminal_rows"]
            .as_u64()
            .is_some_and(|r| r > 8 && r <= 48)
    );
    assert!(design["linear_programs"].as_u64().is_some_and(|r| r > 0));
    assert!(design["seconds"].as_f64().is_some_and(|s| s > 0.0));
    let without = folder.run(&["design", &file, "--json"]).json();
    assert!(without.get("terminal_rows").is_none());
}

#[test]
fn simulate_prints_steps_and_writes_report_and_trajectories() {
    let folder = Folder::new();
    let file = example(&folder, &["academic"]);
    let json = folder.run(&["simulate", &file, "--json"]).json();
    let steps = json["steps"].as_array().expect("steps");
    assert_eq!(steps.len(), 210);
    for (k, step) in steps.iter().enumerate() {
        assert_eq!(step["k"], k);
        for key in ["x", "u", "artificial_state", "artificial_input", "setpoint"] {
            assert_eq!(numbers(&step[key]).len(), 2, "{key}");
        }
        for key in ["cost", "iterations", "solve_seconds"] {
            assert!(step[key].is_number(), "{key}");
        }
        assert_eq!(step["status"], "optimal");
        // Inside the constraints, and a step of the plant from the one before.
        let (x, u) = (numbers(&step["x"]), numbers(&step["u"]));
        assert!(x.iter().all(|v| v.abs() <= 3.0 + 1e-8) && u.iter().all(|v| v.abs() <= 2.0 + 1e-8));
        if let Some(next) = steps.get(k + 1) {
            let next = numbers(&next["x"]);
            assert!((next[0] - (x[0] + x[1] + 0.5 * u[1])).abs() < 1e-12);
            assert!((next[1] - (x[1] + u[0] + 0.5 * u[1])).abs() < 1e-12);
        }
    }
    let summary = &json["summary"];
    assert!(summary["cumulative_cost"].as_f64().is_some_and(|c| c > 0.0));
    // The last set-point is not admissible; the closest equilibrium is.
    for (found, expected) in numbers(&summary["final_state"]).iter().zip([2.7, 0.9]) {
        assert!((found - expected).abs() < 1e-6, "{found}");
    }
    assert!(
        !folder.path().join("case.html").exists(),
        "--json writes no files of its own"
    );

    let answer = folder.run(&[
        "simulate",
        &file,
        "--steps",
        "30",
        "--formulation",
        "explicit",
    ]);
    assert_eq!(answer.code(), 0, "{}", answer.stderr());
    assert!(
        answer.stdout().contains("terminal horizon       5"),
        "{}",
        answer.stdout()
    );
    let html = std::fs::read_to_string(folder.path().join("case.html")).expect("a report");
    assert!(html.starts_with("<!DOCTYPE html>") && html.contains("<svg"));
    let csv = std::fs::read_to_string(folder.path().join("case.csv")).expect("trajectories");
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 31);
    assert!(lines[0].starts_with("k,x[0],x[1],u[0],u[1],artificial_state[0]"));
    // No temporary file is left behind.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn sweep_shows_the_shape_of_table_1() {
    let folder = Folder::new();
    let file = example(&folder, &["academic"]);
    let list = folder
        .run(&[
            "sweep",
            &file,
            "--scaling",
            "0.99,0.89,0.79,0.69,0.59,0.49,0.39",
            "--json",
        ])
        .json();
    let list = list.as_array().expect("a list");
    let horizons: Vec<u64> = list
        .iter()
        .map(|l| l["terminal_horizon"].as_u64().unwrap())
        .collect();
    assert_eq!(horizons, [10, 5, 4, 3, 3, 3, 2]);
    let costs: Vec<f64> = list
        .iter()
        .map(|l| l["cumulative_cost"].as_f64().unwrap())
        .collect();
    assert!(
        costs.windows(2).all(|c| c[0] < c[1]),
        "the cost grows as the scaling falls: {costs:?}"
    );
    assert!(
        list.iter()
            .all(|l| l["scaling"].is_number() && l["design_seconds"].is_number())
    );
}

#[test]
fn files_in_physical_coordinates() {
    let folder = Folder::new();
    let shifted = r#"
[plant]
A = [[0.9]]
B = [[1.0]]
operating_point = { state = [20.0], input = [5.0] }
[constraints]
state_lower = [15.0]
state_upper = [30.0]
input_lower = [4.0]
input_upper = [inf]
[weights]
Q = 1.0
R = 1.0
O = 1000.0
[simulation]
initial_state = [18.0]
steps = 120
[[simulation.setpoint]]
from_step = 0
state = [26.0]
"#;
    folder.write("shifted.toml", shifted);
    let json = folder.run(&["simulate", "shifted.toml", "--json"]).json();
    assert_eq!(numbers(&json["steps"][0]["x"]), [18.0]);
    let last = numbers(&json["summary"]["final_state"])[0];
    // x − 20 = 6 is an equilibrium with u − 5 = 0.6, inside 0.9 times the room of 10 upwards.
    assert!((last - 26.0).abs() < 1e-6, "{last}");
    let u = numbers(&json["steps"][119]["u"])[0];
    assert!((u - 5.6).abs() < 1e-6, "{u}");
}

#[test]
fn two_hundred_carts_are_printed_and_checked() {
    let folder = Folder::new();
    let file = example(&folder, &["carts", "--count", "200"]);
    let text = std::fs::read_to_string(folder.path().join(&file)).unwrap();
    assert!(text.contains("shape = [400, 400]"));
    assert_eq!(
        folder.run(&["example", "carts", "--count", "200"]).stdout(),
        text
    );
}

#[test]
fn help_and_version_succeed() {
    let folder = Folder::new();
    for argument in ["--help", "--version", "help"] {
        let answer = folder.run(&[argument]);
        assert_eq!(answer.code(), 0);
        assert!(answer.stdout().contains("mpct"));
    }
}

#[test]
fn a_certificate_is_written_and_verified() {
    let folder = Folder::new();
    let text = folder.run(&["example", "drone"]).stdout();
    folder.write("drone.toml", text);
    let design = folder.run(&["design", "drone.toml", "--certificate", "proof.json"]);
    assert_eq!(design.code(), 0, "{}", design.stderr());
    let verified = folder.run(&["verify", "proof.json"]);
    assert_eq!(verified.code(), 0, "{}", verified.stderr());
    let text = verified.stdout();
    assert!(text.contains("terminal horizon 92"), "{text}");
    assert!(text.contains("stays admissible for ever"), "{text}");
    let json = folder.run(&["verify", "proof.json", "--json"]).json();
    assert_eq!(json["terminal_horizon"], 92);
    assert_eq!(json["rows_to_tolerance"], 0);
    assert!(json["smallest_margin"].as_f64().is_some_and(|m| m > 0.0));

    let path = folder.path().join("proof.json");
    let true_text = std::fs::read_to_string(&path).unwrap();
    let claim = "\"terminal_horizon\":92";
    assert!(true_text.contains(claim));
    folder.write(
        "proof.json",
        true_text.replace(claim, "\"terminal_horizon\":91"),
    );
    folder
        .run(&["verify", "proof.json"])
        .refuses(2, &["the digest does not fit", "--ignore-digest"]);
    folder
        .run(&["verify", "proof.json", "--ignore-digest"])
        .refuses(2, &["refused", "terminal horizon"]);
    folder
        .run(&["verify", "drone.toml"])
        .refuses(2, &["not a certificate"]);
    folder
        .run(&["verify", "nowhere.json"])
        .refuses(7, &["nowhere.json"]);
}
