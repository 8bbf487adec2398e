//! `--format json` of commands whose result is something done.

use serde_json::{Value, json};

use crate::lab::{Lab, TASK, assert_run, three_documents};

/// What a command prints with `--format json`.
#[track_caller]
fn report(lab: &Lab, args: &[&str]) -> Value {
    serde_json::from_str(&lab.rmem(&[args, &["--format", "json"]].concat()).success()).unwrap()
}

#[test]
fn what_was_done_is_printed_as_json() {
    let lab = three_documents();
    let copied = report(&lab, &["backup", "copy.rmem"]);
    assert_eq!(copied["file"], "copy.rmem");
    assert_eq!(
        report(&lab, &["repair", "--memory", "file:copy.rmem"]),
        json!({"collections": 1, "documents": 3, "indexes": 0, "lost": []})
    );
    assert_eq!(report(&lab, &["drop", "robmem.worldmodel"]), json!({"ns": "robmem.worldmodel", "dropped": true}));
    assert_eq!(report(&lab, &["drop", "robmem.worldmodel"]), json!({"ns": "robmem.worldmodel", "dropped": false}));
    let made = report(&lab, &["init", "new"]);
    assert_eq!(made["files"][0], "new/rmem.toml");
    let imported = ["import-problem", "fixtures/tasks/solvable/problem.pddl", "--into", "robmem.imported"];
    let imported = report(&lab, &imported);
    let count = lab.rmem(&["count", "robmem.imported"]).success();
    assert_eq!((imported["stored"].to_string() + "\n", &imported["template"]), (count, &Value::Null));
}

#[test]
fn a_generated_problem_as_json_has_the_sections_of_its_template() {
    let lab = Lab::new();
    let words = ["gen-problem", TASK[0], TASK[1], TASK[4], TASK[5], TASK[6], TASK[7]];
    let text = lab.rmem(&words).success();
    let whole = report(&lab, &words);
    assert_eq!(whole["problem"], text);
    let matched: i64 = whole["sections"].as_array().unwrap().iter().filter_map(|one| one["documents"].as_i64()).sum();
    assert!(matched > 3, "{whole}");
    let summary = report(&lab, &[&words[..], &["-o", "p.pddl"]].concat());
    assert_eq!((lab.read("p.pddl"), &summary["sections"]), (text.clone(), &whole["sections"]));
    // A format of the environment is not for what other programs read.
    assert_eq!(lab.env("RMEM_FORMAT", "json").rmem(&words).success(), text);
}

#[test]
fn facts_have_the_format_of_clips_only() {
    assert_run!(three_documents().rmem(&["clips", "export", "--format", "json"]), @r"
    ------- stderr -------
    error: invalid value 'json' for '--format <FORMAT>'
      [possible values: clips]

    For more information, try '--help'.
    [exit code: 2]
    ");
}
