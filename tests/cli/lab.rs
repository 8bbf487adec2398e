//! A folder to run rmem in, cut off from the machine's settings.

pub(crate) mod watch;

use std::fmt;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A temporary folder with a home of its own; `domains`, `templates`, `fixtures` and `examples` are at hand in it.
pub(crate) struct Lab {
    folder: tempfile::TempDir,
    environment: Vec<(String, String)>,
}

/// How a run ended. Prints as stdout, stderr and exit code together, for snapshots.
pub(crate) struct Finished {
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    pub(crate) code: i32,
}

/// The root of the project.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The program under test.
pub(crate) fn rmem() -> PathBuf {
    assert_cmd::cargo::cargo_bin!("rmem").to_path_buf()
}

/// The blocks world with a goal: the words that make a problem of it.
pub(crate) const TASK: [&str; 8] = [
    "--load",
    "fixtures/blocksworld.json",
    "--domain",
    "domains/blocksworld/domain.pddl",
    "--template",
    "templates/blocksworld/problem.pddl.j2",
    "--goal",
    "(and (on A B) (on B C))",
];

/// Runs `rmem plan` on the blocks world.
#[track_caller]
pub(crate) fn plan(lab: &Lab, more: &[&str]) -> Finished {
    lab.rmem(&[&["plan"], &TASK[..], more].concat())
}

/// A lab with three documents in `robmem.worldmodel`.
pub(crate) fn three_documents() -> Lab {
    let lab = Lab::new();
    lab.rmem(&[
        "insert",
        "robmem.worldmodel",
        "{_id: 1, relation: 'on-table', object: 'A', n: 3}",
        "{_id: 2, relation: 'on-table', object: 'C', n: NumberLong(4)}",
        "{_id: 3, relation: 'on', object_top: 'D', object_bottom: 'A', n: 1.5}",
    ])
    .success();
    lab
}

/// Runs a command on the world model of the kitchen.
#[track_caller]
pub(crate) fn kitchen(lab: &Lab, args: &[&str]) -> Finished {
    lab.rmem(&[&["--memory", "mem:", "--load", "fixtures/scenes/kitchen.json"], args].concat())
}

/// Compares how a run ended with an inline snapshot: stdout, stderr and exit code together, without what differs from
/// run to run.
macro_rules! assert_run {
    ($run:expr, @$expected:literal) => {
        $crate::lab::settings().bind(|| insta::allow_duplicates! { insta::assert_snapshot!($run, @$expected) })
    };
}
pub(crate) use assert_run;

/// What differs from run to run, and what a snapshot has in its place.
const VARYING: [(&str, &str); 4] = [
    (r"\b[0-9a-f]{24}\b", "[ID]"),
    (r"\b\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z", "[TIME]"),
    (r"\b\d+(\.\d+)? (ms|s)\b", "[DURATION]"),
    (r#""((?:milli)?seconds)":[0-9.e-]+"#, "\"$1\":[DURATION]"),
];

/// The settings of every snapshot.
pub(crate) fn settings() -> insta::Settings {
    let mut settings = insta::Settings::clone_current();
    VARYING.iter().for_each(|(pattern, instead)| settings.add_filter(pattern, *instead));
    settings
}

impl Lab {
    pub(crate) fn new() -> Self {
        let lab = Self::empty();
        for name in ["domains", "templates", "fixtures", "examples", "python"] {
            std::os::unix::fs::symlink(root().join(name), lab.path().join(name)).unwrap();
        }
        lab
    }

    /// An empty folder.
    pub(crate) fn empty() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), environment: Vec::new() }
    }

    /// Sets an environment variable for the runs that follow.
    pub(crate) fn env(mut self, name: &str, value: &str) -> Self {
        self.environment.push((name.to_owned(), value.to_owned()));
        self
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Puts a file into the folder.
    #[track_caller]
    pub(crate) fn write(&self, name: &str, text: &str) {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    #[track_caller]
    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path().join(name)).unwrap()
    }

    /// Runs `rmem` with these arguments and an empty stdin.
    #[track_caller]
    pub(crate) fn rmem(&self, args: &[&str]) -> Finished {
        self.rmem_with(args, "")
    }

    /// Runs `rmem` with these arguments and this stdin.
    #[track_caller]
    pub(crate) fn rmem_with(&self, args: &[&str], stdin: &str) -> Finished {
        let mut command = Command::new(rmem());
        command.args(args);
        self.finish(command, stdin)
    }

    /// Runs commands one after the other: each command line with its outcome, for a snapshot.
    #[track_caller]
    pub(crate) fn transcript(&self, commands: &[&[&str]]) -> String {
        let mut transcript = String::new();
        for args in commands {
            let line: Vec<String> = args.iter().map(|word| quoted(word)).collect();
            transcript += &format!("$ rmem {}\n{}\n", line.join(" "), self.rmem(args));
        }
        transcript
    }

    /// Runs a shell line in which `rmem` is the program under test.
    #[track_caller]
    pub(crate) fn shell(&self, line: &str) -> Finished {
        let mut command = Command::new("bash");
        command.args(["-o", "pipefail", "-c", line]);
        self.finish(command, "")
    }

    /// A command in this folder, cut off from the machine's settings.
    pub(crate) fn isolate(&self, command: &mut Command) {
        let programs = rmem().parent().unwrap().to_owned();
        command
            .current_dir(self.path())
            .env_clear()
            .env("HOME", self.path().join("home"))
            .env("PATH", format!("{}:/usr/bin:/bin", programs.display()))
            .envs(self.environment.iter().map(|(name, value)| (name, value)));
    }

    #[track_caller]
    fn finish(&self, mut command: Command, stdin: &str) -> Finished {
        self.isolate(&mut command);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut input = child.stdin.take().unwrap();
        let text = stdin.to_owned();
        // A command that does not read its stdin closes it; that is not this writer's concern.
        let writer = std::thread::spawn(move || drop(input.write_all(text.as_bytes())));
        let output = child.wait_with_output().unwrap();
        writer.join().unwrap();
        let clean = |bytes: &[u8]| String::from_utf8_lossy(bytes).replace(&self.path().display().to_string(), "$LAB");
        Finished {
            stdout: clean(&output.stdout),
            stderr: clean(&output.stderr),
            code: output.status.code().unwrap_or(-1),
        }
    }
}

/// A word of a command line as a shell wants it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,".contains(c);
    match word {
        _ if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        _ if word.contains('\'') => format!("\"{}\"", word.replace('$', "\\$")),
        _ => format!("'{word}'"),
    }
}

impl Finished {
    /// Asserts success and gives stdout.
    #[track_caller]
    pub(crate) fn success(self) -> String {
        assert_eq!(self.code, 0, "{self}");
        self.stdout
    }

    /// Asserts the exit code.
    #[track_caller]
    pub(crate) fn exits(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{self}");
        self
    }
}

impl fmt::Display for Finished {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}------- stderr -------\n{}[exit code: {}]", self.stdout, self.stderr, self.code)
    }
}
