//! backup.

use crate::lab::{Lab, assert_run};
use crate::repair::lab;

#[test]
fn a_backup_is_the_memory_at_one_moment() {
    let lab = lab();
    lab.rmem(&["backup", "copy.rmem"]).success();
    lab.rmem(&["delete", "a.b", "--all"]).success();
    let copied = lab.rmem(&["--memory", "file:copy.rmem", "query", "a.b", "{n: 2}"]).success();
    assert_eq!(copied, "{\"_id\":2,\"n\":2}\n");
    lab.rmem(&["--memory", "file:copy.rmem", "insert", "a.b", "{_id: 4}"]).success();
    lab.rmem(&["--memory", "file:copy.rmem", "doctor", "--deep"]).success();
    assert_run!(lab.rmem(&["backup", "copy.rmem"]), @r"
    ------- stderr -------
    error: file:copy.rmem: exists already; name a file that does not exist yet
    [exit code: 4]
    ");
    assert_run!(lab.rmem(&["backup", "missing/copy.rmem"]), @r"
    ------- stderr -------
    error: file:missing/copy.rmem: its folder missing does not exist; create it first
    [exit code: 4]
    ");
    let mut files: Vec<_> =
        std::fs::read_dir(lab.path()).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    files.sort();
    assert_eq!(files, ["copy.rmem", "robot.rmem"]);
}

#[test]
fn a_backup_that_cannot_be_written_names_the_folder() {
    let lab = lab();
    // A folder in which no file can be made.
    assert_run!(lab.rmem(&["backup", "/proc/copy.rmem"]), @r"
    ------- stderr -------
    error: file:/proc/copy.rmem: cannot make a file in /proc: there is no such file or folder
    [exit code: 4]
    ");
}

#[test]
fn a_backup_is_a_file() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "-q", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["backup", "-"]).exits(2);
    assert!(!lab.path().join("-").exists());
}
