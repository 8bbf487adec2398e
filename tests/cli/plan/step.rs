//! plan step.

use crate::lab::{Lab, assert_run, plan};

#[test]
fn steps_are_noted_with_their_times() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    for (step, state) in [("1", "--started"), ("1", "--done"), ("next", "--started"), ("3", "--failed")] {
        lab.rmem(&["plan", "step", "last", step, state]).success();
    }
    let stored = lab.rmem(&["query", "robmem.plans"]).success();
    let document: serde_json::Value = serde_json::from_str(stored.trim()).unwrap();
    let status = |step: &str| document[step]["_status"].clone();
    assert_eq!((status("1"), status("2"), status("3")), ("done".into(), "running".into(), "failed".into()));
    assert!(document["1"]["_started"]["$date"].is_string() && document["1"]["_ended"]["$date"].is_string());
    assert!(document["2"]["_ended"].is_null() && document["4"]["_status"].is_null(), "{stored}");
    assert_run!(lab.rmem(&["plan", "show", "last"]), @r"
    (stack B C) ; done
    (unstack D A) ; running
    (putdown D) ; failed
    (pickup A)
    (stack A B)
    ; cost = 5 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    lab.rmem(&["plan", "step", "last", "3", "--open"]).success();
    assert!(!lab.rmem(&["query", "robmem.plans"]).success().contains("failed"));
    let wrong = ["0", "6", "x", "-1"].map(|step| ["plan", "step", "last", "--done", "--", step]);
    assert_run!(lab.transcript(&wrong.each_ref().map(|args| &args[..])), @r"
    $ rmem plan step last --done -- 0
    ------- stderr -------
    error: the plan has 5 steps; expected a number from 1 to 5, found 0
    [exit code: 2]
    $ rmem plan step last --done -- 6
    ------- stderr -------
    error: the plan has 5 steps; expected a number from 1 to 5, found 6
    [exit code: 2]
    $ rmem plan step last --done -- x
    ------- stderr -------
    error: `x` is no step; expected a number from 1, an action like '(pick A)', or `next`
    [exit code: 2]
    $ rmem plan step last --done -- -1
    ------- stderr -------
    error: `-1` is no step; expected a number from 1, an action like '(pick A)', or `next`
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["plan", "step", "last", "1"]), @r"
    ------- stderr -------
    error: the following required arguments were not provided:
      <--started|--done|--failed|--open>

    Usage: rmem plan step <--started|--done|--failed|--open> <ID> <N>

    For more information, try '--help'.
    [exit code: 2]
    ");
}

#[test]
fn steps_of_the_other_layout_are_noted_too() {
    let lab = Lab::new();
    plan(&lab, &["-q", "--layout", "fawkes"]).success();
    lab.rmem(&["plan", "step", "last", "2", "--done", "--out-of-order"]).success();
    let stored = ["query", "robmem.plans", "{'actions.1.status': 'done'}", "--fields", "{'actions.ended': 1, _id: 0}"];
    assert_run!(lab.rmem(&stored), @r#"
    {"actions":[{},{"ended":{"$date":"[TIME]"}},{},{},{}]}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["plan", "show", "last", "--format", "clips"]), @r"
    (plan (id [ID]) (cost 5.0))
    (plan-action (id 1) (plan-id [ID]) (name stack) (arguments B C) (status FORMULATED))
    (plan-action (id 2) (plan-id [ID]) (name unstack) (arguments D A) (status FINAL))
    (plan-action (id 3) (plan-id [ID]) (name putdown) (arguments D) (status FORMULATED))
    (plan-action (id 4) (plan-id [ID]) (name pickup) (arguments A) (status FORMULATED))
    (plan-action (id 5) (plan-id [ID]) (name stack) (arguments A B) (status FORMULATED))
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_step_before_an_earlier_one_needs_an_option() {
    let lab = Lab::new();
    plan(&lab, &["-q"]).success();
    assert_run!(lab.rmem(&["plan", "step", "last", "3", "--done"]), @r"
    ------- stderr -------
    error: step 3 cannot be done while step 1 is open; mark step 1 first, or use --out-of-order
    [exit code: 2]
    ");
    lab.rmem(&["plan", "step", "last", "3", "--done", "--out-of-order"]).success();
}
