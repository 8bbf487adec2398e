//! How the commands about stored plans find the one that is meant.

use crate::lab::{Lab, assert_run, plan};

#[test]
fn a_plan_is_found_by_its_id_or_the_beginning_of_it() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    plan(&lab, &["-q", "--into", "lab.plans"]).success();
    let list = lab.rmem(&["plan", "list", "--in", "lab.plans"]).success();
    let listed: serde_json::Value = serde_json::from_str(list.trim()).unwrap();
    let id = listed["_id"]["$oid"].as_str().unwrap();
    for id in [id, &id[..20]] {
        lab.rmem(&["plan", "show", id, "--in", "lab.plans"]).success();
    }
    assert_run!(lab.rmem(&["plan", "show", id]), @r"
    ------- stderr -------
    error: no plan in robmem.plans has the id `[ID]`; list the ids with `rmem plan list`, or use `last`
    [exit code: 2]
    ");
    plan(&lab, &["-q"]).success();
    // The message has the beginning of the id, which is a time.
    let run = lab.rmem(&["plan", "show", &id[..6]]).exits(2);
    assert!(run.stderr.contains("several plans"), "{run}");
    assert_run!(lab.rmem(&["plan", "show", "nosuch"]), @r"
    ------- stderr -------
    error: no plan in robmem.plans has the id `nosuch`; list the ids with `rmem plan list`, or use `last`
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["plan", "show", "last", "--in", "lab.none"]), @r"
    ------- stderr -------
    error: there is no plan in lab.none
    [exit code: 2]
    ");
}
