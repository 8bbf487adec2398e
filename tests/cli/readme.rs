//! The README's commands run, and print what it says they print.
//!
//! In a `console` block a line that starts with `$ ` is a command; the lines up to the next one are what
//! it prints on stdout (stderr is not shown in the README). `…` alone on a line stands for any lines. Blocks of
//! `console clips-engine` are for an rmem with that feature.

use crate::lab::{Lab, root};

#[test]
fn every_console_block_of_the_readme_is_true() {
    let commands = run_blocks("```console\n");
    assert!(commands >= 5, "the README shows too little: {commands} commands");
}

#[cfg(feature = "clips-engine")]
#[test]
fn what_the_readme_shows_of_the_engine_is_true() {
    assert_eq!(run_blocks("```console clips-engine\n"), 1);
}

/// Runs the blocks that start so, in order; gives how many commands there were.
fn run_blocks(start: &str) -> usize {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let lab = Lab::new();
    let mut commands = 0;
    for block in readme.split(start).skip(1) {
        let block = block.split("```").next().unwrap();
        for step in block.split("$ ").filter(|step| !step.trim().is_empty()) {
            let (command, expected) = split_command(step);
            let command = command.replace("cargo run --release --", "rmem");
            if command.trim() == "cargo test" {
                continue;
            }
            let run = lab.shell(&command);
            assert_eq!(run.code, 0, "$ {command}\n{run}");
            assert!(agrees(&run.stdout, expected), "$ {command}\n{run}\n--- the README says\n{expected}");
            commands += 1;
        }
    }
    commands
}

/// A command goes on over lines that end in a backslash.
fn split_command(step: &str) -> (&str, &str) {
    let mut end = 0;
    for line in step.split_inclusive('\n') {
        end += line.len();
        if !line.trim_end().ends_with('\\') {
            break;
        }
    }
    step.split_at(end)
}

/// Compares line by line, trailing blanks aside; `…` matches any lines.
fn agrees(actual: &str, expected: &str) -> bool {
    let actual: Vec<&str> = actual.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
    let expected: Vec<&str> = expected.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
    match expected.iter().position(|line| *line == "…") {
        None => actual == expected,
        Some(gap) => {
            let tail = expected.len() - gap - 1;
            actual.len() >= gap + tail
                && actual[..gap] == expected[..gap]
                && actual[actual.len() - tail..] == expected[gap + 1..]
        }
    }
}

#[test]
fn what_contributing_names_is_there() {
    let text = std::fs::read_to_string(root().join("CONTRIBUTING.md")).unwrap();
    let mut sources = String::new();
    for folder in ["tests/unit", "tests/integration", "tests/conformance", "tests/conformance/differential"] {
        let entries = std::fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().path());
        for file in entries.filter(|path| path.is_file()) {
            sources += &std::fs::read_to_string(file).unwrap();
        }
    }
    let words = text.split(|c: char| !(c.is_ascii_uppercase() || c == '_')).filter(|word| word.starts_with("RMEM_"));
    for word in words {
        assert!(sources.contains(word), "nothing reads {word}");
    }
    for path in text.split('`').filter(|word| word.starts_with("src/") || word.starts_with("tests/")) {
        assert!(root().join(path).exists(), "there is no {path}");
    }
}
