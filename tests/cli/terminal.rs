//! What a terminal shows of stored data.

use crate::lab::Lab;

/// Clears the screen, sets the colour by a C1 control, and turns the direction of reading.
const NASTY: &str = "\u{1b}[2J\u{9b}31m\u{202e}";
const VISIBLE: &str = "\\u{1b}[2J\\u{9b}31m\\u{202e}";

#[test]
fn escape_sequences_in_stored_data_are_visible_on_stderr_and_in_tables() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let document = format!("{{\"_id\": \"{NASTY}\", \"{NASTY}\": [\"{NASTY}\"]}}").replace('\u{1b}', "\\u001b");
    lab.rmem_with(&["insert", "a.b"], &document).success();
    let taken = lab.rmem_with(&["insert", "a.b"], &document).exits(5);
    assert!(taken.stderr.contains(VISIBLE), "{taken}");
    let owner = format!("{NASTY}r1");
    lab.rmem(&["lock", "table", "--owner", &owner]).success();
    let held = lab.rmem(&["lock", "table", "--owner", "r2"]).exits(5);
    assert!(held.stderr.contains(VISIBLE), "{held}");
    let table = lab.rmem(&["query", "a.b", "--format", "table"]).success();
    assert_eq!(table.matches(VISIBLE).count(), 2, "{table}");
    assert!(table.contains("[\"\\u001b[2J\\u{9b}31m\\u{202e}\"]"), "{table}");
    let unknown = lab.rmem(&["query", &format!("a.{NASTY}"), "--format", "table", "--explain"]);
    for text in [&taken.stderr, &held.stderr, &table, &unknown.stderr] {
        assert!(!text.contains(['\u{1b}', '\u{9b}', '\u{202e}']), "{text:?}");
    }
}

#[test]
fn a_long_answer_is_printed_as_several_tables() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let lines: String = (0..2_500).map(|n| format!("{{_id: {n}, a: {n}}}\n")).collect();
    lab.rmem_with(&["insert", "a.b"], &lines).success();
    let table = lab.rmem(&["query", "a.b", "--format", "table"]).success();
    assert_eq!(table.lines().filter(|line| line.starts_with("_id")).count(), 3);
    assert_eq!(table.lines().filter(|line| line.is_empty()).count(), 2);
    assert_eq!(table.lines().count(), 2_500 + 3 + 2);
}
