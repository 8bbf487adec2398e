//! The example of an executive that is a node of ROS 2, with rclpy, on the loopback.

use std::path::Path;
use std::process::{Command, Stdio};

use libtest_mimic::{Failed, Trial};

use crate::scenes::programs::Python;

/// The trial is ignored where rclpy or its messages are not installed.
pub(crate) fn trials() -> Vec<Trial> {
    let has_ros = Python::find().is_some_and(|python| python.has("rclpy") && python.has("std_msgs"));
    let name = "ros::the_executive_plans_for_a_goal_and_plans_again_after_a_failure";
    vec![Trial::test(name, execute).with_ignored_flag(!has_ros)]
}

fn execute() -> Result<(), Failed> {
    let python = Python::find().ok_or("there is no python3")?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir()?;
    let program = Path::new(env!("CARGO_BIN_EXE_rmem"));
    let programs = program.parent().ok_or("rmem is nowhere")?.display().to_string();
    let path = std::env::var("PATH").unwrap_or_default();
    let environment = [
        ("RMEM_MEMORY", format!("file:{}", folder.path().join("blocks.rmem").display())),
        ("RMEM_PROGRAM", program.display().to_string()),
        ("PYTHONPATH", root.join("python").display().to_string()),
        ("PATH", format!("{programs}:{path}")),
        ("HOME", folder.path().display().to_string()),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST".to_owned()),
        // A domain of its own: other nodes of this machine are not heard.
        ("ROS_DOMAIN_ID", (std::process::id() % 100).to_string()),
    ];
    let start = |program: &Path, words: &[&str]| {
        let mut command = Command::new(program);
        command.args(words).envs(environment.clone()).current_dir(root).stdin(Stdio::null());
        command
    };
    let load = ["count", "robmem.worldmodel", "--load", "fixtures/blocksworld.json"];
    start(program, &load).stdout(Stdio::null()).status()?;
    let executive = "examples/python/ros_executive.py";
    let task = [executive, "domains/blocksworld/domain.pddl", "templates/blocksworld/problem.pddl.j2"];
    let mut executive = start(python.path(), &task).stderr(Stdio::null()).spawn()?;
    let hands = ["tests/integration/ros_hands.py", "(and (on A B) (on B C))", "examples/shell/blocks.sh"];
    let ran = start(python.path(), &hands).output();
    executive.kill()?;
    executive.wait()?;
    let ran = ran?;
    let printed = String::from_utf8(ran.stdout)?;
    let wanted = "planned\ndid stack B C\nfailed unstack D A\nplanned\ndid unstack D A\ndid putdown D\ndid pickup A\n\
                  did stack A B\nreached\n";
    if printed == wanted {
        return Ok(());
    }
    Err(format!("{printed}{}", String::from_utf8_lossy(&ran.stderr)).into())
}
