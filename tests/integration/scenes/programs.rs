//! Programs that read scenes: Python with its packages, and C++ compiled against Debian's libraries.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use libtest_mimic::Failed;

/// Where the scripts and sources are.
fn here() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/integration/scenes")
}

/// A Python.
pub(crate) struct Python(PathBuf);

impl Python {
    /// That of `RMEM_TEST_PYTHON`, the one that `.ci/run` made, or the one on PATH.
    pub(crate) fn find() -> Option<Self> {
        if let Some(named) = std::env::var_os("RMEM_TEST_PYTHON") {
            return Some(Self(named.into()));
        }
        let made = Path::new(env!("CARGO_TARGET_TMPDIR")).parent()?.join("tools/venv/bin/python");
        let found = if made.is_file() { made } else { "python3".into() };
        (found.is_absolute() || installed("python3")).then_some(Self(found))
    }

    /// The program.
    pub(crate) fn path(&self) -> &Path {
        &self.0
    }

    /// Whether a module can be imported.
    pub(crate) fn has(&self, module: &str) -> bool {
        let code = format!("import importlib.util, sys; sys.exit(importlib.util.find_spec('{module}') is None)");
        let status = Command::new(&self.0).args(["-c", &code]).stdout(Stdio::null()).stderr(Stdio::null()).status();
        status.is_ok_and(|status| status.success())
    }

    /// What a script prints.
    pub(crate) fn run(&self, script: &str, arguments: &[&str]) -> Result<String, Failed> {
        let script = here().join(script).display().to_string();
        run(&self.0, &[&[script.as_str()], arguments].concat())
    }
}

/// Whether a program is on PATH.
pub(crate) fn installed(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

/// Whether pkg-config knows a library.
pub(crate) fn has_package(name: &str) -> bool {
    let status = Command::new("pkg-config").args(["--exists", name]).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

/// A program of one source, linked with a library.
pub(crate) fn compile(folder: &Path, source: &str, package: &str) -> Result<PathBuf, Failed> {
    let flags = run(Path::new("pkg-config"), &["--cflags", "--libs", package])?;
    let program = folder.join("program");
    let source = here().join(source).display().to_string();
    let mut arguments = vec![source, "-o".to_owned(), program.display().to_string()];
    arguments.extend(flags.split_whitespace().map(str::to_owned));
    run(Path::new("g++"), &arguments)?;
    Ok(program)
}

/// What a program prints; that it fails is a failure.
pub(crate) fn run(program: &Path, arguments: &[impl AsRef<OsStr>]) -> Result<String, Failed> {
    let output = Command::new(program).args(arguments).stdin(Stdio::null()).output()?;
    if !output.status.success() {
        let printed = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{} ended with {}: {printed}", program.display(), output.status).into());
    }
    Ok(String::from_utf8(output.stdout)?)
}
