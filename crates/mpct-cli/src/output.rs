//! Files written whole or not at all, text on standard output, and progress for people who wait.

use crate::failure::{Class, Failure};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A person starts to wonder after this long.
const PATIENCE: Duration = Duration::from_secs(1);

/// Prints to standard output. A closed pipe ends the command quietly: its reader has seen enough.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => std::process::exit(0),
        Err(error) => Err(Failure::new(
            Class::Io,
            format!("cannot write to standard output: {error}"),
        )),
        Ok(()) => Ok(()),
    }
}

/// Prints a value as one JSON document.
pub fn print_json(value: &serde_json::Value) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|e| Failure::new(Class::Io, format!("cannot write JSON: {e}")))?;
    print(&(text + "\n"))
}

/// A file that will be written: its folder is tried at once, so that no long computation ends at a closed door.
pub struct OutputFile {
    path: PathBuf,
    temporary: tempfile::NamedTempFile,
}

impl OutputFile {
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let unwritable = |error: io::Error| Failure::io("write", path, &error);
        if path.is_dir() {
            return Err(Failure::new(
                Class::Io,
                format!("cannot write {}: it is a folder", path.display()),
            ));
        }
        // An existing file that is read-only is not replaced behind its owner's back.
        if path.exists() {
            std::fs::OpenOptions::new()
                .append(true)
                .open(path)
                .map_err(unwritable)?;
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(".mpct-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let temporary = builder.tempfile_in(folder).map_err(unwritable)?;
        Ok(Self {
            path: path.to_path_buf(),
            temporary,
        })
    }

    /// Writes the content and puts it in place.
    pub fn write(mut self, content: &[u8]) -> Result<PathBuf, Failure> {
        let unwritable = |error: &io::Error| Failure::io("write", &self.path, error);
        self.temporary
            .write_all(content)
            .and_then(|()| self.temporary.as_file().sync_all())
            .map_err(|e| unwritable(&e))?;
        self.temporary
            .persist(&self.path)
            .map_err(|e| unwritable(&e.error))?;
        Ok(self.path)
    }
}

/// A bar on standard error: only on a terminal, and only once the work has lasted a second.
pub struct Waiting {
    bar: ProgressBar,
    started: Instant,
    shown: std::sync::atomic::AtomicBool,
}

impl Waiting {
    pub fn new(what: &str, total: Option<u64>) -> Self {
        let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::hidden());
        let style = match total {
            Some(_) => ProgressStyle::with_template(
                "{prefix} {bar:30} {pos}/{len} {msg} (about {eta} left)",
            ),
            None => ProgressStyle::with_template("{prefix} {spinner} {msg} ({elapsed})"),
        };
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_prefix(what.to_string());
        Self {
            bar,
            started: Instant::now(),
            shown: false.into(),
        }
    }

    fn wake(&self) {
        use std::sync::atomic::Ordering;
        if self.started.elapsed() > PATIENCE
            && io::stderr().is_terminal()
            && !self.shown.swap(true, Ordering::Relaxed)
        {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
    }

    pub fn at(&self, position: u64, message: String) {
        self.wake();
        self.bar.set_position(position);
        if !message.is_empty() {
            self.bar.set_message(message);
        }
    }

    pub fn total(&self, total: u64) {
        self.bar.set_length(total);
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
