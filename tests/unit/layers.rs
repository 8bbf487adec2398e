//! Dependencies between modules point one way (docs/architecture.md), and are those that are listed here.
//!
//! The sources are read as text: `use` trees and paths in bodies, without comments, literals, and unit tests.
//! A name that a `mod.rs` re-exports counts as its origin's; the re-export itself is no dependency.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Groups of files that import each other, by the first one, how many they are, and why they may.
const RECURSIVE: [(&str, usize, &str); 4] = [
    ("query::expression::constants", 5, "expressions contain expressions"),
    ("query::filter::operators", 2, "filters contain filters"),
    ("query::filter::test", 2, "filters contain filters"),
    ("query::pipeline", 7, "stages such as $facet and $lookup contain pipelines"),
];

/// Each module, and the modules that it uses. A new dependency is written down here.
const USES: [(&str, &str); 29] = [
    ("backend", "fault formats settings store"),
    ("bench", "memory saturate store views"),
    ("calendar", ""),
    ("cli", "commands formats output settings store"),
    ("clips", "error fault formats input memory plan planner planning problem process query saturate store"),
    (
        "commands",
        "backend bench calendar clips error exit fault formats input interrupt memory output pddl plan planner \
         planning problem process query saturate scene serve settings store views",
    ),
    ("deadline", ""),
    ("error", "fault"),
    ("exit", ""),
    ("fault", ""),
    ("formats", "calendar fault"),
    ("input", "fault formats"),
    ("interrupt", ""),
    ("memory", "calendar fault formats input interrupt process query saturate store"),
    ("monotonic", ""),
    ("output", "error fault formats input interrupt process"),
    ("pddl", "formats"),
    ("plan", "fault formats memory pddl problem query saturate store"),
    ("planner", "fault formats pddl process"),
    ("planning", "fault formats interrupt memory pddl plan planner problem process saturate store"),
    ("problem", "fault formats input memory pddl query store"),
    ("process", "formats interrupt"),
    ("query", "calendar fault"),
    ("saturate", ""),
    ("scene", "formats memory query store"),
    ("serve", "deadline fault memory monotonic process query saturate store"),
    ("settings", "error formats input memory output pddl planner query scene store"),
    ("store", "calendar deadline fault formats interrupt monotonic process query saturate"),
    ("views", "fault formats memory query saturate scene store"),
];

type Name = Vec<String>;

/// One source file: what it imports under which name, and the paths in its body.
#[derive(Default)]
struct Module {
    names: BTreeMap<String, Name>,
    /// Whether an import is used here, or only re-exported.
    uses: Vec<(Name, bool)>,
    paths: Vec<Name>,
}

/// All modules of the library, by their paths.
struct Modules(BTreeMap<Name, Module>);

fn main_part(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default()
}

/// The text without comments and the contents of literals.
fn plain(text: &str) -> String {
    let bytes: Vec<char> = text.chars().collect();
    let (mut out, mut at) = (String::with_capacity(text.len()), 0);
    let starts = |at: usize, word: &str| word.chars().enumerate().all(|(nth, c)| bytes.get(at + nth) == Some(&c));
    while let Some(&c) = bytes.get(at) {
        if starts(at, "//") {
            while bytes.get(at).is_some_and(|c| *c != '\n') {
                at += 1;
            }
        } else if starts(at, "r#\"") {
            at += 3;
            while at < bytes.len() && !starts(at, "\"#") {
                at += 1;
            }
            at += 2;
        } else if c == '"' {
            at += 1;
            while bytes.get(at).is_some_and(|c| *c != '"') {
                at += if bytes[at] == '\\' { 2 } else { 1 };
            }
            at += 1;
            out.push(' ');
        } else if c == '\'' && (bytes.get(at + 1) == Some(&'\\') || bytes.get(at + 2) == Some(&'\'')) {
            at += if bytes.get(at + 1) == Some(&'\\') { 3 } else { 2 };
            while bytes.get(at).is_some_and(|c| *c != '\'') {
                at += 1;
            }
            at += 1;
        } else {
            out.push(c);
            at += 1;
        }
    }
    out
}

/// The words of a text: names, `::`, and single characters.
fn words(text: &str) -> Vec<String> {
    let (mut words, mut rest) = (Vec::new(), text);
    while let Some(first) = rest.chars().next() {
        let length = match first {
            c if c.is_alphanumeric() || c == '_' => {
                rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len())
            }
            ':' if rest.starts_with("::") => 2,
            c => c.len_utf8(),
        };
        let (word, more) = rest.split_at(length);
        if !first.is_whitespace() {
            words.push(word.to_owned());
        }
        rest = more;
    }
    words
}

fn is_name(word: &str) -> bool {
    word.chars().all(|c| c.is_alphanumeric() || c == '_')
}

impl Module {
    fn read(text: &str) -> Self {
        let words = words(&plain(main_part(text)));
        let (mut module, mut at, mut used) = (Self::default(), 0, BTreeSet::new());
        let mut imports = Vec::new();
        while at < words.len() {
            if words[at] == "use" && (at == 0 || !is_name(&words[at - 1]) || words[at - 1] == "pub") {
                let public = at > 0 && (words[at - 1] == "pub" || words[at - 1] == ")");
                at = tree(&words, at + 1, &[], public, &mut imports);
            } else if is_name(&words[at]) {
                let start = at;
                while words.get(at + 1).is_some_and(|word| word == "::")
                    && words.get(at + 2).is_some_and(|word| is_name(word))
                {
                    at += 2;
                }
                used.insert(words[start].clone());
                let is_visibility = start > 1 && words[start - 1] == "in" && words[start - 2] == "(";
                if at > start && !is_visibility {
                    module.paths.push(words[start..=at].iter().filter(|word| *word != "::").cloned().collect());
                }
                at += 1;
            } else {
                at += 1;
            }
        }
        for (path, name, public) in imports {
            let is_used = !public || used.contains(&name);
            module.uses.push((path.clone(), is_used));
            module.names.insert(name, path);
        }
        module
    }
}

/// Reads a tree of imports behind `prefix`; returns where it ends.
fn tree(
    words: &[String],
    mut at: usize,
    prefix: &[String],
    public: bool,
    out: &mut Vec<(Name, String, bool)>,
) -> usize {
    let mut path = prefix.to_vec();
    while let Some(word) = words.get(at) {
        match word.as_str() {
            "::" => at += 1,
            "{" => {
                at += 1;
                while words.get(at).is_some_and(|word| word != "}") {
                    at = tree(words, at, &path, public, out);
                    at += usize::from(words.get(at).is_some_and(|word| word == ","));
                }
                return at + 1;
            }
            "*" => return at + 1,
            name if is_name(name) => {
                path.push(name.to_owned());
                at += 1;
                if words.get(at).is_some_and(|word| word == "::") {
                    continue;
                }
                if name == "self" {
                    path.pop();
                }
                let mut bound = path.last().cloned().unwrap_or_default();
                if words.get(at).is_some_and(|word| word == "as") {
                    bound = words.get(at + 1).cloned().unwrap_or_default();
                    at += 2;
                }
                out.push((path, bound, public));
                return at;
            }
            _ => return at + 1,
        }
    }
    at
}

impl Modules {
    fn read(root: &Path) -> Self {
        let (mut modules, mut folders) = (BTreeMap::new(), vec![root.to_owned()]);
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|end| end == "rs") && !path.ends_with("main.rs") {
                    let relative = path.strip_prefix(root).unwrap().with_extension("");
                    let mut name: Name = relative.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
                    if matches!(name.last().map(String::as_str), Some("mod" | "lib")) {
                        name.pop();
                    }
                    modules.insert(name, Module::read(&fs::read_to_string(&path).unwrap()));
                }
            }
        }
        Self(modules)
    }

    /// The file that a path in a module leads to, where it is one of the library.
    fn resolve(&self, from: &[String], path: &[String], depth: usize) -> Option<Name> {
        let (mut at, mut rest) = (from.to_vec(), path);
        match path.first()?.as_str() {
            "crate" => (at, rest) = (Vec::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|part| part == "super") {
                    at.pop();
                    rest = &rest[1..];
                }
            }
            first => {
                at.push(first.to_owned());
                if self.0.contains_key(&at) {
                    rest = &path[1..];
                } else {
                    let import = self.0.get(from)?.names.get(first)?;
                    let is_other = depth < 9 && import.first().is_some_and(|start| start != first);
                    return if is_other { self.resolve(from, &[import, &path[1..]].concat(), depth + 1) } else { None };
                }
            }
        }
        while let Some(part) = rest.first() {
            at.push(part.clone());
            if !self.0.contains_key(&at) {
                at.pop();
                break;
            }
            rest = &rest[1..];
        }
        let item = rest.first().and_then(|item| self.0.get(&at)?.names.get(item));
        let origin = item.filter(|_| depth < 9).and_then(|import| self.resolve(&at, import, depth + 1));
        Some(origin.unwrap_or(at))
    }

    /// Which file depends on which.
    fn dependencies(&self) -> BTreeMap<&Name, BTreeSet<Name>> {
        let of = |(name, module): (&'_ Name, &Module)| -> BTreeSet<Name> {
            let used = module.uses.iter().filter(|(_, is_used)| *is_used).map(|(path, _)| path);
            let found = used.chain(&module.paths).filter_map(|path| self.resolve(name, path, 0));
            found.filter(|found| found != name).collect()
        };
        self.0.iter().map(|(name, module)| (name, of((name, module)))).collect()
    }
}

/// The groups of nodes that reach each other.
fn circles(graph: &BTreeMap<Name, BTreeSet<Name>>) -> Vec<Vec<Name>> {
    let reached = |from: &Name| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(next) = open.pop() {
            for to in graph.get(&next).into_iter().flatten() {
                if seen.insert(to.clone()) {
                    open.push(to.clone());
                }
            }
        }
        seen
    };
    let reach: BTreeMap<&Name, BTreeSet<Name>> = graph.keys().map(|node| (node, reached(node))).collect();
    let mut found: Vec<Vec<Name>> = Vec::new();
    for (node, all) in &reach {
        if all.contains(*node) && !found.iter().any(|circle| circle.contains(node)) {
            found.push(
                all.iter().filter(|other| reach.get(other).is_some_and(|back| back.contains(*node))).cloned().collect(),
            );
        }
    }
    found
}

fn sources() -> Modules {
    Modules::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"))
}

/// Which module depends on which; the library's own file is one without a name.
fn between() -> BTreeMap<Name, BTreeSet<Name>> {
    let modules = sources();
    let mut between: BTreeMap<Name, BTreeSet<Name>> = BTreeMap::new();
    let top = |name: &Name| name.iter().take(1).cloned().collect::<Name>();
    for (from, all) in modules.dependencies() {
        between.entry(top(from)).or_default().extend(all.iter().map(top).filter(|to| *to != top(from)));
    }
    between
}

#[test]
fn no_two_modules_import_each_other() {
    let between = between();
    assert!(between.len() > 15, "the modules were not found");
    assert_eq!(circles(&between), Vec::<Vec<Name>>::new());
}

#[test]
fn a_module_uses_those_that_are_listed_for_it() {
    let found = between().into_iter().filter(|(module, _)| !module.is_empty());
    let found: Vec<(String, String)> = found
        .map(|(module, used)| (module.concat(), used.into_iter().flatten().collect::<Vec<String>>().join(" ")))
        .collect();
    assert_eq!(found, USES.map(|(module, used)| (module.to_owned(), used.to_owned())));
}

#[test]
fn the_page_on_architecture_has_every_module_in_its_table() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/architecture.md")).unwrap();
    let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| `src/")).collect();
    let library = fs::read_to_string(root.join("src/lib.rs")).unwrap();
    let modules =
        library.lines().filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';'));
    let mut count = 0;
    for module in modules {
        let is_in =
            |row: &&str| row.contains(&format!("`src/{module}/`")) || row.contains(&format!("`src/{module}.rs`"));
        assert!(rows.iter().any(is_in), "add {module} to the table of docs/architecture.md");
        count += 1;
    }
    assert!(count > 15, "the modules were not found");
}

#[test]
fn no_two_files_of_a_module_import_each_other() {
    let modules = sources();
    let same = |from: &Name, to: &Name| !from.is_empty() && from.first() == to.first();
    let within = modules.dependencies().into_iter();
    let within = within.map(|(from, all)| (from.clone(), all.into_iter().filter(|to| same(from, to)).collect()));
    let mut wrong = circles(&within.collect());
    let mut unused = RECURSIVE.to_vec();
    wrong.retain(|circle| {
        let is_listed =
            |(name, count, _): &(&str, usize, &str)| circle.len() == *count && circle[0].join("::") == *name;
        let found = unused.iter().position(is_listed);
        found.map(|index| unused.remove(index)).is_none()
    });
    assert_eq!((wrong, unused), (Vec::<Vec<Name>>::new(), Vec::new()));
}

#[test]
fn a_path_leads_to_the_file_that_defines_it() {
    let text = "use super::{one::A, two as b};\npub use three::C;\npub(in crate::x) fn f() { crate::x::y::Z::new(); \"use a::b;\" }\n// use c::d;";
    let module = Module::read(text);
    let path = |text: &str| text.split("::").map(str::to_owned).collect::<Name>();
    assert_eq!(module.uses, [(path("super::one::A"), true), (path("super::two"), true), (path("three::C"), false)]);
    assert_eq!(module.paths, [path("crate::x::y::Z::new")]);
    assert_eq!(module.names.get("b"), Some(&path("super::two")));
}
