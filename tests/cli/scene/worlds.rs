//! The example worlds: plans for them, and scenes that change what is planned next.

use std::time::Duration;

use super::{Kitchen, OBJECTS, named, operations, word};
use crate::lab::{Lab, assert_run};

/// Operations that put the red cup down somewhere in the map.
fn put_down([x, y, z]: [f64; 3]) -> String {
    format!(
        "{{\"operation\": \"detach\", \"name\": \"red-cup\", \"attached_to\": {{\"link\": \"gripper\"}}}}\n\
         {{\"operation\": \"move\", \"name\": \"red-cup\", \"translation\": [{x}, {y}, {z}], \"rotation\": [0, 0, 0, 1]}}\n"
    )
}

#[test]
fn the_robot_tidies_up() {
    let kitchen = Kitchen::new();
    assert_eq!(kitchen.check(0), "");
    let task = ["plan", "--domain", "domains/tidyup/domain.pddl", "--template", "templates/tidyup/problem.pddl.j2"];
    assert_eq!(
        kitchen.rmem(&task).success(),
        "(pick-up red-cup table kitchen gripper)\n(put-down red-cup counter kitchen gripper)\n; cost = 2 (unit cost)\n"
    );
    kitchen.export("json", "start.json");
    // It takes the cup: the change is sent to the motion planner and stored in the memory.
    kitchen.lab.write("taken", "{\"operation\": \"attach\", \"name\": \"red-cup\", \"attached_to\": {\"link\": \"gripper\", \"touch\": [\"table\"]}}\n");
    let applied = kitchen.rmem(&["scene", "apply", "taken", "--into", OBJECTS]).success();
    assert_eq!(operations(&applied), [named("attach", "red-cup")]);
    assert!(kitchen.pose("red-cup").contains("\"attached_to\":{\"link\":\"gripper\",\"touch\":[\"table\"]}"));
    // It puts the cup where the other one is, which the check finds.
    kitchen.lab.write("put", &put_down([1.7, 1.95, 0.8]));
    assert_run!(kitchen.rmem(&["scene", "apply", "put", "--into", OBJECTS]), @r"
    ------- stderr -------
    error: put does not say in which frame its poses are; expected --frame FRAME
    [exit code: 2]
    ");
    kitchen.apply("put", &[]).success();
    let overlap = kitchen.check(1);
    assert!(
        overlap.contains("\"first\":\"blue-cup\",\"second\":\"red-cup\"") && overlap.contains("\"depth\":0.0"),
        "{overlap}"
    );
    // On the counter nothing is in its way. The pose is written in the frame of the document.
    kitchen.lab.write("put", &put_down([0.6, 1.8, 0.95]));
    kitchen.apply("put", &[]).success();
    assert_eq!(kitchen.check(0), "");
    let stored = kitchen.pose("red-cup");
    assert!(stored.contains("\"frame\":\"table-top\"") && !stored.contains("attached_to"), "{stored}");
    let diff = kitchen.rmem(&["scene", "diff", "start.json", OBJECTS]).exits(1);
    assert_eq!(operations(&diff.stdout), [named("move", "red-cup")]);
    let near = kitchen.rmem(&["scene", "check", OBJECTS, "--frame", "map", "--distance", "0.01"]).exits(1);
    let pairs: Vec<_> = near.stdout.lines().map(|line| ["first", "second"].map(|key| word(line, key))).collect();
    assert!(pairs.contains(&["red-cup", "counter"].map(str::to_owned)), "{near}");
}

#[test]
fn blocks_that_are_moved_in_the_scene_change_the_next_plan() {
    let lab = Lab::new();
    let config = ["--config", "fixtures/blocksworld-geometric.toml"];
    let with = |args: &[&str]| lab.rmem(&[args, &config[..]].concat());
    with(&["count", "robmem.blocks", "--load", "fixtures/blocksworld-geometric.json"]).success();
    let (domain, template) = ("domains/blocksworld/domain.pddl", "templates/blocksworld/problem.pddl.j2");
    let plan = || with(&["plan", "--domain", domain, "--template", template, "--goal", "(on D C)"]).success();
    assert!(plan().contains("(unstack D A)"), "D stands on A");
    // The four keys and a geometry make scenes of documents that know nothing of scenes.
    with(&["scene", "export", "--frame", "map", "--format", "moveit", "-o", "blocks.scene"]).exits(0);
    let scene = lab.read("blocks.scene");
    assert!(scene.contains("* D\n0.432 -0.041 0.05\n"), "{scene}");
    let environment = with(&["scene", "export", "--frame", "map", "--format", "openrave"]).success();
    assert!(environment.contains("<KinBody name=\"D\" file=\"models/block.kinbody.xml\">"), "{environment}");
    // The motion planner's user puts D on the table.
    lab.write("moved.scene", &scene.replace("0.432 -0.041 0.05", "0.7 0.3 0"));
    let applied = with(&["scene", "apply", "moved.scene", "--frame", "map"]).success();
    assert_eq!(operations(&applied), [named("move", "D")]);
    // What was computed from the old poses is kept for half a second.
    std::thread::sleep(Duration::from_millis(600));
    let plan = plan();
    assert!(plan.contains("(pickup D)") && !plan.contains("(unstack D A)"), "{plan}");
}

#[test]
fn two_programs_that_apply_a_scene_at_once_add_each_object_once() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:robot.rmem");
    let object = |n: usize| {
        format!(
            "{{\"name\": \"box {n}\", \"translation\": [{n}, 0, 0], \"rotation\": [0, 0, 0, 1], \
             \"geometry\": {{\"type\": \"box\", \"size\": [0.1, 0.1, 0.1]}}}}"
        )
    };
    let objects = (0..200).map(object).collect::<Vec<_>>().join(", ");
    lab.write("boxes.json", &format!("{{\"frame\": \"map\", \"objects\": [{objects}]}}"));
    lab.rmem(&["create", "a.boxes"]).success();
    std::thread::scope(|scope| {
        let apply = || lab.rmem(&["scene", "apply", "boxes.json", "--into", "a.boxes"]).success();
        let both = [scope.spawn(apply), scope.spawn(apply)].map(|run| run.join().unwrap());
        assert_eq!(both.iter().filter(|report| report.is_empty()).count(), 1, "{both:?}");
    });
    assert_eq!(lab.rmem(&["count", "a.boxes"]).success(), "200\n");
    lab.rmem(&["scene", "export", "a.boxes", "--frame", "map"]).success();
}
