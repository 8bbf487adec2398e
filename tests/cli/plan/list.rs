//! plan list.

use crate::lab::{Lab, TASK, assert_run, plan};

#[test]
fn a_list_has_the_newest_plan_first() {
    let lab = Lab::new();
    plan(&lab, &[]).success();
    lab.rmem(&[&["plan"], &TASK[2..6], &["--goal", "(on C A)"]].concat()).success();
    let list = lab.rmem(&["plan", "list"]);
    assert_run!(list, @r#"
    {"_id":{"$oid":"[ID]"},"stored":{"$date":"[TIME]"},"outcome":"success","steps":5,"done":0,"cost":5,"seconds":[DURATION],"planner":"builtin","goal":"(on C A)"}
    {"_id":{"$oid":"[ID]"},"stored":{"$date":"[TIME]"},"outcome":"success","steps":5,"done":0,"cost":5,"seconds":[DURATION],"planner":"builtin","goal":"(and (on A B) (on B C))"}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["plan", "list", "--limit", "1"]).success().lines().next(), list.stdout.lines().next());
}
