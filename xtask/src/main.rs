//! Development tasks: `cargo xtask test` runs every check of the workspace.

mod python;

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

const USAGE: &str = "usage: cargo xtask test [--slow]
       cargo xtask python

  test         format, lints, documentation, tests, examples and the Python package; stops at the first failure
    --slow     also the tests marked as slow
  python       the Python package alone, in a virtual environment of its own; needs Python 3.10 or later and PyPI";

/// A step: its name, the arguments of cargo, and what the environment adds.
struct Step {
    name: String,
    arguments: Vec<String>,
    environment: Vec<(&'static str, &'static str)>,
}

impl Step {
    fn new(name: &str, arguments: &[&str]) -> Self {
        Self {
            name: name.into(),
            arguments: arguments.iter().map(|a| (*a).into()).collect(),
            environment: Vec::new(),
        }
    }

    fn with(mut self, key: &'static str, value: &'static str) -> Self {
        self.environment.push((key, value));
        self
    }

    /// Runs the step in `root`; the exit code of a failure.
    fn run(&self, root: &Path) -> Result<(), u8> {
        let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let status = Command::new(cargo)
            .args(&self.arguments)
            .envs(self.environment.iter().copied())
            .current_dir(root)
            .status();
        match status {
            Ok(status) if status.success() => Ok(()),
            // A step that was killed has no code.
            Ok(status) => Err(status
                .code()
                .and_then(|c| u8::try_from(c).ok())
                .filter(|c| *c > 0)
                .unwrap_or(1)),
            Err(error) => {
                eprintln!("xtask: cargo cannot be started: {error}");
                Err(1)
            }
        }
    }
}

fn steps(slow: bool) -> Vec<Step> {
    let mut steps = vec![
        Step::new("format", &["fmt", "--all", "--check"]),
        Step::new(
            "lints",
            &[
                "clippy",
                "--workspace",
                "--all-targets",
                "--",
                "-D",
                "warnings",
            ],
        ),
        Step::new("tests", &["test", "--workspace", "--all-targets"]),
        // Links the online solver without std and without an allocator.
        Step::new(
            "no_std",
            &[
                "build",
                "--release",
                "--manifest-path",
                "crates/mpct-runtime/no-std-check/Cargo.toml",
                "--target-dir",
                "target/no-std-check",
            ],
        ),
        // Named apart because --all-targets leaves the examples in documentation out.
        Step::new("documented examples", &["test", "--workspace", "--doc"]),
        Step::new("documentation", &["doc", "--workspace", "--no-deps"])
            .with("RUSTDOCFLAGS", "-D warnings"),
    ];
    if slow {
        steps.insert(
            5,
            Step::new(
                "slow tests",
                &["test", "--workspace", "--all-targets", "--", "--ignored"],
            ),
        );
    }
    steps
}

/// The steps that run each Rust example of each crate.
fn examples(root: &Path) -> Vec<Step> {
    let mut found = Vec::new();
    for package in ["mpct", "mpct-cli"] {
        let folder = root.join("crates").join(package).join("examples");
        let Ok(entries) = folder.read_dir() else {
            continue;
        };
        for path in entries.flatten().map(|e| e.path()) {
            if path.extension().is_some_and(|e| e == "rs")
                && let Some(name) = path.file_stem().and_then(|n| n.to_str())
            {
                found.push(Step::new(
                    &format!("example {name}"),
                    &["run", "--quiet", "--package", package, "--example", name],
                ));
            }
        }
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

fn test(slow: bool) -> Result<(), u8> {
    let root = workspace();
    let mut all = steps(slow);
    all.extend(examples(&root));
    let mut done: Vec<(String, Duration)> = Vec::new();
    let total = Instant::now();
    let count = all.len() + 1;
    for (i, step) in all.iter().enumerate() {
        eprintln!(
            "\n== {} ({} of {count}): cargo {}",
            step.name,
            i + 1,
            step.arguments.join(" ")
        );
        let start = Instant::now();
        let result = step.run(&root);
        done.push((step.name.clone(), start.elapsed()));
        if let Err(code) = result {
            summary(&done, total.elapsed());
            eprintln!("failed: {} (exit code {code})", step.name);
            return Err(code);
        }
    }
    eprintln!("\n== Python package ({count} of {count})");
    let start = Instant::now();
    let result = python::test(&root);
    done.push(("Python package".into(), start.elapsed()));
    summary(&done, total.elapsed());
    match result {
        Ok(()) => eprintln!("all {count} steps passed"),
        Err(code) => eprintln!("failed: Python package (exit code {code})"),
    }
    result
}

fn summary(done: &[(String, Duration)], total: Duration) {
    eprintln!();
    for (name, time) in done {
        eprintln!("{:8.1} s  {name}", time.as_secs_f64());
    }
    eprintln!("{:8.1} s  in all", total.as_secs_f64());
}

/// The folder above this package.
fn workspace() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here).to_path_buf()
}

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        ["test"] => test(false),
        ["test", "--slow"] => test(true),
        ["python"] => python::test(&workspace()),
        ["help" | "--help" | "-h"] => {
            println!("{USAGE}");
            Ok(())
        }
        _ => {
            eprintln!("{USAGE}");
            Err(2)
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(code) => ExitCode::from(code),
    }
}
