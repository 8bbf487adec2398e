//! doctor.

use crate::lab::{Lab, TASK, assert_run};
use crate::repair::{DAMAGE, lab, sql};

#[test]
fn doctor_finds_damaged_documents_and_indexes() {
    let lab = lab();
    let sound = lab.rmem(&["doctor", "--deep"]).success();
    assert!(sound.contains("memory     file:robot.rmem: ok, 1 collection\n"), "{sound}");
    assert!(sound.contains("checked    file:robot.rmem: 1 collection, 3 documents, 1 index\n"), "{sound}");
    sql(&lab, "robot.rmem", DAMAGE);
    sql(
        &lab,
        "robot.rmem",
        "DELETE FROM entries_1 WHERE position = 3; INSERT INTO entries_1 (key, position) VALUES (x'00', 77)",
    );
    let found = lab.rmem(&["doctor", "--deep"]).exits(4).stdout;
    assert!(found.contains("memory     file:robot.rmem: damaged, 1 collection\n"), "{found}");
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
        "computable right: ok, its pipeline gives 1 document\n",
    ] {
        assert!(found.stdout.contains(line), "{line}: {found}");
    }
    assert!(!found.stdout.contains("computable wrong: ok"), "{found}");
    lab.write("sum.sh", "");
    assert!(lab.rmem(&["doctor"]).stdout.contains("computable sum: ok"));
}

#[test]
fn doctor_asks_the_programs_of_computables() {
    let lab = Lab::empty();
    lab.write("sum.sh", "read q; case $q in *'\"x\":2'*) echo '{compute: \"sum\", x: 2, sum: 3} {compute: \"sum\", x: 2, sum: 4}';; *) echo no x >&2; exit 7;; esac\n");
    lab.write("chatty.sh", "echo 'this is not a document'\n");
    lab.write("slow.sh", "sleep 100\n");
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n\
         [[computable]]\nname = 'sum'\ncollection = 'a.b'\nspec = '{compute: \"sum\", x: {$exists: true}}'\ncommand = ['sh', 'sum.sh']\n\
         [[computable]]\nname = 'chatty'\ncollection = 'a.b'\nspec = '{chat: 1}'\ncommand = ['sh', 'chatty.sh']\n\
         [[computable]]\nname = 'slow'\ncollection = 'a.b'\nspec = '{wait: true}'\ntimeout = '200ms'\ncommand = ['sh', 'slow.sh']\n\
         [[computable]]\nname = 'odd'\ncollection = 'a.b'\nspec = '{$expr: {$gt: [\"$x\", \"$y\"]}}'\ncommand = ['sh', 'slow.sh']\n",
    );
    let found = lab.rmem(&["doctor"]).exits(1);
    for part in [
        "computable sum: does not answer {\"compute\":\"sum\",\"x\":1}: its command `sh sum.sh` failed with exit code 7\n  | no x\n  the query is made up; --ask QUERY asks another\n",
        "computable chatty: does not answer {\"chat\":1}: its command `sh chatty.sh` did not print documents",
        "computable slow: does not answer {\"wait\":true}: its command `sh slow.sh` was stopped after 200ms",
        "computable odd: ok, /",
    ] {
        assert!(found.stdout.contains(part), "{part}: {found}");
    }
    let asked = lab.rmem(&["doctor", "--ask", "{compute: 'sum', x: 2}"]).exits(1);
    assert!(
        asked.stdout.contains("computable sum: ok, answers {\"compute\":\"sum\",\"x\":2} with 2 documents"),
        "{asked}"
    );
    assert_eq!(lab.rmem(&["count", "a.b"]).stdout, "0\n", "nothing is stored");
}

#[test]
fn a_folder_of_the_path_that_may_not_be_read_hides_nothing() {
    use std::os::unix::fs::PermissionsExt as _;
    let lab = Lab::empty();
    let closed = lab.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o000)).unwrap();
    // Who is root may read every folder; a file that may not be entered as one gives the same error.
    lab.write("file", "");
    let path = format!("{}:{}/file:/usr/bin:/bin", closed.display(), lab.path().display());
    let lab = lab.env("PATH", &path);
    let found = lab.rmem(&["doctor", "--memory", "mem:"]).exits(0);
    assert!(found.stdout.contains("planner    ff: the program `ff` is not installed"), "{found}");
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o700)).unwrap();
}

#[test]
fn doctor_tries_domains_and_templates() {
    let lab = Lab::new();
    lab.write("wrong.pddl", "(define (domain x) (:predicates (on ?a))");
    lab.write("wrong.j2", "(define (problem x) {{ nothing(");
    let files = ["--domain", "wrong.pddl", "--domain", TASK[3], "--template", "wrong.j2"];
    let found = lab.rmem(&[&["doctor"], &files[..]].concat()).exits(1);
    assert!(found.stdout.contains("domain     wrong.pddl: wrong.pddl:1:"), "{found}");
    assert!(found.stdout.contains("domain     domains/blocksworld/domain.pddl: ok, 4 actions"), "{found}");
    assert!(found.stdout.contains("template   wrong.j2: ") && found.stdout.contains("wrong.j2:1:"), "{found}");
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
    assert_eq!(of("memory", "mem:").unwrap()["ok"], true);
    assert!(found[0]["check"] == "settings" && found[0]["name"].is_null() && found[0]["ok"].is_null(), "{found}");
    assert!(lab.rmem(&["doctor", "--help"]).success().contains("Output format: text, json"));
}

#[test]
fn a_program_whose_answers_its_query_does_not_find_is_a_mistake() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n\
         [[computable]]\nname = 'scan'\ncollection = 'a.b'\nspec = \"{typ: 'scan'}\"\ncommand = ['echo', '{\"type\": \"scan\"}']\n",
    );
    let found = lab.rmem(&["doctor"]);
    let wanted = "computable scan: does not answer {\"typ\":\"scan\"}: of the 1 that it prints, the query finds none: {\"type\":\"scan\"}";
    assert!(found.stdout.contains(wanted), "{found}");
}

#[test]
fn doctor_counts_actions_with_and_without_duration() {
    let lab = Lab::new();
    lab.write(
        "d.pddl",
        "(define (domain d) (:requirements :durative-actions) (:predicates (p)) (:action a :parameters () :effect (p))
         (:durative-action b :parameters () :duration (= ?duration 1) :condition (at start (p)) :effect (at end (p))))",
    );
    lab.write("e.pddl", "(define (domain e) (:predicates (p)) (:action a :parameters () :effect (p)))");
    let found = lab.rmem(&["doctor", "--domain", "d.pddl", "--domain", "e.pddl"]).stdout;
    assert!(
        found.contains("domain     d.pddl: ok, 2 actions\n") && found.contains("domain     e.pddl: ok, 1 action\n"),
        "{found}"
    );
}

#[test]
fn computed_documents_that_a_unique_index_refuses_are_named() {
    let lab = Lab::empty();
    lab.write("twins.sh", "echo '{t: true, kind: \"c\", n: 1} {t: true, kind: \"c\", n: 2}'\n");
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\n\
         [[computable]]\nname = 'c'\ncollection = 'a.b'\nspec = '{kind: \"c\"}'\n\
         pipeline = '[{$match: {v: {$exists: true}}}, {$project: {_id: 0, kind: \"c\", v: 1}}]'\n\
         [[computable]]\nname = 'twins'\ncollection = 'a.b'\nspec = '{t: true}'\ncommand = ['sh', 'twins.sh']\n",
    );
    lab.rmem(&["insert", "-q", "a.b", "{_id: 1, v: 1, kind: 'a', name: 1}", "{_id: 2, v: 2, kind: 'a', name: 2}"])
        .success();
    let doctor = lab.rmem(&["doctor"]).success();
    assert!(doctor.contains("computable c: ok, its pipeline gives 2 documents"), "{doctor}");
    lab.rmem(&["index", "a.b", "{kind: 1, name: 1}", "--unique"]).success();
    let refused = lab.rmem(&["query", "a.b", "{kind: 'c'}"]).exits(5);
    let wanted = "already has a document with kind: \"c\", name: null (unique index kind_1_name_1); that document is \
                  stored or computed, too: unique indexes of the collection hold for computed documents";
    assert!(refused.stderr.contains(wanted) && !refused.stderr.contains("leave the _id out"), "{refused}");
    let doctor = lab.rmem(&["doctor"]).exits(1);
    for name in ["c", "twins"] {
        let wanted = format!(
            "computable {name}: cannot be stored: two of the documents that it gives have kind: \"c\", name: null (unique index \
             kind_1_name_1) of a.b; give each a value of its own\n"
        );
        assert!(doctor.stdout.contains(&wanted), "{doctor}");
    }
}
