//! help: of rmem, and of each command in both spellings.

use crate::lab::{Lab, assert_run};

/// The commands that `rmem help` lists.
fn commands(lab: &Lab) -> Vec<String> {
    let help = lab.rmem(&["help"]).success();
    let listed = help.split("Global options:").next().unwrap_or_default().lines();
    let names = listed.filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next().map(str::to_owned));
    names.filter(|name| name != "help").collect()
}

#[test]
fn a_negative_value_of_an_option_gets_a_tip_about_that_option() {
    let lab = Lab::empty();
    for (line, tip) in [
        ("query a.b --skip -1", "'--skip' takes no negative number"),
        ("query a.b --limit -1", "all documents are printed without '--limit'"),
        ("query a.b --at -29m", "a time that is past has no sign: --at 29m"),
        ("history a.b --since -10m", "a time that is past has no sign: --since 10m"),
        ("lock t --owner r --wait -1s", "'--wait' takes no negative value"),
        ("query a.b -5", "all documents are printed without '--limit'"),
    ] {
        let refused = lab.rmem(&line.split(' ').collect::<Vec<_>>()).exits(2);
        assert!(refused.stderr.contains(&format!("tip: {tip}\n")), "{line}: {refused}");
        assert_eq!(refused.stderr.matches("tip:").count(), 1, "{line}: {refused}");
    }
}

#[test]
fn the_help_of_a_command_is_the_same_after_help_and_with_the_option() {
    let lab = Lab::empty();
    let commands = commands(&lab);
    assert!(commands.len() > 30, "{commands:?}");
    for command in &commands {
        let help = lab.rmem(&["help", command]).success();
        assert_eq!(lab.rmem(&[command, "--help"]).success(), help, "{command}");
        assert!(help.contains("\nExample"), "{command} has no example:\n{help}");
    }
}

/// The subcommands that a help lists, and the subcommands of these.
fn below(lab: &Lab, command: &str) -> Vec<String> {
    let words: Vec<&str> = ["help"].into_iter().chain(command.split(' ')).collect();
    let help = lab.rmem(&words).success();
    let listed = help.split("\nCommands:\n").nth(1).and_then(|rest| rest.split("\n\n").next()).unwrap_or_default();
    let names = listed.lines().filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    let names = names.filter(|name| !name.is_empty() && *name != "help").map(|name| format!("{command} {name}"));
    names.flat_map(|name| [vec![name.clone()], below(lab, &name)].concat()).collect()
}

/// A help without the global options, which are the same in each.
fn own_part(help: &str) -> String {
    let (before, rest) = help.split_once("Global options:\n").unwrap_or((help, ""));
    let after = rest.split_once("\n\n").map_or("", |(_, after)| after);
    format!("{before}{after}")
}

#[test]
fn every_help_is_on_record() {
    let lab = Lab::empty();
    for command in commands(&lab) {
        for command in [vec![command.clone()], below(&lab, &command)].concat() {
            let words: Vec<&str> = ["help"].into_iter().chain(command.split(' ')).collect();
            insta::assert_snapshot!(command.replace(' ', "_"), own_part(&lab.rmem(&words).success()));
        }
    }
}

#[test]
fn a_help_has_arguments_options_examples_and_what_is_printed() {
    assert_run!(Lab::empty().rmem(&["help", "backup"]), @r"
    Copy the memory into a new file, while other programs use it

    Usage: rmem backup [OPTIONS] <FILE>

    Arguments:
      <FILE>  The new file; it must not exist

    Options:
      -h, --help     Print help
      -V, --version  Print version

    Global options:
          --memory <URI>     Local store: file:PATH, mem:, or mongodb://… (default: a file in the user's
                             data directory) [env: RMEM_MEMORY]
          --shared <URI>     Store of shared databases (default: same as --memory) [env: RMEM_SHARED]
          --config <FILE>    Settings file (default: the nearest rmem.toml upwards, then the user's)
                             [env: RMEM_CONFIG]
          --load <WORLD>     Load a world file into the memory first (can be repeated)
          --format <FORMAT>  Output format: text, json (default: text) [env: RMEM_FORMAT]
          --collection <NS>  Default collection (default: robmem.worldmodel) [env: RMEM_COLLECTION]
      -q, --quiet            Print errors only
      -v, --verbose          Print each operation and its duration
          --color <WHEN>     Colour messages: auto, always, never (default: auto) [env: NO_COLOR]
          --log <FILE>       Append each operation to FILE as JSON lines [env: RMEM_LOG]

    Example:
      rmem backup robot-2026-11-22.rmem

    The copy is the memory as it is at one moment; other programs read and write meanwhile. It is a
    memory itself: use it with --memory file:FILE. Do not copy the file of a memory that is in use with
    cp: its latest writes are in FILE-wal beside it until they are folded into the file, which happens
    at the latest when the last program closes it. A MongoDB server is backed up with `rmem dump --all`.
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn help_for_an_unknown_command_is_refused() {
    assert_run!(Lab::empty().rmem(&["help", "inser"]), @r"
    ------- stderr -------
    error: unrecognized subcommand 'inser'

    Usage: rmem [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    ");
}

#[test]
fn the_help_of_help_is_the_same_in_each_spelling() {
    let lab = Lab::empty();
    let help = lab.rmem(&["help", "help"]).success();
    assert!(help.contains("Usage: rmem help [COMMAND]..."), "{help}");
    for option in ["--help", "-h"] {
        assert_eq!(lab.rmem(&["help", option]).success(), help);
    }
}

#[test]
fn a_value_that_is_no_number_is_said_in_plain_words() {
    let lab = Lab::empty();
    for (words, expected) in [
        (
            &["query", "a.b", "--limit", "x"][..],
            "error: invalid value 'x' for '--limit <N>': expected a whole number, like 10",
        ),
        (&["undo", "a.b", "--last=-1"], "error: invalid value '-1' for '--last <N>': expected a whole number, like 10"),
        (
            &["query", "a.b", "--skip", "99999999999999999999"],
            "error: invalid value '99999999999999999999' for '--skip <N>': the number is too large",
        ),
        (
            &["compare", "d.pddl", "p.pddl", "--repeat", "70000"],
            "error: invalid value '70000' for '--repeat <N>': expected a whole number from 1 to 65535",
        ),
        (
            &["watch", "a.b", "--count", "0"],
            "error: invalid value '0' for '--count <N>': expected a whole number from 1 on",
        ),
    ] {
        let run = lab.rmem(words).exits(2);
        assert_eq!(run.stderr, format!("{expected}\n\nFor more information, try '--help'.\n"));
    }
    let negative = lab.rmem(&["undo", "a.b", "--last", "-1"]).exits(2);
    let words = "error: unexpected argument '-1' found\n\n  tip: '--last' takes no negative number\n";
    assert!(negative.stderr.starts_with(words), "{negative}");
}
