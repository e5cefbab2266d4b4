//! `mpct scaling`, `compare` and `reproduce`, run as a user runs them.

use std::path::Path;
use std::process::{Command, Output};

fn mpct(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mpct"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("the command runs")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The academic case with other lines in its [controller].
fn academic(folder: &Path, name: &str, from: &str, to: &str) {
    let file = text(&mpct(folder, &["example", "academic"]));
    assert!(file.contains(from), "{file}");
    std::fs::write(folder.join(name), file.replace(from, to)).expect("written");
}

#[test]
fn scaling_says_what_set_points_need() {
    let folder = tempfile::tempdir().expect("folder");
    academic(folder.path(), "a.toml", "scaling = 0.9", "scaling = 0.9");
    let out = mpct(
        folder.path(),
        &["scaling", "a.toml", "--set-point", "2.85,0", "--json"],
    );
    assert!(out.status.success(), "{out:?}");
    let json: serde_json::Value = serde_json::from_str(&text(&out)).expect("JSON");
    let need = &json["set_points"][0];
    assert!((need["needed"].as_f64().expect("number") - 0.95).abs() < 1e-9);
    assert_eq!(need["limiting"][0], "state_upper[0]");
    assert_eq!(json["terminal_horizon"], 5);
    let out = mpct(folder.path(), &["scaling", "a.toml"]);
    assert!(text(&out).contains("no scaling admits it"), "{out:?}");
    let out = mpct(folder.path(), &["scaling", "a.toml", "--set-point", "2,x"]);
    assert_eq!(out.status.code(), Some(2));
    let out = mpct(folder.path(), &["scaling", "a.toml", "--set-point", "2"]);
    assert_eq!(out.status.code(), Some(2));
}

#[test]
fn compare_puts_two_files_side_by_side() {
    let folder = tempfile::tempdir().expect("folder");
    academic(folder.path(), "a.toml", "scaling = 0.9", "scaling = 0.9");
    academic(folder.path(), "b.toml", "scaling = 0.9", "scaling = 0.6");
    let out = mpct(
        folder.path(),
        &["compare", "a.toml", "b.toml", "--steps", "30", "--json"],
    );
    assert!(out.status.success(), "{out:?}");
    let json: serde_json::Value = serde_json::from_str(&text(&out)).expect("JSON");
    let horizon = &json["figures"][0];
    assert_eq!(
        (horizon["first"].as_f64(), horizon["second"].as_f64()),
        (Some(5.0), Some(3.0))
    );
    let out = mpct(folder.path(), &["compare", "a.toml", "none.toml"]);
    assert_eq!(out.status.code(), Some(7));
}

#[test]
fn section_3_5_is_stated_in_a_file() {
    let folder = tempfile::tempdir().expect("folder");
    let plain = "formulation = \"implicit\"";
    let with = |name: &str, extension: usize, gamma: f64| {
        let to = format!(
            "formulation = \"no_terminal_constraint\"\nhorizon_extension = {extension}\ngamma = {gamma:?}"
        );
        academic(folder.path(), name, plain, &to);
        mpct(
            folder.path(),
            &["simulate", name, "--no-files", "--steps", "20"],
        )
    };
    assert!(with("good.toml", 2, 20.0).status.success());
    for (extension, gamma, said) in [
        (5, 2.0, "terminal horizon, 5"),
        (2, 0.5, "controller.gamma"),
    ] {
        let out = with("bad.toml", extension, gamma);
        assert_eq!(out.status.code(), Some(2));
        assert!(
            String::from_utf8_lossy(&out.stderr).contains(said),
            "{out:?}"
        );
    }
    // gamma belongs to that formulation.
    academic(
        folder.path(),
        "c.toml",
        plain,
        "formulation = \"implicit\"\ngamma = 2.0",
    );
    assert_eq!(
        mpct(folder.path(), &["check", "c.toml"]).status.code(),
        Some(2)
    );
}

#[test]
fn reproduce_writes_a_page_and_data() {
    let folder = tempfile::tempdir().expect("folder");
    let out = mpct(folder.path(), &["reproduce", "--out", "r", "--short"]);
    assert!(out.status.success(), "{out:?}");
    let read =
        |name: &str| std::fs::read_to_string(folder.path().join("r").join(name)).expect(name);
    let page = read("section-4.html");
    assert_eq!(page.matches("<svg").count(), 6);
    // Self-contained: nothing is fetched.
    assert!(!page.contains("src=") && !page.contains("href="));
    let json: serde_json::Value = serde_json::from_str(&read("section-4.json")).expect("JSON");
    assert!((json["figure_2"]["d"].as_f64().expect("d") - 2.2253).abs() < 1e-4);
    assert_eq!(
        read("table-1.csv").lines().count(),
        1 + json["table_1"].as_array().expect("lines").len()
    );
    assert!(
        read("table-2.csv")
            .lines()
            .nth(1)
            .expect("three carts")
            .starts_with("3,13,")
    );
}
