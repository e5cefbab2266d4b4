//! `mpct scaling`, `domain`, `compare` and `reproduce`, and pictures, run as a user runs them.

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
    let out = mpct(
        folder.path(),
        &["reproduce", "--out", "r", "--short", "--png"],
    );
    assert!(out.status.success(), "{out:?}");
    let read =
        |name: &str| std::fs::read_to_string(folder.path().join("r").join(name)).expect(name);
    let page = read("section-4.html");
    assert_eq!(page.matches("<svg").count(), 6);
    assert_eq!(page.matches("Unsaid, and chosen here.").count(), 5);
    for name in [
        "figure-1",
        "figure-2",
        "figure-3-px",
        "figure-3-py",
        "figure-3-pz",
        "figure-3-path",
    ] {
        is_png(&folder.path().join("r").join(format!("{name}.png")));
    }
    // Self-contained: nothing is fetched.
    assert!(!page.contains("src=") && !page.contains("href="));
    let json: serde_json::Value = serde_json::from_str(&read("section-4.json")).expect("JSON");
    assert!(
        json["machine"]
            .as_str()
            .is_some_and(|m| m.contains("threads"))
    );
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

/// A PNG file of more than 100 × 100 pixels.
fn is_png(path: &Path) {
    let bytes = std::fs::read(path).expect("a picture");
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n", "{}", path.display());
    for at in [16, 20] {
        let pixels = u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        assert!(pixels > 100, "{}: {pixels}", path.display());
    }
}

fn json(out: &Output) -> serde_json::Value {
    serde_json::from_str(&text(out)).expect("JSON")
}

#[test]
fn domain_answers_about_states_with_proofs() {
    let folder = tempfile::tempdir().expect("folder");
    academic(folder.path(), "a.toml", "scaling = 0.9", "scaling = 0.9");
    let out = mpct(
        folder.path(),
        &["domain", "a.toml", "--state", "2,1", "--json"],
    );
    assert_eq!(out.status.code(), Some(0), "{out:?}");
    assert_eq!(json(&out)["sets"][0]["states"][0]["inside"], true);
    // x1⁺ = x1 + x2 + u2/2 ≥ 4.9 − 1 > 3: outside, and the answer is on standard output all the same.
    let out = mpct(
        folder.path(),
        &[
            "domain",
            "a.toml",
            "--state",
            "2,1",
            "--state=2.9,2",
            "--json",
        ],
    );
    assert_eq!(out.status.code(), Some(5), "{out:?}");
    let told = json(&out);
    let proof = &told["sets"][0]["states"][1]["proof"]["outside"];
    assert!(proof["gap"].as_f64().expect("gap") > 0.0);
    assert_eq!(proof["rows"][0][0], "state_upper[0] at step 1");
    let out = mpct(folder.path(), &["domain", "a.toml", "--state=2.9,2"]);
    assert!(
        text(&out).contains("outside; rows contradict each other"),
        "{out:?}"
    );
}

#[test]
fn domain_compares_sets_and_draws_them() {
    let folder = tempfile::tempdir().expect("folder");
    academic(
        folder.path(),
        "a.toml",
        "formulation = \"implicit\"",
        "formulation = \"no_terminal_constraint\"\nhorizon_extension = 2\ngamma = 20.0\nalpha = 25.0",
    );
    let ask = |scope: &str| {
        mpct(
            folder.path(),
            &[
                "domain",
                "a.toml",
                "--set",
                "implicit",
                "--set",
                "explicit",
                "--set",
                "regulation",
                "--set",
                "no_terminal_constraint",
                "--set",
                "stability_region",
                "--scope",
                scope,
                "--set-point=-0.5688,-0.0523",
                "--direction",
                "1,0",
                "--outline",
                "x1,x2",
                "--volume",
                "--picture",
                "sets.png",
                "--json",
            ],
        )
    };
    let out = ask("throughout_region");
    assert_eq!(out.status.code(), Some(0), "{out:?}");
    let told = json(&out);
    let area = |k: usize| told["sets"][k]["outline"]["area"].as_f64().expect("area");
    // As stored for Figures 1 and 2.
    for (k, stored) in [32.0, 32.0, 32.0, 32.0, 25.9687].into_iter().enumerate() {
        assert!((area(k) - stored).abs() < 1e-3 * stored, "{k}: {}", area(k));
        let volume = told["sets"][k]["volume"]["value"].as_f64().expect("volume");
        assert!((volume - area(k)).abs() < 1e-9);
        let reach = &told["sets"][k]["reach"][0];
        assert!(reach["at_most"].as_f64() >= reach["distance"].as_f64());
    }
    is_png(&folder.path().join("sets.png"));
    // The default scope asks for every admissible equilibrium, where the paper's alpha is too large.
    let out = ask("every_equilibrium");
    assert_eq!(out.status.code(), Some(2));
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    for part in ["controller.alpha", "1.8447", "83.05", "found 25"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

#[test]
fn domain_refuses_questions_without_sense() {
    let folder = tempfile::tempdir().expect("folder");
    academic(folder.path(), "a.toml", "scaling = 0.9", "scaling = 0.9");
    let drone = text(&mpct(folder.path(), &["example", "drone"]));
    std::fs::write(folder.path().join("d.toml"), drone).expect("written");
    for (arguments, said) in [
        (&["a.toml", "--direction", "0,0"][..], "not 0"),
        (&["a.toml", "--direction", "1"], "direction"),
        (&["a.toml", "--outline", "0,0"], "0 and 0"),
        (&["a.toml", "--outline", "x1,7"], "0 and 7"),
        (&["a.toml", "--section", "x1"], "two states"),
        (
            &["a.toml", "--outline", "x1,velocity"],
            "the states are x1, x2",
        ),
        (&["a.toml", "--state", "1,nan"], "NaN"),
        (&["a.toml", "--state", "1,2,3"], "state"),
        (
            &["a.toml", "--direction", "1,0", "--from", "9,9"],
            "outside by",
        ),
        (
            &["a.toml", "--outline", "0,1", "--picture", "p.jpg"],
            ".png",
        ),
        (
            &["a.toml", "--outline", "0,1", "--picture", "a.toml"],
            "not in .toml",
        ),
        (
            &["a.toml", "--set", "stability_region"],
            "horizon_extension",
        ),
        (&["d.toml", "--volume"], "found 12"),
        (&["d.toml", "--picture", "p.png"], "--outline px,py"),
    ] {
        let mut all = vec!["domain"];
        all.extend(arguments);
        let out = mpct(folder.path(), &all);
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(said), "{arguments:?}: {message}");
        assert_eq!(text(&out), "", "{arguments:?}");
    }
    assert!(!folder.path().join("p.png").exists() && !folder.path().join("p.jpg").exists());
    // alpha <= 0 is refused when the file is read.
    for alpha in ["0.0", "-1.0", "nan"] {
        academic(
            folder.path(),
            "b.toml",
            "formulation = \"implicit\"",
            &format!(
                "formulation = \"no_terminal_constraint\"\nhorizon_extension = 2\ngamma = 20.0\nalpha = {alpha}"
            ),
        );
        let out = mpct(folder.path(), &["check", "b.toml"]);
        assert_eq!(out.status.code(), Some(2), "{out:?}");
        assert!(String::from_utf8_lossy(&out.stderr).contains("controller.alpha"));
    }
}

#[test]
fn without_terminal_constraint_a_run_says_whether_the_region_was_met() {
    let folder = tempfile::tempdir().expect("folder");
    let run = |alpha: &str| {
        academic(
            folder.path(),
            "a.toml",
            "formulation = \"implicit\"",
            &format!(
                "formulation = \"no_terminal_constraint\"\nhorizon_extension = 2\ngamma = 20.0\n{alpha}"
            ),
        );
        let out = mpct(
            folder.path(),
            &["simulate", "a.toml", "--report", "r.html", "--csv", "r.csv"],
        );
        assert!(out.status.success(), "{out:?}");
        let page = std::fs::read_to_string(folder.path().join("r.html")).expect("page");
        (text(&out), page)
    };
    let (said, page) = run("");
    assert!(said.contains("stability region"), "{said}");
    assert!(
        page.contains("Stability region") && page.contains("smallest margin"),
        "{page}"
    );
    let (said, page) = run("alpha = 1e6");
    assert!(
        said.contains("controller.alpha") && page.contains("not examined"),
        "{said}"
    );
}

#[test]
fn a_design_without_terminal_constraint_tells_its_levels() {
    let folder = tempfile::tempdir().expect("folder");
    let design = |extension: usize| {
        academic(
            folder.path(),
            "a.toml",
            "formulation = \"implicit\"",
            &format!(
                "formulation = \"no_terminal_constraint\"\nhorizon_extension = {extension}\ngamma = 20.0\nalpha = 25.0"
            ),
        );
        let json = mpct(folder.path(), &["design", "a.toml", "--json"]);
        (json, mpct(folder.path(), &["design", "a.toml"]))
    };
    let (told, said) = design(2);
    let alpha = &json(&told)["levels"]["alpha"];
    // The independent value for every equilibrium at a scaling of 0.9.
    assert!((alpha[0]["largest_alpha"].as_f64().expect("alpha") - 1.845).abs() < 1e-3);
    assert!((alpha[0]["d"].as_f64().expect("d") - 2.2253 * 1.8448 / 25.0).abs() < 1e-4);
    assert!(text(&said).contains("25 is too large"), "{said:?}");
    for out in <[Output; 2]>::from(design(5)) {
        assert_eq!(out.status.code(), Some(2), "{out:?}");
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(
            message.contains("terminal horizon, 5") && message.contains("implicit"),
            "{message}"
        );
    }
}

#[test]
fn pictures_are_png_when_asked_for() {
    let folder = tempfile::tempdir().expect("folder");
    academic(folder.path(), "a.toml", "scaling = 0.9", "scaling = 0.9");
    let draw = |name: &str| {
        mpct(
            folder.path(),
            &[
                "simulate",
                "a.toml",
                "--steps",
                "20",
                "--no-files",
                "--picture",
                name,
            ],
        )
    };
    assert!(draw("p.png").status.success());
    is_png(&folder.path().join("p.png"));
    assert!(draw("p.svg").status.success());
    let svg = std::fs::read_to_string(folder.path().join("p.svg")).expect("SVG");
    assert!(svg.starts_with("<svg"));
    let out = draw("p.gif");
    assert_eq!(out.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&out.stderr).contains(".svg or .png"));
}

#[cfg(target_os = "linux")]
#[test]
fn open_shows_the_report_where_there_is_a_screen() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("folder");
    academic(folder.path(), "a.toml", "scaling = 0.9", "scaling = 0.9");
    // A program for pages that writes down what it was given.
    let program = folder.path().join("xdg-open");
    std::fs::write(&program, "#!/bin/sh\necho \"$1\" > \"$(dirname \"$0\")/shown.part\"\nmv \"$(dirname \"$0\")/shown.part\" \"$(dirname \"$0\")/shown\"\n").expect("written");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("made");
    let run = |display: &str, arguments: &[&str]| {
        let path = format!("{}:/usr/bin:/bin", folder.path().display());
        let mut all = vec!["simulate", "a.toml", "--steps", "5"];
        all.extend(arguments);
        Command::new(env!("CARGO_BIN_EXE_mpct"))
            .current_dir(folder.path())
            .args(all)
            .env("PATH", path)
            .env("DISPLAY", display)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WSL_DISTRO_NAME")
            .output()
            .expect("the command runs")
    };
    // Without a screen: a message, and no failure.
    let out = run("", &["--open"]);
    assert_eq!(out.status.code(), Some(0), "{out:?}");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(
        said.contains("no screen") && said.contains("a.html"),
        "{said}"
    );
    let shown = folder.path().join("shown");
    assert!(!shown.exists() && folder.path().join("a.html").exists());
    let out = run(":0", &["--open"]);
    assert_eq!(out.status.code(), Some(0), "{out:?}");
    for _ in 0..100 {
        if shown.exists() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let told = std::fs::read_to_string(&shown).expect("the program was started");
    assert!(told.trim().ends_with("a.html"), "{told}");
    // Nothing to open is a contradiction.
    let out = run(":0", &["--open", "--no-files"]);
    assert_eq!(out.status.code(), Some(2), "{out:?}");
}
