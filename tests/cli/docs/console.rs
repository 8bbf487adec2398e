//! Commands and what they print, as a `console` block shows them.
//!
//! A line that starts with `$ ` is a command; it goes on over lines that end in a backslash, and through a
//! here-document. The lines up to the next command are what it prints on stdout. `…` stands for any text, alone on
//! a line for any lines.

/// A command with what it prints.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Step<'a> {
    pub(super) command: String,
    pub(super) expected: Vec<&'a str>,
}

/// The commands of a block.
pub(super) fn steps(block: &str) -> Vec<Step<'_>> {
    let mut steps: Vec<Step<'_>> = Vec::new();
    let mut lines = block.lines();
    while let Some(line) = lines.next() {
        match line.strip_prefix("$ ") {
            Some(command) => steps.push(Step { command: whole(command, &mut lines), expected: Vec::new() }),
            None => steps.last_mut().expect("a console block starts with a command").expected.push(line),
        }
    }
    steps
}

/// The command with the lines that it goes on over.
fn whole<'a>(first: &'a str, lines: &mut impl Iterator<Item = &'a str>) -> String {
    let mut command = first.to_owned();
    while command.ends_with('\\') {
        command = command + "\n" + lines.next().unwrap_or_default();
    }
    if let Some((_, end)) = first.split_once("<<'") {
        let end = end.split('\'').next().unwrap_or_default();
        for line in lines {
            command = command + "\n" + line;
            if line == end {
                break;
            }
        }
    }
    command + "\n"
}

/// Whether a command printed what the page shows; blank lines and trailing blanks aside.
pub(super) fn agrees(actual: &str, expected: &[&str]) -> bool {
    let actual: Vec<&str> = actual.lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
    let expected: Vec<&str> = expected.iter().map(|line| line.trim_end()).filter(|line| !line.is_empty()).collect();
    lines_agree(&actual, &expected)
}

fn lines_agree(actual: &[&str], expected: &[&str]) -> bool {
    match expected.split_first() {
        None => actual.is_empty(),
        Some((gap, rest)) if gap.trim() == "…" => {
            (0..=actual.len()).any(|skipped| lines_agree(&actual[skipped..], rest))
        }
        Some((line, rest)) => match actual.split_first() {
            Some((first, others)) => line_agrees(first, line) && lines_agree(others, rest),
            None => false,
        },
    }
}

fn line_agrees(actual: &str, expected: &str) -> bool {
    let mut parts = expected.split('…');
    let Some(mut rest) = actual.strip_prefix(parts.next().unwrap_or_default()) else { return false };
    let parts: Vec<&str> = parts.collect();
    let Some((last, middle)) = parts.split_last() else { return rest.is_empty() };
    for part in middle {
        let Some((_, after)) = rest.split_once(part) else { return false };
        rest = after;
    }
    rest.ends_with(last)
}

#[test]
fn a_page_that_shows_something_else_is_found_out() {
    for (actual, expected) in
        [("a\nb\n", "a\nb"), ("a\nb\nc\n", "a\n…\nc"), ("a\n", "…\na\n…"), ("id 1 of 2\n", "id … of …")]
    {
        assert!(agrees(actual, &expected.lines().collect::<Vec<_>>()), "{expected}");
    }
    for (actual, expected) in
        [("a\nb\n", "a"), ("a\n", "a\nb"), ("a\nb\n", "…\na"), ("id 1 of 2\n", "id … of 3"), ("", "a")]
    {
        assert!(!agrees(actual, &expected.lines().collect::<Vec<_>>()), "{expected}");
    }
}

#[test]
fn a_command_goes_on_over_backslashes_and_here_documents() {
    let block = "$ a \\\n  b\nsaid\n$ cat <<'E'\n$ x\nE\n$ c\n";
    let shown: Vec<_> = steps(block).into_iter().map(|step| (step.command, step.expected)).collect();
    let wanted = [("a \\\n  b\n", vec!["said"]), ("cat <<'E'\n$ x\nE\n", vec![]), ("c\n", vec![])];
    assert_eq!(shown, wanted.map(|(command, expected)| (command.to_owned(), expected)));
}
