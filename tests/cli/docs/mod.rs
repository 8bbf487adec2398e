//! Every block of every page is executed: commands run and print what the page says they print, settings are
//! accepted, templates render to what stands below them; and what pages name is there.
//!
//! | fence | what happens |
//! |---|---|
//! | `console` | its commands run (`console.rs`); `needs=python3,mongod,clips-engine` says what has to be there |
//! | any language and `file=NAME` | the file is written, or added to with `append=yes`; the paragraph before names it |
//! | `jinja`, `marker` | the template is rendered, `with="OPTIONS"`, and compared with the block that follows: `pddl`, or `error` with stderr |
//! | `toml` | `rmem config` accepts it |
//! | `json` | it is JSON, or JSON lines |
//! | `text` | a figure |

mod console;
mod markdown;
mod names;
mod operators;
mod settings;

use crate::lab::{Finished, Lab, root};
use markdown::{Block, blocks};

/// One test for each page.
macro_rules! pages {
    ($($test:ident: $path:literal in $lab:expr,)+) => {
        /// All pages, by their paths.
        const PAGES: &[&str] = &[$($path),+];

        $(#[test]
        fn $test() {
            Page::new($path, $lab).run();
        })+
    };
}

pages! {
    the_readme_is_true: "README.md" in Lab::new(),
    the_guide_is_true: "docs/guide.md" in Lab::empty(),
    the_page_on_templates_is_true: "docs/templates.md" in Lab::new(),
    the_page_on_computables_is_true: "docs/computables.md" in Lab::new(),
    the_page_on_sharing_is_true: "docs/sharing.md" in Lab::new(),
    the_page_on_settings_is_true: "docs/settings.md" in Lab::new(),
    the_page_on_mongodb_is_true: "docs/mongodb.md" in Lab::new(),
    the_page_on_clips_is_true: "docs/clips.md" in Lab::new(),
    the_page_on_planners_is_true: "docs/planners.md" in Lab::new(),
    the_page_on_exit_codes_is_true: "docs/exit-codes.md" in Lab::new(),
    the_page_on_architecture_is_true: "docs/architecture.md" in Lab::new(),
    the_page_on_testing_is_true: "docs/testing.md" in Lab::new(),
    the_page_on_benchmarks_is_true: "docs/benchmarks.md" in Lab::new(),
    the_page_for_contributors_is_true: "CONTRIBUTING.md" in Lab::new(),
    the_page_on_the_examples_is_true: "examples/README.md" in Lab::new(),
    the_page_on_the_domains_is_true: "domains/README.md" in Lab::new(),
    the_page_on_serving_is_true: "docs/serve.md" in Lab::new(),
    the_page_on_python_is_true: "docs/python.md" in Lab::new(),
    the_page_on_scenes_is_true: "docs/scenes.md" in Lab::new(),
    the_page_on_views_is_true: "docs/views.md" in Lab::new(),
    the_page_on_history_is_true: "docs/history.md" in Lab::new(),
}

#[test]
fn every_page_has_its_test() {
    let folder = std::fs::read_dir(root().join("docs")).unwrap();
    let files = folder.map(|entry| format!("docs/{}", entry.unwrap().file_name().display()));
    for page in files.filter(|name| name.ends_with(".md")) {
        assert!(PAGES.contains(&page.as_str()), "add {page} to `pages!`");
    }
}

#[test]
fn the_readme_has_at_most_600_words() {
    let words = text("README.md").split_whitespace().count();
    assert!(words <= 600, "{words} words");
}

/// The text of a page.
fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// A page whose blocks are executed, in a folder of its own.
struct Page {
    path: &'static str,
    text: String,
    lab: Lab,
}

impl Page {
    fn new(path: &'static str, lab: Lab) -> Self {
        Self { path, text: text(path), lab }
    }

    fn run(&self) {
        let blocks = blocks(&self.text);
        let mut blocks = blocks.iter();
        while let Some(block) = blocks.next() {
            if let Some(name) = block.attribute("file") {
                self.write(block, name);
                continue;
            }
            match block.language.as_str() {
                "console" => self.console(block),
                "jinja" | "marker" => self.render(block, blocks.next()),
                "toml" => self.settings(block),
                "json" => self.json(block),
                "text" => {}
                other => panic!("{}: a block of `{other}` cannot be checked; see tests/cli/docs", self.place(block)),
            }
        }
    }

    fn place(&self, block: &Block) -> String {
        format!("{}:{}", self.path, block.line)
    }

    fn write(&self, block: &Block, name: &str) {
        let place = self.place(block);
        assert!(block.before.contains(&format!("`{name}`")), "{place}: the paragraph before does not name `{name}`");
        let redirection = if block.attribute("append").is_some() { ">>" } else { ">" };
        self.save(redirection, name, &block.text);
    }

    /// Writes a file where the terminal is.
    fn save(&self, redirection: &str, name: &str, text: &str) {
        let run = self.shell(&format!("cat {redirection} '{name}' <<'END OF FILE'\n{text}END OF FILE\n"));
        assert_eq!(run.code, 0, "{}: {name}:\n{run}", self.path);
    }

    /// Runs a command in the terminal of the commands before it: with what they exported, in their folder.
    fn shell(&self, command: &str) -> Finished {
        let file = "\"$HOME.session\"";
        let before = format!("[ ! -e {file} ] || . {file}");
        let after = format!("code=$?; {{ export -p; echo cd \"'$PWD'\"; }} >{file}; exit $code");
        self.lab.shell(&format!("{before}\n{command}\n{after}"))
    }

    fn console(&self, block: &Block) {
        let needs = block.attribute("needs").unwrap_or_default();
        if !needs.split(',').filter(|need| !need.is_empty()).all(is_there) {
            return;
        }
        for step in console::steps(&block.text) {
            let command = match step.command.strip_prefix("cargo run ").and_then(|rest| rest.split_once("-- ")) {
                Some((_, arguments)) => format!("rmem {arguments}"),
                None => step.command.clone(),
            };
            if command.starts_with("cargo ") {
                names::assert_cargo_command(&command);
                continue;
            }
            let run = self.shell(&command);
            let place = self.place(block);
            assert_eq!(run.code, 0, "{place}: $ {command}{run}");
            let expected = step.expected.join("\n");
            assert!(
                console::agrees(&run.stdout, &step.expected),
                "{place}: $ {command}{run}\n--- expected\n{expected}"
            );
        }
    }

    /// Renders a template as the text around it says, and compares.
    fn render(&self, block: &Block, result: Option<&Block>) {
        let place = self.place(block);
        let result = result.unwrap_or_else(|| panic!("{place}: what does it render to?"));
        let options = block.attribute("with").unwrap_or_default();
        assert!(block.before.contains(options), "{place}: the paragraph before does not say `{options}`");
        let name = if block.language == "jinja" { "example.j2" } else { "example.tmpl" };
        self.save(">", name, &block.text);
        let run = self.shell(&format!("rmem gen-problem -q --template {name} {options}"));
        let expected: Vec<&str> = result.text.lines().collect();
        let shown = match result.language.as_str() {
            "pddl" if run.code == 0 => &run.stdout,
            "error" if run.code != 0 => &run.stderr,
            other => panic!("{place}: expected `{other}`, found\n{run}"),
        };
        assert!(console::agrees(shown, &expected), "{place}:\n{run}\n--- expected\n{}", result.text);
    }

    fn settings(&self, block: &Block) {
        self.save(">", "checked.toml", &block.text);
        let run = self.shell("rmem config --config checked.toml");
        assert_eq!(run.code, 0, "{}:\n{run}", self.place(block));
    }

    fn json(&self, block: &Block) {
        let is_json = |text: &str| serde_json::from_str::<serde_json::Value>(text).is_ok();
        assert!(is_json(&block.text) || block.text.lines().all(is_json), "{}: no JSON", self.place(block));
    }
}

/// Whether what a block needs is there.
fn is_there(need: &str) -> bool {
    match need {
        "clips-engine" => cfg!(feature = "clips-engine"),
        program => ["/usr/bin", "/bin"].iter().any(|folder| std::path::Path::new(folder).join(program).is_file()),
    }
}
