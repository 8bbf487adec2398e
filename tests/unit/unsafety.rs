//! Where `unsafe` may stand.

use std::fs;
use std::path::{Path, PathBuf};

/// The one module that may.
const MODULE: &str = "src/clips/engine/native";

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn one_module_only_may_be_unsafe() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut found, mut allowing) = (Vec::new(), Vec::new());
    sources(&root.join("src"), &mut found);
    for path in found {
        let text = fs::read_to_string(&path).unwrap();
        // The lint is denied for the whole crate, so that nothing is unsafe without these words.
        if text.contains("unsafe_code") {
            allowing.push(path.strip_prefix(root).unwrap().to_owned());
        }
    }
    assert_eq!(allowing, [Path::new(MODULE).join("mod.rs")]);
    let manifest = fs::read_to_string(root.join("Cargo.toml")).unwrap();
    assert!(manifest.contains("unsafe_code = \"deny\""));
}

#[test]
fn every_unsafe_block_says_why_it_is_safe() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    sources(&root.join(MODULE), &mut found);
    assert!(found.len() > 3, "{found:?}");
    for path in found {
        let text = fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (nth, line) in
            lines.iter().enumerate().filter(|(_, line)| line.contains("unsafe {") || line.contains("unsafe impl"))
        {
            let before = &lines[nth.saturating_sub(4)..nth];
            let printed = before.iter().any(|line| line.contains("SAFETY:"));
            assert!(printed, "{}:{}: {line}", path.display(), nth + 1);
        }
    }
}
