//! What a process may not do with a file. The superuser may do everything, so where these tests
//! run as that one, rmem runs as nobody; where nobody cannot start it, they are ignored.

use std::fs::{Permissions, set_permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use libtest_mimic::{Failed, Trial};

/// A user that owns nothing.
const NOBODY: u32 = 65_534;

pub(crate) fn trials() -> Vec<Trial> {
    let possible = plain(Path::new("/"), &["--version"]).is_ok_and(|output| output.status.success());
    let trials = [
        Trial::test("permissions::a_file_that_may_only_be_read_is_queried", only_read),
        Trial::test("permissions::what_a_writer_has_not_folded_in_yet_is_read_too", read_beside_a_writer),
        Trial::test("permissions::a_file_that_may_not_be_read_is_an_error", not_read),
        Trial::test("permissions::a_folder_that_may_not_be_written_is_an_error", no_new_file),
    ];
    trials.into_iter().map(|trial| trial.with_ignored_flag(!possible)).collect()
}

/// rmem as a user without privileges.
fn plain(folder: &Path, arguments: &[&str]) -> std::io::Result<Output> {
    let mut command = rmem(folder, arguments);
    if rustix::process::geteuid().is_root() {
        command.uid(NOBODY).gid(NOBODY);
    }
    command.output()
}

fn rmem(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rmem"));
    command.env_clear().env("HOME", folder).current_dir(folder).stdin(Stdio::null());
    command.args(["--memory", "file:robot.rmem"]).args(arguments);
    command
}

/// A folder with a memory of three documents that others may read.
fn folder() -> Result<tempfile::TempDir, Failed> {
    let folder = tempfile::tempdir()?;
    let made = rmem(folder.path(), &["insert", "robmem.blocks", "{_id: 1}", "{_id: 2}", "{_id: 3}"]).output()?;
    assert!(made.status.success(), "{made:?}");
    allow(folder.path(), 0o444, 0o555)?;
    Ok(folder)
}

fn allow(folder: &Path, file: u32, itself: u32) -> Result<(), Failed> {
    set_permissions(folder.join("robot.rmem"), Permissions::from_mode(file))?;
    Ok(set_permissions(folder, Permissions::from_mode(itself))?)
}

fn says(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn only_read() -> Result<(), Failed> {
    // In a folder of one's own, and in one that may not be written either.
    for mode in [0o777, 0o555] {
        let folder = folder()?;
        allow(folder.path(), 0o444, mode)?;
        let counted = plain(folder.path(), &["count", "robmem.blocks", "{_id: {$gt: 1}}"])?;
        assert_eq!(String::from_utf8_lossy(&counted.stdout), "2\n", "{counted:?}");
        assert!(plain(folder.path(), &["dump", "--all", "-o", "-"])?.status.success());
        let elsewhere = tempfile::tempdir()?;
        set_permissions(elsewhere.path(), Permissions::from_mode(0o777))?;
        let saved = elsewhere.path().join("saved.rmem");
        let repaired = plain(folder.path(), &["repair", "-o", &saved.display().to_string()])?;
        assert!(repaired.status.success(), "{repaired:?}");
        assert_eq!(saved.metadata()?.permissions().mode() & 0o777, 0o644, "those may read it who may read the other");
        let refused = plain(folder.path(), &["insert", "robmem.blocks", "{_id: 4}"])?;
        assert_eq!(refused.status.code(), Some(4), "{refused:?}");
        assert!(says(&refused).contains("cannot be written; check the permissions"), "{refused:?}");
        assert_eq!(std::fs::read_dir(folder.path())?.count(), 1, "something was made beside the file");
        allow(folder.path(), 0o644, 0o755)?;
    }
    Ok(())
}

fn read_beside_a_writer() -> Result<(), Failed> {
    use rmem::store::{Embedded, Namespace, Store as _};
    let folder = folder()?;
    allow(folder.path(), 0o644, 0o755)?;
    let writer = Embedded::open(folder.path().join("robot.rmem"))?;
    writer.insert(&Namespace::parse("robmem.blocks")?, vec![bson::doc! { "_id": 4 }])?;
    allow(folder.path(), 0o444, 0o555)?;
    let counted = plain(folder.path(), &["count", "robmem.blocks"])?;
    allow(folder.path(), 0o644, 0o755)?;
    assert_eq!(String::from_utf8_lossy(&counted.stdout), "4\n", "{counted:?}");
    Ok(())
}

fn not_read() -> Result<(), Failed> {
    let folder = folder()?;
    allow(folder.path(), 0o000, 0o755)?;
    let refused = plain(folder.path(), &["count", "robmem.blocks"])?;
    assert_eq!(refused.status.code(), Some(4), "{refused:?}");
    assert!(says(&refused).contains("file:robot.rmem: no permission to open"), "{refused:?}");
    Ok(())
}

fn no_new_file() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    set_permissions(folder.path(), Permissions::from_mode(0o555))?;
    let refused = plain(folder.path(), &["insert", "robmem.blocks", "{}"])?;
    assert_eq!(refused.status.code(), Some(4), "{refused:?}");
    assert!(says(&refused).contains("file:robot.rmem: no permission"), "{refused:?}");
    Ok(())
}
