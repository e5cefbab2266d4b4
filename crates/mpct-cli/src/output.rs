//! Files written whole or not at all, text on standard output, and progress for people who wait.

use crate::failure::{Class, Failure};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::borrow::Cow;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A person starts to wonder after this long.
const PATIENCE: Duration = Duration::from_secs(1);

/// The text without characters that steer a terminal: names come from files of other people.
fn plain(text: &str) -> Cow<'_, str> {
    let steers = |c: char| c.is_control() && c != '\n' && c != '\t';
    if text.contains(steers) {
        text.replace(steers, "\u{fffd}").into()
    } else {
        text.into()
    }
}

/// Prints a line on standard error, when there is anyone to read it.
pub fn note(text: &str) {
    // Nothing is left to tell of a failure here.
    let _ = writeln!(io::stderr(), "{}", plain(text));
}

/// Prints to standard output. A closed pipe ends the command quietly: its reader has seen enough.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out
        .write_all(plain(text).as_bytes())
        .and_then(|()| out.flush())
    {
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

/// A file that will be written: its place is tried at once, so that no long computation ends at a closed door.
/// Nothing is left there until the content is whole, also when the command is interrupted.
pub struct OutputFile {
    /// As the user named it.
    path: PathBuf,
    place: Place,
}

enum Place {
    /// A file that is put in place whole, links resolved.
    File(PathBuf),
    /// A pipe or a device: written to and never replaced.
    Stream,
}

impl OutputFile {
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let unwritable = |error: io::Error| Failure::io("write", path, &error);
        let path_buf = path.to_path_buf();
        if let Ok(found) = std::fs::metadata(path) {
            if found.is_dir() {
                return Err(Failure::new(
                    Class::Io,
                    format!("cannot write {}: it is a folder", path.display()),
                ));
            }
            if !found.is_file() {
                return Ok(Self {
                    path: path_buf,
                    place: Place::Stream,
                });
            }
            // An existing file that is read-only is not replaced behind its owner's back.
            std::fs::OpenOptions::new()
                .append(true)
                .open(path)
                .map_err(unwritable)?;
        }
        let target = resolved(path).map_err(unwritable)?;
        // Made and removed at once.
        temporary_beside(&target).map_err(unwritable)?;
        Ok(Self {
            path: path_buf,
            place: Place::File(target),
        })
    }

    /// Refuses outputs that would overwrite the file `input` or each other.
    pub fn all_apart<'a>(
        input: &Path,
        outputs: impl IntoIterator<Item = &'a Self>,
    ) -> Result<(), Failure> {
        let mut taken = vec![(resolved(input).ok(), "the problem file")];
        for output in outputs {
            let Place::File(target) = &output.place else {
                continue;
            };
            if let Some((_, what)) = taken.iter().find(|t| t.0.as_ref() == Some(target)) {
                let name = output.path.display();
                return Err(Failure::new(
                    Class::Input,
                    format!("cannot write {name}: it is {what}"),
                )
                .help("name another file with --report, --csv or --picture"));
            }
            taken.push((Some(target.clone()), "already another output"));
        }
        Ok(())
    }

    /// Writes the content and puts it in place.
    pub fn write(self, content: &[u8]) -> Result<PathBuf, Failure> {
        let written = match &self.place {
            Place::File(target) => put(target, content),
            Place::Stream => std::fs::OpenOptions::new()
                .write(true)
                .open(&self.path)
                .and_then(|mut stream| stream.write_all(content)),
        };
        match written {
            Ok(()) => Ok(self.path),
            Err(error) => Err(Failure::io("write", &self.path, &error)),
        }
    }
}

/// The path with all links followed; its last part need not exist.
fn resolved(path: &Path) -> io::Result<PathBuf> {
    if let Ok(target) = path.canonicalize() {
        return Ok(target);
    }
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "it names no file"))?;
    Ok(folder.canonicalize()?.join(name))
}

fn temporary_beside(target: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".mpct-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(target.parent().unwrap_or(Path::new(".")))
}

/// Writes beside the target and renames: whole or not at all. A file that is replaced keeps its permissions.
fn put(target: &Path, content: &[u8]) -> io::Result<()> {
    let mut temporary = temporary_beside(target)?;
    if let Ok(replaced) = std::fs::metadata(target) {
        temporary
            .as_file()
            .set_permissions(replaced.permissions())?;
    }
    temporary.write_all(content)?;
    temporary.as_file().sync_all()?;
    temporary.persist(target).map_err(|e| e.error)?;
    Ok(())
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
