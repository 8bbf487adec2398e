//! doctor.

use crate::lab::{Lab, TASK, assert_run};
use crate::repair::{DAMAGE, lab, sql};

#[test]
fn doctor_finds_damaged_documents_and_indexes() {
    let lab = lab();
    let sound = lab.rmem(&["doctor", "--deep"]).success();
    assert!(sound.contains("checked    file:robot.rmem: 1 collection, 3 documents, 1 index\n"), "{sound}");
    sql(&lab, "robot.rmem", DAMAGE);
    sql(&lab, "robot.rmem", "DELETE FROM entries_1 WHERE position = 3; INSERT INTO entries_1 VALUES (x'00', 77)");
    let found = lab.rmem(&["doctor", "--deep"]).exits(4).stdout;
    let damage: Vec<&str> = found.lines().filter(|line| line.starts_with("damage ")).collect();
    assert_run!(damage.join("\n"), @r"
    damage     a.b: the document with _id 2 is damaged: its checksum is wrong
    damage     a.b: the index n_1 lacks 1 of 1 keys of the document with _id 3
    damage     a.b: the index n_1 has 2 keys of no document
    ");
}

#[test]
fn doctor_tries_planners_and_computables() {
    let lab = Lab::empty();
    let fine = lab.rmem(&["doctor"]).exits(0);
    assert!(fine.stdout.contains("planner    builtin: ok, solves a tiny task in 0."), "{fine}");
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n\
         [planner.broken]\ncommand = ['/bin/sh', '-c', 'echo I crash; exit 3']\noutput = 'ff'\n\
         [planner.absent]\ncommand = ['nowhere', '{domain}']\noutput = 'ff'\n\
         [[computable]]\nname = 'sum'\ncollection = 'a.b'\nspec = '{sum: true}'\ncommand = ['sh', 'sum.sh']\n\
         [[computable]]\nname = 'gone'\ncollection = 'a.b'\nspec = '{gone: true}'\ncommand = ['./gone']\n\
         [[computable]]\nname = 'wrong'\ncollection = 'a.b'\nspec = '{w: true}'\npipeline = \"[{$project: {x: {$divide: [1, {$subtract: ['$a', 1]}]}}}]\"\n\
         [[computable]]\nname = 'right'\ncollection = 'a.b'\nspec = '{r: true}'\npipeline = '[{$match: {a: 1}}]'\n",
    );
    lab.rmem(&["insert", "a.b", "{_id: 1, a: 1}"]).success();
    let found = lab.rmem(&["doctor"]).exits(1);
    for line in [
        "planner    broken: does not solve a tiny task: the planner crashed",
        "planner    absent: does not solve a tiny task: the planner's program was not found",
        "computable sum: there is no file sum.sh in ",
        "computable gone: the program `./gone` is not there",
        "computable wrong: ",
        "computable right: ok, its pipeline gives 1 documents",
    ] {
        assert!(found.stdout.contains(line), "{line}: {found}");
    }
    assert!(!found.stdout.contains("computable wrong: ok"), "{found}");
    lab.write("sum.sh", "");
    assert!(lab.rmem(&["doctor"]).stdout.contains("computable sum: ok"));
}

#[test]
fn doctor_tries_domains_and_templates() {
    let lab = Lab::new();
    lab.write("wrong.pddl", "(define (domain x) (:predicates (on ?a))");
    lab.write("wrong.j2", "(define (problem x) {{ nothing(");
    let files = ["--domain", "wrong.pddl", "--domain", TASK[3], "--template", "wrong.j2"];
    let found = lab.rmem(&[&["doctor"], &files[..]].concat()).exits(1);
    assert!(found.stdout.contains("domain wrong.pddl: wrong.pddl:1:"), "{found}");
    assert!(found.stdout.contains("domain domains/blocksworld/domain.pddl: ok, 4 actions"), "{found}");
    assert!(found.stdout.contains("template wrong.j2: ") && found.stdout.contains("wrong.j2:1:"), "{found}");
}

#[test]
fn doctor_prints_json() {
    let lab = Lab::empty();
    let found = lab.rmem(&["doctor", "--format", "json", "--memory", "mem:"]).exits(0);
    let found: serde_json::Value = serde_json::from_str(&found.stdout).unwrap();
    let of = |check: &str, name: &str| {
        found.as_array().unwrap().iter().find(|one| one["check"] == check && one["name"] == name).cloned()
    };
    assert_eq!(of("memory", "mem:").unwrap()["state"], "ok, 0 collections");
    assert_eq!(of("planner", "builtin").unwrap()["ok"], true);
    assert!(lab.rmem(&["doctor", "--help"]).success().contains("Output format: text, json"));
}
