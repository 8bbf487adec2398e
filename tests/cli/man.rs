//! man.

use crate::lab::{Lab, assert_run};

#[test]
fn each_command_and_subcommand_has_a_page() {
    let lab = Lab::empty();
    lab.rmem(&["man", "--out", "pages"]).success();
    let mut pages: Vec<String> = std::fs::read_dir(lab.path().join("pages"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    pages.sort();
    for name in ["rmem.1", "rmem-insert.1", "rmem-plan-check.1", "rmem-scene-export.1"] {
        assert!(pages.contains(&name.to_owned()), "no {name} in {pages:?}");
    }
    for page in &pages {
        let words: Vec<&str> = page.trim_end_matches(".1").split('-').skip(1).collect();
        assert!(lab.read(&format!("pages/{page}")).contains(".SH SYNOPSIS"), "{page}");
        // A name with a hyphen, like gen-problem, is one word.
        if page.matches('-').count() < 2 {
            assert_eq!(
                lab.rmem(&[&["man"], &words[..]].concat()).success(),
                lab.read(&format!("pages/{page}")),
                "{page}"
            );
        }
    }
}

#[test]
fn a_page_of_no_command_is_refused() {
    assert_run!(Lab::empty().rmem(&["man", "nosuch"]), @r"
    ------- stderr -------
    error: unknown command `nosuch`; `rmem help` lists the commands
    [exit code: 2]
    ");
}
