//! `docs/settings.md` has every key of `rmem.toml`, and no other.
//!
//! The keys are asked of the settings' types: the message about an unknown key lists those that are known.

use std::collections::BTreeSet;

use super::text;
use crate::lab::Lab;

/// Sections of the page, and a settings file with an unknown key in that table.
const TABLES: [(&str, &str); 6] = [
    ("## Top level", "unknown = 1"),
    ("## [planner.NAME]", "[planner.x]\nunknown = 1"),
    ("## [[computable]]", "[[computable]]\nunknown = 1"),
    ("## [[scene.object]]", "[[scene.object]]\nunknown = 1"),
    ("## [backend.local] and", "[backend.local]\nunknown = 1"),
    ("## [backend.local] and", "[backend.shared]\nunknown = 1"),
];

#[test]
fn the_page_on_settings_has_all_keys() {
    let page = text("docs/settings.md");
    let lab = Lab::new();
    for (heading, settings) in TABLES {
        lab.write("unknown.toml", settings);
        let run = lab.rmem(&["config", "--config", "unknown.toml"]).exits(3);
        let known = run.stderr.split("expected").nth(1).and_then(|rest| rest.lines().next()).unwrap_or_default();
        let known: BTreeSet<&str> = known.split('`').skip(1).step_by(2).collect();
        assert!(known.len() > 1, "{run}");
        assert_eq!(documented(&page, heading), known, "{heading}");
    }
}

/// The first cells of the table below a heading.
fn documented<'a>(page: &'a str, heading: &str) -> BTreeSet<&'a str> {
    let section = page.split("\n## ").find(|section| section.starts_with(heading.trim_start_matches("## ")));
    let rows = section.unwrap_or_else(|| panic!("no {heading}")).lines().filter_map(|line| line.strip_prefix("| `"));
    rows.filter_map(|row| row.split('`').next()).collect()
}
