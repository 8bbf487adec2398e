//! Every Rust file of the project is a module of a target: none is forgotten, and none is compiled by accident.

use std::path::{Path, PathBuf};

/// The folders of targets, and their first files.
const TARGETS: [(&str, &str); 5] = [
    ("src", "lib.rs"),
    ("tests/cli", "main.rs"),
    ("tests/unit", "main.rs"),
    ("tests/integration", "main.rs"),
    ("tests/conformance", "main.rs"),
];

#[test]
fn every_file_is_declared_as_a_module() {
    for (folder, first) in TARGETS {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        let files = files(&root);
        assert!(files.len() > 5, "{folder}");
        for file in files.iter().filter(|file| **file != root.join(first) && !file.ends_with("src/main.rs")) {
            let (parent, name) = declaration(file, &root, first);
            let text = std::fs::read_to_string(&parent).unwrap_or_default();
            let declared = text.lines().any(|line| declares(line, &name));
            assert!(declared, "{} is not declared in {}", file.display(), parent.display());
        }
    }
}

/// The file that has to declare this one, and the name of its module.
fn declaration(file: &Path, root: &Path, first: &str) -> (PathBuf, String) {
    let stem = |path: &Path| path.file_stem().unwrap().to_string_lossy().into_owned();
    let is_folder = stem(file) == "mod";
    let module = if is_folder { file.parent().unwrap() } else { file };
    let above = module.parent().unwrap();
    let beside = above.with_extension("rs");
    let parent = if above == root {
        root.join(first)
    } else if beside.exists() {
        beside
    } else {
        above.join("mod.rs")
    };
    (parent, stem(module))
}

/// Whether a line is `mod NAME;` of any visibility, or names the file of a module.
fn declares(line: &str, name: &str) -> bool {
    let line = line.trim();
    let module = line.strip_suffix(';').and_then(|line| line.rsplit_once("mod "));
    module.is_some_and(|(before, module)| module == name && (before.is_empty() || before.starts_with("pub")))
        || (line.starts_with("#[")
            && line.contains("path = ")
            && ["/", "\""].iter().any(|before| line.contains(&format!("{before}{name}.rs\""))))
}

/// The Rust files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            files.extend(self::files(&path));
        } else if path.extension().is_some_and(|end| end == "rs") {
            files.push(path);
        }
    }
    files
}

#[test]
fn a_file_that_is_not_declared_is_found() {
    assert!(declares("pub(crate) mod lab;", "lab"));
    assert!(declares("mod lab;", "lab"));
    for other in ["mod labs;", "// mod lab;", "use lab;", "mod lab {"] {
        assert!(!declares(other, "lab"), "{other}");
    }
}
