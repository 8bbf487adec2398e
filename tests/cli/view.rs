//! view.

use crate::lab::{Lab, assert_run, kitchen};

#[test]
fn the_browser_needs_a_terminal() {
    assert_run!(kitchen(&Lab::new(), &["view"]), @r"
    ------- stderr -------
    error: view needs a terminal; for other programs there is rmem query
    [exit code: 2]
    ");
}
