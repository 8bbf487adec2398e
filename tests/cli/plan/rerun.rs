//! plan rerun.

use super::STACKED;
use crate::lab::{Lab, assert_run, plan};

#[test]
fn a_rerun_plans_the_same_task_in_the_world_of_now() {
    let lab = Lab::new();
    plan(&lab, &["-q", "--timeout", "50s"]).success();
    STACKED.iter().for_each(|line| drop(lab.shell(line).success()));
    lab.rmem(&["plan", "check", "last"]).exits(1);
    assert_run!(lab.rmem(&["plan", "rerun", "last", "-q"]), @r"
    (unstack D A)
    (putdown D)
    (pickup A)
    (stack A B)
    ; cost = 4 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    // The lines in between have times and checksums.
    let lineage = lab.rmem(&["plan", "why", "last"]).success();
    assert!(lineage.contains("rerun of") && lineage.contains("timeout     50000 ms"), "{lineage}");
    lab.rmem(&["plan", "check", "last"]).exits(0);
}
