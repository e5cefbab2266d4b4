//! Wrong files and arguments: exit code and message of each.

mod common;

use common::{Answer, Folder};

/// The double integrator with one input, well posed.
const GOOD: &str = r#"
name = "double integrator"
[plant]
A = [[1.0, 0.1], [0.0, 1.0]]
B = [[0.005], [0.1]]
[constraints]
state_lower = [-1.0, -1.0]
state_upper = [1.0, 1.0]
input_lower = [-1.0]
input_upper = [1.0]
[weights]
Q = 1.0
R = 1.0
O = 100.0
[controller]
prediction_horizon = 5
scaling = 0.9
[simulation]
initial_state = [0.0, 0.0]
steps = 20
[[simulation.setpoint]]
from_step = 0
state = [0.5, 0.0]
"#;

/// Runs `simulate` on the good file with one piece of text replaced.
fn with(old: &str, new: &str) -> Answer {
    assert!(GOOD.contains(old), "`{old}` is not in the file");
    let folder = Folder::new();
    folder.write("problem.toml", GOOD.replacen(old, new, 1));
    folder.run(&["simulate", "problem.toml", "--no-files"])
}

#[test]
fn the_good_file_is_good() {
    let answer = with("scaling = 0.9", "scaling = 0.9");
    assert_eq!(answer.code(), 0, "{}", answer.stderr());
}

#[test]
fn unknown_keys_are_named_with_a_suggestion() {
    with("state_lower =", "state_lowr =").refuses(
        2,
        &[
            "constraints.state_lowr",
            "did you mean `constraints.state_lower`",
        ],
    );
    with("[weights]", "[weight]").refuses(2, &["unknown key `weight`", "`weights`"]);
    with("steps = 20", "stepz = 20").refuses(2, &["simulation.stepz", "simulation.steps"]);
    with("name =", "task = \"tracking\"\nname =")
        .refuses(2, &["unknown key `task`", "known here: name"]);
}

#[test]
fn missing_keys_are_named_with_their_meaning() {
    with("B = [[0.005], [0.1]]", "").refuses(2, &["missing key `plant.B`", "n x m"]);
    with("O = 100.0", "").refuses(2, &["missing key `weights.O`"]);
    with("steps = 20", "").refuses(2, &["missing key `simulation.steps`"]);
    with("state = [0.5, 0.0]", "").refuses(2, &["simulation.setpoint[0].state"]);
}

#[test]
fn text_that_is_not_toml_is_named_by_line() {
    with("Q = 1.0", "Q = = 1.0").refuses(2, &["line 12", "column 5"]);
    with("Q = 1.0", "Q = 1.0\nQ = 2.0").refuses(2, &["line 13", "duplicate"]);
}

#[test]
fn values_of_the_wrong_kind() {
    with("Q = 1.0", "Q = \"one\"")
        .refuses(2, &["weights.Q", "a number, a list", "the text \"one\""]);
    with("steps = 20", "steps = 2.5").refuses(2, &["simulation.steps", "whole number", "2.5"]);
    with("steps = 20", "steps = -3").refuses(2, &["simulation.steps", "whole number", "-3"]);
    with("[controller]", "[controller]\ntask = \"traking\"")
        .refuses(2, &["controller.task", "\"tracking\"", "traking"]);
    with(
        "A = [[1.0, 0.1], [0.0, 1.0]]",
        "A = [[1.0, 0.1], [0.0, true]]",
    )
    .refuses(2, &["plant.A[1][1]", "a number", "true"]);
}

#[test]
fn matrices_of_the_wrong_shape() {
    with("[[1.0, 0.1], [0.0, 1.0]]", "[[1.0, 0.1], [0.0]]")
        .refuses(2, &["plant.A", "row 1 has 1", "row 0 has 2"]);
    with("[[1.0, 0.1], [0.0, 1.0]]", "[[1.0, 0.1]]").refuses(2, &["plant.A", "square", "1 x 2"]);
    with("[[0.005], [0.1]]", "[[0.005], [0.1], [0.2]]").refuses(2, &["plant.B", "2 rows", "3 x 1"]);
    with("[[1.0, 0.1], [0.0, 1.0]]", "[]").refuses(2, &["plant.A", "0 x 0"]);
    with("state_lower = [-1.0, -1.0]", "state_lower = [-1.0]")
        .refuses(2, &["constraints.state_lower", "2 numbers", "found 1"]);
    with("Q = 1.0", "Q = [1.0, 1.0, 1.0]").refuses(2, &["weights.Q", "2 numbers", "3 numbers"]);
    with("Q = 1.0", "Q = [[1.0]]").refuses(2, &["weights.Q", "2 x 2", "1 x 1"]);
    with("scaling = 0.9", "scaling = 0.9\ngain = [[1.0]]")
        .refuses(2, &["controller.gain", "1 x 2", "1 x 1"]);
    with(
        "A = [[1.0, 0.1], [0.0, 1.0]]",
        "A = { shape = [2, 2], entries = [[0, 5, 1.0]] }",
    )
    .refuses(2, &["plant.A.entries", "inside 2 x 2", "column 5"]);
}

#[test]
fn numbers_that_are_not_numbers() {
    with("[[1.0, 0.1], [0.0, 1.0]]", "[[1.0, nan], [0.0, 1.0]]")
        .refuses(2, &["plant.A", "[0, 1]", "NaN"]);
    with("[[0.005], [0.1]]", "[[0.005], [inf]]").refuses(2, &["plant.B", "[1, 0]", "inf"]);
    with("Q = 1.0", "Q = nan").refuses(2, &["weights.Q", "NaN"]);
    with("state_upper = [1.0, 1.0]", "state_upper = [1.0, nan]")
        .refuses(2, &["state_upper[1]", "NaN"]);
    with("state = [0.5, 0.0]", "state = [nan, 0.0]")
        .refuses(2, &["simulation.setpoint[0].state", "NaN"]);
    with("initial_state = [0.0, 0.0]", "initial_state = [0.0, inf]")
        .refuses(2, &["simulation.initial_state", "inf"]);
}

#[test]
fn weights_that_are_not_weights() {
    with("Q = 1.0", "Q = [[1.0, 0.5], [0.0, 1.0]]").refuses(
        3,
        &["weights.Q", "not symmetric", "[0, 1] is 0.5", "[1, 0] is 0"],
    );
    with("Q = 1.0", "Q = [[1.0, 2.0], [2.0, 1.0]]")
        .refuses(3, &["weights.Q", "not positive definite", "-1.0"]);
    with("Q = 1.0", "Q = [1.0, 0.0]").refuses(3, &["weights.Q", "smallest eigenvalue is 0"]);
    with("R = 1.0", "R = -1.0").refuses(3, &["weights.R", "-1"]);
}

#[test]
fn bounds_that_leave_no_room() {
    with("state_lower = [-1.0, -1.0]", "state_lower = [-1.0, 1.0]").refuses(
        2,
        &["state_lower[1]", "lower < upper", "lower 1 and upper 1"],
    );
    with("input_lower = [-1.0]", "input_lower = [2.0]")
        .refuses(2, &["input_lower[0]", "lower 2 and upper 1"]);
    with("state_lower = [-1.0, -1.0]", "state_lower = [0.0, -1.0]")
        .refuses(3, &["state_lower[0]", "origin", "operating_point"]);
    with("state_upper = [1.0, 1.0]", "state_upper = [1.0, -0.5]")
        .refuses(3, &["state_upper[1]", "-5.0"]);
    with(
        "[weights]",
        "[[constraints.mixed]]\nC = [[1.0, 0.0]]\nD = [[1.0]]\nd = [0.0]\n[weights]",
    )
    .refuses(3, &["mixed[0] row 0"]);
}

#[test]
fn plants_that_cannot_be_stabilized() {
    let text = "A = [[1.2, 0.0], [0.0, 0.5]]\nB = [[0.0], [1.0]]\n";
    let folder = Folder::new();
    let file = GOOD.replace("A = [[1.0, 0.1], [0.0, 1.0]]\nB = [[0.005], [0.1]]\n", text);
    folder.write("problem.toml", file);
    folder
        .run(&["design", "problem.toml"])
        .refuses(3, &["not stabilizable", "1.200000"]);
    folder
        .run(&["check", "problem.toml"])
        .refuses(3, &["not stabilizable", "1.200000"]);
}

#[test]
fn gains_that_do_not_stabilize() {
    with("scaling = 0.9", "scaling = 0.9\ngain = [[1.0, 1.0]]")
        .refuses(3, &["spectral radius", "must be < 1"]);
}

#[test]
fn numbers_out_of_range() {
    with("prediction_horizon = 5", "prediction_horizon = 0")
        .refuses(2, &["controller.prediction_horizon", ">= 1", "found 0"]);
    with("scaling = 0.9", "scaling = 1.0")
        .refuses(2, &["controller.scaling", "between 0 and 1", "found 1"]);
    with("scaling = 0.9", "scaling = 0.0").refuses(2, &["controller.scaling"]);
    with("scaling = 0.9", "scaling = nan").refuses(2, &["controller.scaling", "NaN"]);
    with("steps = 20", "steps = 0").refuses(2, &["simulation.steps", ">= 1"]);
    with("[constraints]", "continuous = true\n[constraints]")
        .refuses(2, &["missing key `plant.sampling_time`"]);
    with(
        "[constraints]",
        "continuous = true\nsampling_time = -1.0\n[constraints]",
    )
    .refuses(2, &["plant.sampling_time", "-1"]);
    with("state = [0.5, 0.0]", "state = [0.5]")
        .refuses(2, &["simulation.setpoint[0].state", "2 numbers", "found 1"]);
    with("initial_state = [0.0, 0.0]", "initial_state = [0.0]")
        .refuses(2, &["simulation.initial_state", "2 numbers"]);
}

#[test]
fn a_direction_that_no_constraint_sees() {
    with(
        "state_lower = [-1.0, -1.0]\nstate_upper = [1.0, 1.0]",
        "state_lower = [-inf, -1.0]\nstate_upper = [inf, 1.0]",
    )
    .refuses(3, &["no constraint bounds or observes"]);
}

#[test]
fn initial_states_outside_the_domain_of_attraction() {
    with("initial_state = [0.0, 0.0]", "initial_state = [1.5, 0.0]")
        .refuses(5, &["outside the domain of attraction", "state_upper[0]"]);
    with("initial_state = [0.0, 0.0]", "initial_state = [0.99, 0.99]")
        .refuses(5, &["step 0", "outside the domain of attraction", "proved"]);
}

#[test]
fn horizons_that_are_not_determined() {
    let folder = Folder::new();
    folder.write("problem.toml", GOOD);
    let answer = folder.run(&["design", "problem.toml", "--max-horizon", "2"]);
    answer.refuses(4, &["not determined", "support", "max_horizon"]);
}

#[test]
fn arguments_that_mean_nothing() {
    let folder = Folder::new();
    folder.write("problem.toml", GOOD);
    for arguments in [
        &["design"][..],
        &["design", "problem.toml", "--condition", "loose"],
        &["design", "problem.toml", "--max-horizon", "0"],
        &["simulate", "problem.toml", "--steps", "0"],
        &["sweep", "problem.toml"],
        &["sweep", "problem.toml", "--scaling", "0.5,x"],
        &["example", "carts", "--count", "-1"],
        &["exmaple", "carts"],
    ] {
        let answer = folder.run(arguments);
        assert_eq!(answer.code(), 2, "{arguments:?}: {}", answer.stderr());
        assert_eq!(answer.stdout(), "");
    }
    folder
        .run(&["example", "carts", "--count", "0"])
        .refuses(2, &["number of carts", "found 0"]);
    folder
        .run(&["sweep", "problem.toml", "--scaling", "0.5,1.5"])
        .refuses(2, &["controller.scaling", "1.5"]);
}

#[test]
fn files_that_cannot_be_read_or_written() {
    let folder = Folder::new();
    folder.write("problem.toml", GOOD);
    folder
        .run(&["design", "nowhere.toml"])
        .refuses(7, &["nowhere.toml"]);
    folder.run(&["design", "."]).refuses(7, &["cannot read ."]);
    folder
        .run(&[
            "simulate",
            "problem.toml",
            "--csv",
            "no/such/folder/out.csv",
        ])
        .refuses(7, &["no/such/folder/out.csv"]);
    std::fs::create_dir(folder.path().join("taken")).unwrap();
    folder
        .run(&["simulate", "problem.toml", "--report", "taken"])
        .refuses(7, &["taken", "folder"]);
    folder.write(
        "csv.toml",
        GOOD.replace("A = [[1.0, 0.1], [0.0, 1.0]]", "A = { csv = \"A.csv\" }"),
    );
    folder.run(&["design", "csv.toml"]).refuses(7, &["A.csv"]);
    folder.write("A.csv", "1.0, 0.1\n0.0, one\n");
    folder
        .run(&["design", "csv.toml"])
        .refuses(2, &["A.csv, line 2", "\"one\" is not a number"]);
    folder.write("A.csv", "1.0, 0.1\n0.0\n");
    folder
        .run(&["design", "csv.toml"])
        .refuses(2, &["A.csv, line 2", "the first line has 2"]);
    folder.write("A.csv", "1.0, 0.1\n0.0, 1.0\n");
    assert_eq!(folder.run(&["design", "csv.toml"]).code(), 0);
}

#[test]
fn a_hundred_megabytes_of_garbage() {
    let folder = Folder::new();
    // Bytes of a linear congruential generator: neither text nor a pattern.
    let mut state = 1_u64;
    let garbage: Vec<u8> = (0..100_000_000)
        .map(|_| {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 56) as u8
        })
        .collect();
    folder.write("garbage.toml", &garbage);
    folder
        .run(&["design", "garbage.toml"])
        .refuses(2, &["garbage.toml", "not a text file"]);
    folder.write("garbage.toml", vec![b'['; 100_000_000]);
    let answer = folder.run(&["design", "garbage.toml"]);
    assert_eq!(
        answer.code(),
        2,
        "{}",
        answer.stderr().chars().take(300).collect::<String>()
    );
    assert!(answer.stderr().len() < 2000);
}
