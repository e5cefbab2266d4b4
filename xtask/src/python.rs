//! The step that builds the Python package and tests it in a private virtual environment.

use std::env;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The oldest Python that the package supports.
const OLDEST: (u32, u32) = (3, 10);
/// Names that a Python may have.
const NAMES: [&str; 8] = [
    "python3",
    "python",
    "python3.11",
    "python3.12",
    "python3.13",
    "python3.14",
    "python3.10",
    "python3.15",
];

/// Runs a command in `folder`; the exit code of a failure.
fn run(command: &mut Command, folder: &Path) -> Result<(), u8> {
    eprintln!(
        "   {} {}",
        Path::new(command.get_program())
            .file_name()
            .unwrap_or_default()
            .to_string_lossy(),
        command
            .get_args()
            .map(OsStr::to_string_lossy)
            .collect::<Vec<_>>()
            .join(" ")
    );
    match command.current_dir(folder).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(status
            .code()
            .and_then(|c| u8::try_from(c).ok())
            .filter(|c| *c > 0)
            .unwrap_or(1)),
        Err(error) => {
            eprintln!(
                "xtask: {} cannot be started: {error}",
                command.get_program().to_string_lossy()
            );
            Err(1)
        }
    }
}

/// The version of a Python, when it is one that runs.
fn version(python: &OsStr) -> Option<(u32, u32)> {
    let told = Command::new(python)
        .args([
            "-c",
            "import sys, venv; print(*sys.version_info[:2], sep='.')",
        ])
        .output()
        .ok()
        .filter(|o| o.status.success())?;
    let text = String::from_utf8(told.stdout).ok()?;
    let (major, minor) = text.trim().split_once('.')?;
    Some((major.parse().ok()?, minor.parse().ok()?))
}

/// A Python that is new enough: that of `MPCT_PYTHON`, or one in the path.
fn find() -> Result<OsString, u8> {
    let stated = env::var_os("MPCT_PYTHON");
    let candidates: Vec<OsString> = match &stated {
        Some(path) => vec![path.clone()],
        None => NAMES.iter().map(OsString::from).collect(),
    };
    let mut seen = Vec::new();
    for candidate in candidates {
        match version(&candidate) {
            Some(v) if v >= OLDEST => return Ok(candidate),
            Some((major, minor)) => {
                seen.push(format!("{} ({major}.{minor})", candidate.to_string_lossy()));
            }
            None => {}
        }
    }
    let found = if seen.is_empty() {
        "none that has the module venv".into()
    } else {
        seen.join(", ")
    };
    eprintln!(
        "xtask: the Python package needs Python {}.{} or later; found {found}. Install one, or name it in MPCT_PYTHON.",
        OLDEST.0, OLDEST.1
    );
    Err(1)
}

/// Where cargo puts what it builds.
fn target(root: &Path) -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |t| root.join(t))
}

/// What puts pip into a virtual environment without `ensurepip`: pip's wheel can run before it is installed.
/// Debian and Ubuntu leave `ensurepip` out of their Python; it comes with the package python3-venv.
const FETCH_PIP: &str = r#"
import hashlib, os, re, runpy, sys, tempfile, urllib.parse, urllib.request
index = os.environ.get("PIP_INDEX_URL", "https://pypi.org/simple").rstrip("/") + "/pip/"
page = urllib.request.urlopen(index, timeout=60).read().decode()
links = re.findall(r'href="([^"]*/pip-(\d+)\.(\d+)(?:\.(\d+))?-py3-none-any\.whl#sha256=([0-9a-f]{64}))"', page)
# The last that supports every Python that the package does.
link, *_, digest = max((l for l in links if int(l[1]) <= 25), key=lambda l: [int(v or 0) for v in l[1:4]])
data = urllib.request.urlopen(urllib.parse.urljoin(index, link), timeout=60).read()
if hashlib.sha256(data).hexdigest() != digest:
    sys.exit("pip: the checksum of its wheel is not that of the index")
wheel = os.path.join(tempfile.mkdtemp(), urllib.parse.urlsplit(link).path.rsplit("/", 1)[1])
with open(wheel, "wb") as file:
    file.write(data)
sys.path.insert(0, wheel)
sys.argv = ["pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", wheel]
runpy.run_module("pip", run_name="__main__")
"#;

/// Makes the virtual environment, with pip.
fn create(python: &OsStr, inside: &Path, folder: &Path, root: &Path) -> Result<(), u8> {
    let venv = |options: &[&str]| {
        run(
            Command::new(python)
                .args(["-m", "venv", "--clear"])
                .args(options)
                .arg(folder),
            root,
        )
    };
    let complete = Command::new(python)
        .args(["-c", "import ensurepip"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success());
    if complete && venv(&[]).is_ok() {
        return Ok(());
    }
    eprintln!("   this Python has no ensurepip: fetching pip");
    venv(&["--without-pip"])
        .and_then(|()| {
            let program = folder.join("fetch-pip.py");
            fs::write(&program, FETCH_PIP).map_err(|_| 1)?;
            run(Command::new(inside).arg(program), root)
        })
        .inspect_err(|_| {
            eprintln!(
                "xtask: no virtual environment with pip can be made. On Debian and Ubuntu: apt install python3-venv; \
                 or name another Python in MPCT_PYTHON."
            );
        })
}

/// The Python of the virtual environment, which is made when it is missing or has other packages.
fn environment(root: &Path, requirements: &Path) -> Result<PathBuf, u8> {
    let python = find()?;
    let folder = target(root).join("python-venv");
    let inside = if cfg!(windows) {
        folder.join("Scripts").join("python.exe")
    } else {
        folder.join("bin").join("python")
    };
    let wanted = fs::read_to_string(requirements).map_err(|error| {
        eprintln!("xtask: cannot read {}: {error}", requirements.display());
        1
    })?;
    let stamp = folder.join("requirements-installed.txt");
    if fs::read_to_string(&stamp).is_ok_and(|known| known == wanted)
        && version(inside.as_os_str()).is_some()
    {
        return Ok(inside);
    }
    create(&python, &inside, &folder, root)?;
    run(
        Command::new(&inside)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"])
            .arg(requirements),
        root,
    )
    .inspect_err(|_| {
        eprintln!(
            "xtask: the tests of the Python package need packages from PyPI, or from the index that pip is told of"
        );
    })?;
    fs::write(&stamp, wanted).map_err(|error| {
        eprintln!("xtask: cannot write {}: {error}", stamp.display());
        1
    })?;
    Ok(inside)
}

/// Builds the package as pip does, and runs its tests.
pub fn test(root: &Path) -> Result<(), u8> {
    let package = root.join("crates").join("mpct-python");
    let python = environment(root, &package.join("requirements-test.txt"))?;
    let target = target(root);
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    // The tests compare the package with the command. Built as the tests of the workspace are, with the same features of the
    // dependencies: alone it would have others, and these would be compiled once more.
    run(
        Command::new(cargo).args(["build", "--quiet", "--workspace", "--all-targets"]),
        root,
    )?;
    // One build profile for tests, for the same reason.
    run(
        Command::new(&python)
            .args([
                "-m",
                "pip",
                "install",
                "--quiet",
                "--disable-pip-version-check",
                "--no-deps",
                "--force-reinstall",
                "--config-settings=build-args=--profile dev",
                ".",
            ])
            .env("CARGO_TARGET_DIR", &target),
        &package,
    )?;
    let command = target
        .join("debug")
        .join(format!("mpct{}", env::consts::EXE_SUFFIX));
    run(
        Command::new(&python)
            .args(["-m", "pytest", "--quiet", "-p", "no:cacheprovider"])
            .env("MPCT_COMMAND", command)
            .env("PYTHONDONTWRITEBYTECODE", "1"),
        &package,
    )
}
