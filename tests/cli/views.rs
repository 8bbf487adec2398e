//! Views for people: schema, plot, drawings of plans, logs for Foxglove, and the browser's refusal without a terminal.

use crate::lab::{Lab, plan};

const KITCHEN: [&str; 4] = ["--memory", "mem:", "--load", "fixtures/scenes/kitchen.json"];

fn kitchen(lab: &Lab, args: &[&str]) -> crate::lab::Finished {
    lab.rmem(&[&KITCHEN[..], args].concat())
}

#[test]
fn a_schema_describes_each_field() {
    let lab = Lab::new();
    let fields = kitchen(&lab, &["schema", "robmem.worldmodel", "{type: 'object'}"]).success();
    let mass = fields.lines().find(|line| line.contains("\"field\":\"mass\"")).unwrap();
    assert_eq!(
        mass,
        "{\"field\":\"mass\",\"documents\":2,\"share\":1.0,\"types\":{\"double\":2},\"distinct\":1,\"least\":0.25,\
         \"greatest\":0.25,\"frequent\":[{\"value\":0.25,\"count\":2}]}"
    );
    assert!(fields.contains("\"field\":\"geometry.radius\""), "{fields}");
    let table = kitchen(&lab, &["schema", "robmem.worldmodel", "--format", "table"]).success();
    assert!(table.starts_with("field "), "{table}");
}

#[test]
fn documents_are_drawn_as_svg_and_png() {
    let lab = Lab::new();
    kitchen(&lab, &["plot", "robmem.worldmodel", "--kind", "map", "--by", "type", "-o", "map.svg"]).exits(0);
    let svg = lab.read("map.svg");
    for part in ["<svg", ">red-cup<", ">surface<", ">x (m)<", ">robmem.worldmodel<"] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
    let bars =
        ["plot", "robmem.worldmodel", "[{$group: {_id: '$type', n: {$sum: 1}}}]", "--kind", "bars", "--x", "_id"];
    kitchen(&lab, &[&bars[..], &["--y", "n", "-o", "bars.png"]].concat()).exits(0);
    let png = std::fs::read(lab.path().join("bars.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"));
    lab.write(
        "jobs.json",
        "{\"a.jobs\": [{\"name\": \"fetch\", \"from\": 1, \"to\": 5}, {\"name\": \"place\", \"from\": 5, \"to\": 7}]}",
    );
    let timeline = ["--memory", "mem:", "--load", "jobs.json", "plot", "a.jobs", "--kind", "timeline", "-o", "-"];
    let svg = lab.rmem(&timeline).success();
    assert!(svg.contains(">fetch<") && svg.contains(">time (s)<"), "{svg}");
}

#[test]
fn what_cannot_be_drawn_is_said_and_leaves_no_file() {
    let lab = Lab::new();
    let plot = |args: &[&str]| kitchen(&lab, &[&["plot", "robmem.worldmodel", "-o", "out.svg"], args].concat());
    let missing = plot(&["--x", "nothing", "--y", "mass"]).exits(3);
    assert!(missing.stderr.contains("no document of robmem.worldmodel has what is drawn"), "{missing}");
    let partly = plot(&["--x", "translation.0", "--y", "mass", "--kind", "scatter"]).exits(0);
    assert!(partly.stderr.contains("4 of 6 documents have not what is drawn"), "{partly}");
    std::fs::remove_file(lab.path().join("out.svg")).unwrap();
    plot(&["--x", "mass"]).exits(2);
    plot(&["--x", "mass", "--y", "mass", "--size", "0x0"]).exits(2);
    plot(&["[{$nonsense: 1}]", "--x", "mass", "--y", "mass"]).exits(3);
    assert!(!lab.path().join("out.svg").exists());
}

#[test]
fn a_scene_is_drawn_from_above() {
    let lab = Lab::new();
    kitchen(&lab, &["scene", "show", "robmem.worldmodel", "--frame", "map", "-o", "top.svg"]).exits(0);
    let svg = lab.read("top.svg");
    for part in [">counter<", ">blue-cup<", ">gripper<", ">static<", ">movable<", ">frames<"] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
}

#[test]
fn a_plan_is_drawn_in_lanes_with_its_causal_links() {
    let lab = Lab::new();
    plan(&lab, &[]).exits(0);
    lab.rmem(&["plan", "step", "last", "1", "--started"]).exits(0);
    lab.rmem(&["plan", "step", "last", "1", "--done"]).exits(0);
    let svg = lab.rmem(&["plan", "show", "last", "--format", "svg"]).success();
    for part in [
        "5 steps",
        ">1 stack<",
        ">makes true what is needed<",
        "fill=\"#c3e6d8\"",
        "marker-end=\"url(#arrow)\"",
        "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
    ] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
    // Block B is put on C once: three blocks are moved, and each has a lane.
    assert_eq!(svg.matches("font-weight=\"bold\">A<").count(), 1, "{svg}");
    let lanes = lab.rmem(&["plan", "show", "last", "--format", "svg", "--lanes", "action"]).success();
    assert!(lanes.contains("font-weight=\"bold\">unstack<"), "{lanes}");
    let timeline = lab.rmem(&["plan", "show", "last", "--format", "timeline"]).success();
    assert!(timeline.contains(">planned<") && timeline.contains(">done<"), "{timeline}");
}

#[test]
fn the_graph_of_a_plan_is_its_partial_order() {
    let lab = Lab::new();
    plan(&lab, &[]).exits(0);
    let dot = lab.rmem(&["plan", "show", "last", "--format", "dot"]).success();
    // (unstack D A) needs the hand that (stack B C) leaves empty.
    assert!(dot.contains("s1 -> s2 [label="), "{dot}");
    assert!(dot.contains("init -> s1;") && dot.contains("s5 -> goal;"), "{dot}");
    assert!(!dot.contains("s1 -> s5"), "what follows from others is left out: {dot}");
}

#[test]
fn documents_become_a_log_of_messages_and_scenes() {
    let lab = Lab::new();
    let args = ["export", "mcap", "robmem.worldmodel", "--time", "mass", "-o", "log.mcap"];
    let written = kitchen(&lab, &args).exits(0);
    assert!(
        written.stderr.contains("2 documents, 2 of them objects of a scene; 4 without a time are left out"),
        "{written}"
    );
    let log = std::fs::read(lab.path().join("log.mcap")).unwrap();
    assert!(log.starts_with(b"\x89MCAP0\r\n") && log.ends_with(b"\x89MCAP0\r\n"));
    let none = kitchen(&lab, &["export", "mcap", "robmem.worldmodel", "--time", "name", "-o", "none.mcap"]).exits(3);
    assert!(none.stderr.contains("has a date or seconds under `name`"), "{none}");
    assert!(!lab.path().join("none.mcap").exists());
}

#[test]
fn the_browser_needs_a_terminal() {
    let refused = kitchen(&Lab::new(), &["view"]).exits(2);
    assert!(refused.stderr.contains("view needs a terminal"), "{refused}");
}
