//! Settings: layers, origins, mistakes.

use crate::lab::Lab;

#[test]
fn later_layers_win_and_origins_are_told() {
    let lab = Lab::new();
    lab.write("rmem.toml", "memory = \"file:robot.rmem\"\ncollection = \"a.file\"\n");
    let text = lab.rmem(&["config"]).success();
    assert!(text.contains("memory = \"file:$LAB/robot.rmem\"  # $LAB/rmem.toml:1"), "{text}");
    assert!(text.contains("collection = \"a.file\"  # $LAB/rmem.toml:2"), "{text}");
    let lab = lab.env("RMEM_COLLECTION", "an.env");
    let text = lab.rmem(&["config"]).success();
    assert!(text.contains("collection = \"an.env\"  # environment variable RMEM_COLLECTION"), "{text}");
    let text = lab.rmem(&["config", "--collection", "a.flag"]).success();
    assert!(text.contains("collection = \"a.flag\"  # --collection"), "{text}");
}

#[test]
fn the_nearest_file_upwards_is_used() {
    let lab = Lab::new();
    lab.write("rmem.toml", "collection = \"outer.x\"\n");
    lab.write("deep/er/rmem.toml", "");
    let text = lab.shell("cd deep && rmem config").success();
    assert!(text.contains("collection = \"outer.x\""), "{text}");
    let text = lab.shell("cd deep/er && rmem config").success();
    assert!(text.contains("collection = \"robmem.worldmodel\"  # default"), "{text}");
}

#[test]
fn a_mistake_in_the_file_is_shown_at_its_place() {
    let lab = Lab::new();
    lab.write("rmem.toml", "memory = \"mem:\"\ncollektion = \"a.b\"\n");
    let run = lab.rmem(&["collections"]).exits(3);
    assert!(run.stderr.contains("$LAB/rmem.toml:2:1: unknown field `collektion`"), "{run}");
    assert!(run.stderr.contains("^^^^^^^^^^"), "{run}");
}

#[test]
fn credentials_are_never_shown() {
    let lab = Lab::new();
    let uri = "mongodb://robot:s3cret@127.0.0.1:1/?serverSelectionTimeoutMS=100";
    let run = lab.rmem(&["--memory", uri, "config"]);
    assert!(!run.stdout.contains("s3cret"), "{run}");
    lab.write("rmem.toml", &format!("memory = \"{uri}\" x\n"));
    let run = lab.rmem(&["config"]).exits(3);
    assert!(!run.stderr.contains("s3cret"), "{run}");
    lab.write("rmem.toml", "");
    let run = lab.rmem(&["--memory", uri, "query", "robmem.x", "-v"]).exits(4);
    assert!(!run.stderr.contains("s3cret"), "{run}");
    assert!(run.stderr.contains("127.0.0.1:1"), "{run}");
}

#[test]
fn operations_are_told_under_v_and_logged() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "{a: 2}", "-q"]).success();
    let run = lab.rmem(&["query", "robmem.x", "-v", "--log", "rmem.log"]).exits(0);
    assert!(run.stderr.contains("find robmem.x: 2 documents in "), "{run}");
    let entry: serde_json::Value = serde_json::from_str(lab.read("rmem.log").trim()).unwrap();
    assert_eq!((&entry["operation"], &entry["subject"]), (&"find".into(), &"robmem.x".into()));
    assert!(entry["milliseconds"].is_f64());
    let run = lab.rmem(&["query", "robmem.x", "-q"]).exits(0);
    assert_eq!(run.stderr, "");
}

#[test]
fn a_format_set_for_good_is_for_the_commands_that_have_it() {
    let lab = Lab::new().env("RMEM_FORMAT", "clips");
    lab.rmem(&["insert", "robmem.x", "{_id: 1}", "-q"]).success();
    assert_eq!(lab.rmem(&["query", "robmem.x"]).success(), "{\"_id\":1}\n");
    lab.rmem(&["query", "robmem.x", "--format", "clips"]).exits(2);
}

#[test]
fn a_variable_that_is_not_utf_8_is_refused() {
    let run = Lab::new().shell("RMEM_MEMORY=$'file:\\xff' rmem count robmem.x").exits(2);
    assert!(run.stderr.contains("RMEM_MEMORY"), "{run}");
}
