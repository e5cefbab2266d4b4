//! Runs the command in a folder of its own.
#![allow(dead_code, reason = "each test file uses its part")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, content).expect("a file in a temporary folder");
        path
    }

    pub fn run(&self, arguments: &[&str]) -> Answer {
        let output = Command::new(env!("CARGO_BIN_EXE_mpct"))
            .args(arguments)
            .current_dir(self.path())
            .output()
            .expect("the command starts");
        Answer(output)
    }
}

#[derive(Debug)]
pub struct Answer(Output);

impl Answer {
    pub fn code(&self) -> i32 {
        self.0.status.code().expect("an exit code and not a signal")
    }

    pub fn stdout(&self) -> String {
        String::from_utf8(self.0.stdout.clone()).expect("text")
    }

    pub fn stderr(&self) -> String {
        String::from_utf8(self.0.stderr.clone()).expect("text")
    }

    /// The JSON document on standard output, of a command that succeeded.
    pub fn json(&self) -> serde_json::Value {
        assert_eq!(self.code(), 0, "{}", self.stderr());
        serde_json::from_str(&self.stdout()).expect("one JSON document and nothing else")
    }

    /// Asserts the exit code, and that the message on standard error has every part.
    pub fn refuses(&self, code: i32, parts: &[&str]) {
        let message = self.stderr();
        assert_eq!(self.code(), code, "{message}");
        assert!(message.starts_with("error: "), "{message}");
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
        assert_eq!(self.stdout(), "", "nothing on standard output");
    }
}
