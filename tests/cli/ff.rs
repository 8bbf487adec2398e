//! ff: the command line of FF.

use crate::gen_problem::problem;
use crate::lab::{Lab, assert_run};

#[test]
fn the_builtin_planner_prints_as_ff_does() {
    let lab = Lab::new();
    lab.write("p.pddl", &problem(&lab));
    let run = lab.rmem(&["ff", "-o", "domains/blocksworld/domain.pddl", "-f", "p.pddl"]);
    assert_run!(run, @r"

    ff: parsing domain file
    domain 'blocksworld' defined
     ... done.
    ff: parsing problem file
    problem 'blocksworld-generated' defined
     ... done.



    ff: found legal plan as follows

    step    0: PUTDOWN B
            1: UNSTACK D A
            2: PUTDOWN D
            3: PICKUP A
            4: STACK A B
         

    time spent:    not measured

    ------- stderr -------
    [exit code: 0]
    ");
}
