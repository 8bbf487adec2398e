//! plan why, and the lineage that it prints.

use crate::lab::{Lab, TASK, assert_run};

#[test]
fn why_prints_where_a_plan_comes_from() {
    let lab = Lab::new();
    std::fs::copy(crate::lab::root().join("domains/blocksworld/domain.pddl"), lab.path().join("d.pddl")).unwrap();
    lab.rmem(&["plan", "-q", TASK[0], TASK[1], "-d", "d.pddl", TASK[4], TASK[5], "--goal", "(on A B)"]).success();
    assert_run!(lab.rmem(&["plan", "why", "last"]), @r#"
    plan        [ID]
    outcome     success
    length      5 steps
    cost        5
    goal        (on A B)
    domain      d.pddl (sha256 0f6f04ffe65e)
    template    templates/blocksworld/problem.pddl.j2 (sha256 5d801c020c0f)
    problem     sha256 e407b2e6e627
    collection  robmem.worldmodel
    query       distinct(world, "object", "{relation: {$in: ['on-table', 'holding']}}") {"distinct":"object","query":{"relation":{"$in":["on-table","holding"]}}} in robmem.worldmodel: 3 documents
    query       distinct(world, "object_top", "{relation: 'on'}") {"distinct":"object_top","query":{"relation":"on"}} in robmem.worldmodel: 1 document
    query       query(world, "{relation: 'on-table'}", sort="{object: 1}") {"relation":"on-table"} in robmem.worldmodel: 2 documents
    query       query(world, "{relation: 'on'}", sort="{object_top: 1}") {"relation":"on"} in robmem.worldmodel: 1 document
    query       query(world, "{relation: 'clear'}", sort="{object: 1}") {"relation":"clear"} in robmem.worldmodel: 2 documents
    query       query(world, "{relation: 'holding'}") {"relation":"holding"} in robmem.worldmodel: 1 document
    planner     builtin ferroplan 0.30.0
    command     rmem ff -o {domain} -f {problem} --checked
    timeout     [DURATION]
    started     [TIME]
    times       instantiate [DURATION], plan [DURATION]
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.write("d.pddl", "another");
    assert!(lab.rmem(&["plan", "why", "last"]).success().contains("the file is another now"));
}

#[test]
fn no_address_of_a_memory_is_kept_with_a_plan() {
    let lab = Lab::new();
    lab.rmem(&[&["plan", "-q", "--memory", "file:secret-name.rmem"], &TASK[..]].concat()).success();
    let stored = lab.rmem(&["query", "robmem.plans", "--meta", "--memory", "file:secret-name.rmem"]).success();
    assert!(stored.contains("\"sources\"") && !stored.contains("secret-name"), "{stored}");
}

#[test]
fn a_limit_of_memory_is_known_after_the_plan_went_through_text() {
    let lab = Lab::new();
    crate::lab::plan(&lab, &["-q", "--memory-limit", "1G"]).success();
    let text = lab.rmem(&["query", "robmem.plans", "--meta"]).success();
    let lab = Lab::new();
    lab.write("world.json", &format!("{{\"robmem.plans\": [{text}]}}"));
    lab.rmem(&["restore", "world.json"]).success();
    let why = lab.rmem(&["plan", "why", "last"]).success();
    assert!(why.contains("\nmemory      1073741824 bytes at most\n"), "{why}");
}
