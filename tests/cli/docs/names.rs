//! What pages name is there: files, links, options, environment variables, tests.

use std::collections::BTreeSet;
use std::path::Path;

use super::markdown::{anchors, code_spans, links, prose};
use super::{PAGES, text};
use crate::lab::root;

/// Folders of the project whose paths pages name.
const FOLDERS: [&str; 10] =
    ["src/", "tests/", "docs/", "examples/", "fixtures/", "domains/", "templates/", "grammars/", "benches/", "fuzz/"];

/// Options of programs other than rmem that pages name.
const FOREIGN: [&str; 12] = [
    "--bind_ip",
    "--release",
    "--test",
    "--bench",
    "--features",
    "--lib",
    "--ignored",
    "--nocapture",
    "--locked",
    "--path",
    "--no-default-features",
    "--profile",
];

#[test]
fn files_that_pages_name_are_there() {
    for page in PAGES {
        let prose = prose(&text(page));
        let names = code_spans(&prose).filter(|name| !name.contains(['*', '{', '<', ' ', '…', '$']));
        for name in names.filter(|name| FOLDERS.iter().any(|folder| name.starts_with(folder)) && !is_pattern(name)) {
            assert!(root().join(name).exists(), "{page}: there is no {name}");
        }
    }
}

/// `domains/NAME/domain.pddl`
fn is_pattern(name: &str) -> bool {
    name.contains("NAME")
}

#[test]
fn links_of_pages_lead_somewhere() {
    for page in PAGES {
        let prose = prose(&text(page));
        for link in links(&prose).filter(|link| !link.starts_with("https://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let folder = Path::new(page).parent().unwrap();
            let target = if file.is_empty() { Path::new(page).to_owned() } else { folder.join(file) };
            assert!(root().join(&target).exists(), "{page}: there is no {link}");
            if !anchor.is_empty() {
                let known = anchors(&text(target.to_str().unwrap()));
                assert!(known.iter().any(|known| known == anchor), "{page}: {file} has no heading {anchor}");
            }
        }
    }
}

#[test]
fn options_that_pages_name_are_in_some_help() {
    let known = options();
    for page in PAGES {
        let prose = prose(&text(page));
        let words =
            code_spans(&prose).flat_map(|span| span.split(|c: char| c.is_whitespace() || "=[]()|,'\"".contains(c)));
        for option in words.filter(|word| word.starts_with("--") && word.len() > 2) {
            assert!(known.contains(option) || FOREIGN.contains(&option), "{page}: no command has {option}");
        }
    }
}

/// The options of all commands.
fn options() -> BTreeSet<String> {
    let mut options = BTreeSet::from(["--help".to_owned(), "--version".to_owned()]);
    let mut commands = vec![rmem::cli::command()];
    while let Some(command) = commands.pop() {
        options.extend(command.get_arguments().filter_map(|argument| Some(format!("--{}", argument.get_long()?))));
        commands.extend(command.get_subcommands().cloned());
    }
    options
}

#[test]
fn environment_variables_that_pages_name_are_read_by_something() {
    let sources = sources(&["src", "tests", "benches", "python"]);
    for page in PAGES {
        let text = text(page);
        let words = text.split(|c: char| !(c.is_ascii_uppercase() || c == '_'));
        for word in words.filter(|word| word.starts_with("RMEM_")) {
            assert!(sources.contains(word), "{page}: nothing reads {word}");
        }
    }
}

#[test]
fn targets_and_tests_that_pages_name_are_there() {
    for page in PAGES {
        let prose = prose(&text(page));
        for span in code_spans(&prose) {
            let command = span.split("cargo test ").nth(1).map(|rest| format!("cargo test {rest}"));
            let bench = span.split("cargo bench ").nth(1).map(|rest| format!("cargo bench {rest}"));
            command.into_iter().chain(bench).for_each(|command| assert_cargo_command(&command));
        }
    }
}

/// Asserts that the targets and tests of a `cargo` command are there; it is not run.
pub(super) fn assert_cargo_command(command: &str) {
    let manifest = text("Cargo.toml");
    let words: Vec<&str> = command.split_whitespace().take_while(|word| *word != "--").collect();
    for pair in words.windows(2).filter(|pair| matches!(pair[0], "--test" | "--bench")) {
        assert!(manifest.contains(&format!("name = \"{}\"", pair[1])), "there is no {} {}", pair[0], pair[1]);
    }
    let valued =
        |at: usize| at > 0 && matches!(words[at - 1], "--test" | "--bench" | "--features" | "--path" | "--profile");
    let is_filter = |at: usize| at > 1 && !words[at].starts_with('-') && !valued(at);
    if words.get(1) == Some(&"test") {
        let sources = sources(&["src", "tests"]);
        for filter in (0..words.len()).filter(|at| is_filter(*at)).map(|at| words[at]) {
            let last = filter.trim_end_matches("::").rsplit("::").next().unwrap_or(filter);
            assert!(sources.contains(last), "`{}`: no test is called {filter}", command.trim());
        }
    }
}

/// The Rust sources below these folders.
fn sources(folders: &[&str]) -> String {
    let mut sources = String::new();
    let mut folders: Vec<_> = folders.iter().map(|folder| root().join(folder)).collect();
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "rs" || end == "sh" || end == "py") {
                sources += &path.display().to_string();
                sources += &std::fs::read_to_string(path).unwrap();
            }
        }
    }
    sources
}
