//! Where files go, and what is left when something ends the command early.

mod common;

use common::Folder;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

fn academic() -> Folder {
    let folder = Folder::new();
    let text = folder.run(&["example", "academic"]).stdout();
    folder.write("case.toml", text);
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into())
        .collect();
    names.sort();
    names
}

#[test]
fn the_problem_file_is_never_overwritten() {
    let folder = academic();
    let before = fs::read(folder.path().join("case.toml")).unwrap();
    for path in ["case.toml", "./case.toml"] {
        folder
            .run(&["simulate", "case.toml", "--csv", path])
            .refuses(2, &[path, "it is the problem file"]);
    }
    folder
        .run(&["simulate", "case.toml", "--csv", "a", "--report", "./a"])
        .refuses(2, &["already another output"]);
    assert_eq!(fs::read(folder.path().join("case.toml")).unwrap(), before);
    assert_eq!(names(folder.path()), ["case.toml"]);
}

#[test]
fn long_text_is_refused_by_its_size() {
    let folder = Folder::new();
    folder.write("long.toml", vec![b'x'; 100_000_000]);
    let started = Instant::now();
    folder
        .run(&["check", "long.toml"])
        .refuses(2, &["100000000 bytes", "67108864", "sparse"]);
    assert!(started.elapsed() < Duration::from_secs(5));
}

#[test]
fn messages_name_the_line() {
    let folder = academic();
    let text = fs::read_to_string(folder.path().join("case.toml")).unwrap();
    folder.write("case.toml", text.replace("scaling =", "scalling ="));
    folder.run(&["check", "case.toml"]).refuses(
        2,
        &["case.toml: line 28: unknown key `controller.scalling`"],
    );
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::process::{Command, Stdio};

    fn simulate(folder: &Folder, csv: &str) {
        let answer = folder.run(&[
            "simulate",
            "case.toml",
            "--steps",
            "3",
            "--no-files",
            "--csv",
            csv,
        ]);
        assert_eq!(answer.code(), 0, "{}", answer.stderr());
    }

    #[test]
    fn links_are_followed_and_permissions_kept() {
        let folder = academic();
        let real = folder.write("real.csv", "old");
        fs::set_permissions(&real, fs::Permissions::from_mode(0o600)).unwrap();
        symlink("real.csv", folder.path().join("link.csv")).unwrap();
        simulate(&folder, "link.csv");
        assert!(
            folder
                .path()
                .join("link.csv")
                .symlink_metadata()
                .unwrap()
                .is_symlink()
        );
        assert!(fs::read_to_string(&real).unwrap().starts_with("k,"));
        assert_eq!(
            fs::metadata(&real).unwrap().permissions().mode() & 0o777,
            0o600
        );
    }

    #[test]
    fn pipes_are_written_to_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let folder = academic();
        let pipe = folder.path().join("pipe");
        let made = Command::new("mkfifo").arg(&pipe).status();
        assert!(made.is_ok_and(|s| s.success()), "mkfifo");
        let reader = {
            let pipe = pipe.clone();
            std::thread::spawn(move || fs::read_to_string(pipe).unwrap())
        };
        simulate(&folder, "pipe");
        assert!(fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(reader.join().unwrap().lines().count(), 4);
    }

    #[test]
    fn an_interrupt_leaves_nothing_behind() {
        let folder = academic();
        let mut child = Command::new(env!("CARGO_BIN_EXE_mpct"))
            .args(["simulate", "case.toml", "--steps", "100000000"])
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(700));
        let signal = Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status();
        assert!(signal.is_ok_and(|s| s.success()), "kill");
        assert!(!child.wait().unwrap().success());
        assert_eq!(names(folder.path()), ["case.toml"]);
    }

    /// A mode that fades over millions of steps, counted up one by one.
    const ENDLESS: &str = r#"
[plant]
A = [[0.9999999, 0.0], [0.0, 0.5]]
B = [[0.0], [1.0]]
[constraints]
state_lower = [-1.0, -1.0]
state_upper = [1.0, 1.0]
input_lower = [-1.0]
input_upper = [1.0]
mixed = [{ C = [[1.0, 1.0]], D = [[1.0]], d = [1.5] }]
[weights]
Q = 1.0
R = 1.0
O = 100.0
"#;

    #[test]
    fn an_interrupted_search_tells_what_it_knows() {
        let folder = Folder::new();
        folder.write("endless.toml", ENDLESS);
        let limits = ["--condition", "sufficient", "--max-horizon", "1000000000"];
        let child = Command::new(env!("CARGO_BIN_EXE_mpct"))
            .args(["design", "endless.toml", "--certificate", "proof.json"])
            .args(limits)
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        let signal = Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status();
        assert!(signal.is_ok_and(|s| s.success()), "kill");
        let output = child.wait_with_output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(130), "{told}");
        assert!(told.contains("the terminal horizon is at least"), "{told}");
        assert!(told.contains("rows were still open"), "{told}");
        assert_eq!(names(folder.path()), ["endless.toml"]);
    }

    /// A pipe whose reader is gone.
    fn deaf() -> Stdio {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        writer.into()
    }

    #[test]
    fn closed_pipes_end_the_command_without_a_panic() {
        let folder = academic();
        let mut command = Command::new(env!("CARGO_BIN_EXE_mpct"));
        command.current_dir(folder.path());
        let status = command.args(["check", "nowhere.toml"]).stderr(deaf());
        assert_eq!(status.status().unwrap().code(), Some(7));
        let mut command = Command::new(env!("CARGO_BIN_EXE_mpct"));
        command.args(["example", "drone"]).stdout(deaf());
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        assert!(output.stderr.is_empty());
    }
}

#[test]
fn names_do_not_steer_the_terminal() {
    let folder = academic();
    let text = fs::read_to_string(folder.path().join("case.toml")).unwrap();
    let text = text.replace("name = \"academic\"", "name = \"\\u001b[31mred\"");
    folder.write("case.toml", text);
    let answer = folder.run(&["check", "case.toml"]);
    assert_eq!(answer.code(), 0, "{}", answer.stderr());
    assert!(!answer.stdout().contains('\u{1b}'), "{}", answer.stdout());
}
