//! plot.

use crate::lab::{Lab, assert_run, kitchen};

#[test]
fn numbers_that_are_too_large_are_not_called_missing() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "{x: 1, y: 1e301}", "{x: NaN, y: 1}", "{x: 1}"]).success();
    let plot = ["plot", "a.b", "--x", "x", "--y", "y", "-o", "p.svg"];
    let refused = lab.rmem(&plot).exits(3);
    assert_eq!(
        refused.stderr,
        "1 of 3 documents lack `x` or `y` and are left out\n\
         2 of 3 documents have a number in `x` or `y` that cannot be drawn (too large, or NaN) and are left out\n\
         error: no document of a.b has numbers that can be drawn\n"
    );
    lab.rmem(&["insert", "a.b", "{x: 1, y: 2}"]).success();
    assert_eq!(lab.rmem(&plot).exits(0).stderr.lines().count(), 2);
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
fn a_timeline_of_plans_has_their_steps_as_they_were_executed() {
    let lab = Lab::new();
    let plan = ["plan", "-q", "-d", "domains/blocksworld/domain.pddl", "-t", "templates/blocksworld/problem.pddl.j2"];
    lab.rmem(&[&plan[..], &["--load", "fixtures/blocksworld.json", "--goal", "(and (on A B) (on B C))"]].concat())
        .success();
    let plot = ["plot", "robmem.plans", "--kind", "timeline", "--by", "status", "-o", "-"];
    lab.rmem(&plot).exits(3);
    for status in ["--started", "--done"] {
        lab.rmem(&["plan", "step", "last", "1", status]).success();
    }
    let svg = lab.rmem(&plot).success();
    assert!(svg.contains(">(stack B C)<") && !svg.contains("(unstack D A)"), "{svg}");
}

#[test]
fn odd_names_and_huge_numbers_leave_a_drawing_that_can_be_read() {
    let lab = Lab::new();
    let documents = [r"{x: 'a\u0007<b', y: 1}", "{x: 'c', y: 9e299}", "{x: 'd', y: 2e300}"];
    lab.rmem(&[&["insert", "a.b"], &documents[..]].concat()).success();
    let plot = ["plot", "a.b", "--x", "x", "--y", "y", "--kind", "bars", "--title", "t\u{1}\u{202e}", "-o", "out.svg"];
    assert_run!(lab.rmem(&plot), @r"
    ------- stderr -------
    1 of 3 documents have a number in `x` or `y` that cannot be drawn (too large, or NaN) and are left out
    [exit code: 0]
    ");
    let svg = lab.read("out.svg");
    roxmltree::Document::parse(&svg).unwrap();
    for part in [r">a\u{7}&lt;b<", r">t\u{1}\u{202e}<", ">2e299<", ">0<"] {
        assert!(svg.contains(part), "no {part} in {svg}");
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_and_leaves_no_file() {
    let lab = Lab::new();
    let plot = |args: &[&str]| kitchen(&lab, &[&["plot", "robmem.worldmodel", "-o", "out.svg"], args].concat());
    assert_run!(plot(&["--x", "nothing", "--y", "mass"]), @r"
    ------- stderr -------
    6 of 6 documents lack `nothing` or `mass` and are left out
    error: no document of robmem.worldmodel has what is drawn, `nothing` and `mass`; --x FIELD --y FIELD draw other fields, which rmem schema robmem.worldmodel prints
    [exit code: 3]
    ");
    assert_run!(plot(&["--x", "translation.0", "--y", "mass", "--kind", "scatter"]), @r"
    ------- stderr -------
    4 of 6 documents lack `translation.0` or `mass` and are left out
    [exit code: 0]
    ");
    std::fs::remove_file(lab.path().join("out.svg")).unwrap();
    assert_run!(plot(&["--x", "mass"]), @r"
    ------- stderr -------
    error: expected --x FIELD and --y FIELD; see the fields with rmem schema NS
    [exit code: 2]
    ");
    assert_run!(plot(&["--x", "mass", "--y", "mass", "--size", "0x0"]), @r"
    ------- stderr -------
    error: invalid value '0x0' for '--size <WxH>': `0x0` is not a size; expected WIDTHxHEIGHT in pixels, 100 to 10000 each, like 800x500

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(plot(&["[{$nonsense: 1}]", "--x", "mass", "--y", "mass"]), @r"
    ------- stderr -------
    error: <pipeline>:1:3: unrecognized pipeline stage name: '$nonsense'
      |
    1 | [{$nonsense: 1}]
      |   ^^^^^^^^^
    [exit code: 3]
    ");
    assert!(!lab.path().join("out.svg").exists());
}
