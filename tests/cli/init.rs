//! init, and the words of other tools that newcomers type.

use crate::lab::Lab;

#[test]
fn init_makes_a_project_that_plans_two_commands_later() {
    let lab = Lab::empty();
    let made = lab.rmem(&["init", "delivery"]).exits(0);
    assert_eq!(made.stdout.lines().count(), 4, "{made}");
    let line = made.stderr.lines().find_map(|line| line.split_once("a plan: ")).map(|(_, line)| line.to_owned());
    let run = lab.shell(&line.unwrap_or_else(|| panic!("{made}"))).exits(0);
    let steps: Vec<&str> = run.stdout.lines().filter(|line| line.starts_with("(") && line.ends_with(')')).collect();
    assert_eq!(
        steps,
        [
            "(go hall kitchen)",
            "(pick-up cup kitchen)",
            "(go kitchen hall)",
            "(go hall office)",
            "(put-down cup office)"
        ],
        "{run}"
    );
    let doctor = lab.shell("cd delivery && rmem doctor --domain domain.pddl --template problem.pddl.j2").exits(0);
    assert!(doctor.stdout.contains("template problem.pddl.j2: ok"), "{doctor}");
}

#[test]
fn init_overwrites_nothing() {
    let lab = Lab::empty();
    lab.write("domain.pddl", "mine");
    let refused = lab.rmem(&["init"]).exits(3);
    assert!(refused.stderr.contains(". has domain.pddl already, and nothing is overwritten"), "{refused}");
    assert_eq!((lab.read("domain.pddl").as_str(), lab.path().join("rmem.toml").exists()), ("mine", false));
    assert!(lab.rmem(&["init", "domain.pddl"]).exits(3).stderr.contains("is not a folder"));
    lab.rmem(&["init", "new/deep"]).success();
    assert!(lab.rmem(&["init", "new/deep"]).exits(3).stderr.contains("rmem.toml, domain.pddl"));
}

#[test]
fn words_of_other_tools_name_the_command() {
    let lab = Lab::empty();
    for (word, tip) in [
        ("find", "rmem query"),
        ("import", "rmem restore"),
        ("log", "rmem history"),
        ("rollback", "rmem undo"),
        ("new", "rmem init"),
        ("benchmark", "rmem compare"),
    ] {
        let run = lab.rmem(&[word, "robmem.worldmodel"]).exits(2);
        assert!(run.stderr.contains(tip), "{word}: {run}");
    }
    let run = lab.rmem(&["export", "robmem.worldmodel"]).exits(2);
    assert!(run.stderr.contains("rmem dump robmem.worldmodel") && run.stderr.contains("rmem clips export"), "{run}");
    let typo = lab.rmem(&["qeury", "robmem.worldmodel"]).exits(2);
    assert!(typo.stderr.contains("query"), "{typo}");
}
