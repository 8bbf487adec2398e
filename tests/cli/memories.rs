//! Which memory a command works on, and what it says where that is none.

use crate::lab::Lab;

#[test]
fn a_file_that_is_not_there_is_no_empty_memory_to_what_only_reads() {
    let lab = Lab::new();
    let commands: [&[&str]; 9] = [
        &["query", "robmem.blocks"],
        &["count", "robmem.blocks"],
        &["collections"],
        &["update", "robmem.blocks", "{}", "{$set: {a: 1}}"],
        &["delete", "robmem.blocks", "{a: 1}"],
        &["drop", "robmem.blocks"],
        &["index", "robmem.blocks"],
        &["dump", "--all", "-o", "-"],
        &["gen-problem", "--template", "templates/blocksworld/problem.pddl.j2", "--goal", "(on A B)"],
    ];
    for command in commands {
        let refused = lab.rmem(&[&["--memory", "file:tpyo.rmem"], command].concat()).exits(4);
        assert!(refused.stderr.contains("file:tpyo.rmem: there is no such file; check its name"), "{refused}");
    }
    let lab = lab.env("RMEM_MEMORY", "file:tpyo.rmem");
    lab.rmem(&["query", "robmem.blocks"]).exits(4);
    assert!(!lab.path().join("tpyo.rmem").exists());
}

#[test]
fn what_stores_something_makes_the_file() {
    let lab = Lab::new();
    lab.write("world.json", r#"{"robmem.blocks": [{"_id": 1}]}"#);
    let commands: [&[&str]; 5] = [
        &["insert", "robmem.blocks", "{_id: 1}"],
        &["restore", "world.json"],
        &["restore", "world.json", "--drop"],
        &["--load", "world.json", "collections"],
        &["update", "robmem.blocks", "{_id: 1}", "{$set: {a: 1}}", "--upsert"],
    ];
    for (number, command) in commands.into_iter().enumerate() {
        let memory = format!("file:{number}.rmem");
        lab.rmem(&[&["--memory", &memory], command].concat()).success();
        assert_eq!(lab.rmem(&["--memory", &memory, "count", "robmem.blocks"]).success(), "1\n", "{command:?}");
    }
}

#[test]
fn the_memory_of_the_settings_may_be_empty_still() {
    let lab = Lab::new();
    assert_eq!(lab.rmem(&["count", "robmem.blocks"]).success(), "0\n");
    lab.write("rmem.toml", "memory = \"file:robot.rmem\"\n");
    assert_eq!(lab.rmem(&["count", "robmem.blocks"]).success(), "0\n");
    assert!(!lab.path().join("robot.rmem").exists());
}
