//! The example with ellipsoids, run as a user runs it.

mod common;

use common::Folder;

const DISCS: &str = include_str!("../../../examples/academic-discs.toml");

#[test]
fn every_command_works_with_ellipsoids() {
    let folder = Folder::new();
    folder.write("discs.toml", DISCS);
    let check = folder.run(&["check", "discs.toml", "--json"]).json();
    assert_eq!(
        (&check["constraint_rows"], &check["ellipsoids"]),
        (&0.into(), &2.into())
    );
    assert_eq!(check["setpoints"][2]["limiting"][0], "ellipsoid[0]");
    let design = folder
        .run(&["design", "discs.toml", "--certificate", "c.json", "--json"])
        .json();
    assert_eq!(design["terminal_horizon"], 5);
    assert_eq!(design["minimal"], true);
    let verified = folder.run(&["verify", "c.json", "--json"]).json();
    assert_eq!(
        (&verified["terminal_horizon"], &verified["ellipsoids"]),
        (&5.into(), &2.into())
    );
    let run = folder
        .run(&[
            "simulate",
            "discs.toml",
            "--report",
            "r.html",
            "--csv",
            "r.csv",
            "--json",
        ])
        .json();
    assert!(
        run["summary"]["worst_violation"]
            .as_f64()
            .expect("a number")
            <= 1e-9
    );
    let report = std::fs::read_to_string(folder.path().join("r.html")).expect("a report");
    assert!(report.contains("under 0 constraint rows and 2 ellipsoids"));
    let sweep = folder
        .run(&["sweep", "discs.toml", "--scaling", "0.9,0.5", "--json"])
        .json();
    assert_eq!(
        (&sweep[0]["terminal_horizon"], &sweep[1]["terminal_horizon"]),
        (&5.into(), &3.into())
    );
}

#[test]
fn what_ellipsoids_do_not_have_is_told() {
    let folder = Folder::new();
    folder.write("discs.toml", DISCS);
    folder.write(
        "bad.toml",
        DISCS.replace("input = 0.25 ", "input = [1.0, -2.0] "),
    );
    let set = folder.run(&["design", "discs.toml", "--explicit-set"]);
    set.refuses(2, &["the explicit terminal set", "no polytope"]);
    let explicit = folder.run(&["simulate", "discs.toml", "--formulation", "explicit"]);
    explicit.refuses(
        2,
        &[
            "controller.formulation",
            "\"implicit\" with ellipsoidal constraints",
        ],
    );
    folder.run(&["check", "bad.toml"]).refuses(
        3,
        &[
            "constraints.ellipsoid[1].input",
            "smallest eigenvalue is -2",
        ],
    );
}
