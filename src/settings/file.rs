//! `rmem.toml`: its keys, their types, and positions of mistakes in it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;

use super::{computable, history, scene};
use crate::formats::credentials::masked_excerpt;
use crate::formats::{Diagnostic, Source, Span, nearest, plain};
use crate::memory::computables::Definition;
use crate::output::Format;
use crate::pddl::Feature;
use crate::planner::{Configured, Dialect};
use crate::scene::ObjectKind;
use crate::store::{HistoryRule, Namespace, StoreUri};

use super::backend::{Backend, Tables};

/// The settings file as it is written; an unknown key or a wrong type is an error.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct File {
    /// URI of the local store.
    pub memory: Option<Spanned<String>>,
    /// URI of the store of shared databases.
    pub shared: Option<Spanned<String>>,
    /// The databases in the store `shared`.
    pub shared_databases: Option<Spanned<Vec<Spanned<String>>>>,
    /// The default namespace.
    pub collection: Option<Spanned<String>>,
    /// Folders of templates that templates name.
    pub template_path: Option<Spanned<Vec<std::path::PathBuf>>>,
    /// The format of results.
    pub format: Option<Spanned<String>>,
    /// The log of operations.
    pub log: Option<Spanned<String>>,
    /// How long changes are kept: a duration, or one for each database or collection.
    pub keep_history: Option<Spanned<toml::Value>>,
    /// The most bytes of changes that are kept.
    pub history_size: Option<Spanned<String>>,
    /// The most documents that a collection keeps, by its name.
    #[serde(default)]
    most_documents: BTreeMap<Spanned<String>, u64>,
    /// `[planner.NAME]`
    #[serde(default)]
    planner: BTreeMap<Spanned<String>, PlannerTable>,
    /// `[[computable]]`
    #[serde(default, rename = "computable")]
    computables: Vec<computable::Table>,
    /// `[backend.local]`, `[backend.shared]`
    #[serde(default)]
    backend: Tables,
    /// `[[scene.object]]`
    #[serde(default)]
    scene: scene::Table,
    #[serde(skip)]
    text: String,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlannerTable {
    command: Spanned<Vec<String>>,
    #[serde(default)]
    output: DialectName,
    /// PDDL requirements that it cannot handle.
    #[serde(default)]
    lacks: Vec<Spanned<String>>,
}

/// The format of a planner's plans, as it is named in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum DialectName {
    #[default]
    Auto,
    /// As FF prints them.
    Ff,
    /// As Fast Downward writes plan files.
    Downward,
    /// As temporal planners print them.
    Temporal,
}

/// The files of a run that words in braces stand for in a planner's command.
const FILES: [&str; 3] = ["domain", "problem", "plan"];

impl File {
    /// Reads a settings file.
    ///
    /// # Errors
    /// Where TOML, a key or a type is wrong.
    pub fn parse(source: &Source) -> Result<Self, Diagnostic> {
        let shown = Source::new(source.name(), masked_excerpt(source.text()));
        let complain =
            |span: Range<usize>, message: String| Diagnostic::new(&shown, Span::new(span.start, span.end), message);
        let mut file: Self = toml::from_str(source.text()).map_err(|error| {
            let message = error.message().lines().next().unwrap_or_default();
            let wrong = complain(error.span().unwrap_or_default(), masked_excerpt(&plain::kinds(message, "table")));
            let wrong = match unquoted(shown.text(), error.span().unwrap_or_default().start) {
                Some(quoted) => wrong.hint(format!("string values are quoted: {quoted}")),
                None => wrong,
            };
            match [".yaml", ".yml"].iter().any(|end| source.name().ends_with(end)) {
                true => wrong
                    .hint("settings are TOML, not YAML; \"From Fawkes\" in docs/settings.md says where its keys went"),
                false => wrong,
            }
        })?;
        source.text().clone_into(&mut file.text);
        file.check().map_err(|(span, message)| complain(span, message))?;
        Ok(file)
    }

    /// A word in braces that stands for no file of the run, with its place. Braces around anything but a word are the
    /// program's own, and so are those of a shell's variable, `${name}`.
    fn unknown_file(&self, command: &Spanned<Vec<String>>) -> Option<(Range<usize>, String)> {
        let text = self.text.get(command.span())?;
        for word in command.get_ref() {
            for (at, _) in word.match_indices('{') {
                let Some((inner, _)) = word.get(at + 1..)?.split_once('}') else { continue };
                let is_variable = word.get(..at)?.ends_with('$');
                let is_word = inner.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
                    && inner.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
                if is_variable || !is_word || FILES.contains(&inner) {
                    continue;
                }
                let marked = format!("{{{inner}}}");
                let start = command.span().start + text.find(&marked).unwrap_or_default();
                let meant = match nearest(inner, FILES) {
                    Some(meant) => format!("did you mean `{{{meant}}}`?"),
                    None => {
                        "expected `{domain}`, `{problem}` or `{plan}`, or blanks inside braces of the program's own"
                            .to_owned()
                    }
                };
                let message = format!("`{marked}` stands for no file of the run; {meant}");
                return Some((start..start + marked.len(), message));
            }
        }
        None
    }

    /// Checks what types cannot express; an error is the first mistake with its place.
    fn check(&self) -> Result<(), (Range<usize>, String)> {
        for uri in [&self.memory, &self.shared].into_iter().flatten() {
            StoreUri::parse(uri.get_ref()).map_err(|error| (uri.span(), error.to_string()))?;
        }
        if let Some(name) = &self.collection {
            name.get_ref().parse::<Namespace>().map_err(|error| (name.span(), error.to_string()))?;
        }
        if let Some(name) = &self.format {
            name.get_ref().parse::<Format>().map_err(|error| (name.span(), error.to_string()))?;
        }
        for database in self.shared_databases.iter().flat_map(|databases| databases.get_ref()) {
            let name = database.get_ref();
            Namespace::parse(&format!("{name}.x"))
                .ok()
                .filter(|namespace| namespace.database == *name)
                .ok_or_else(|| (database.span(), format!("`{name}` is not a database name")))?;
            if name == "config" {
                let message = "`config` has what is kept of a file for `rmem serve`, and cannot be shared";
                return Err((database.span(), message.to_owned()));
            }
        }
        for name in self.most_documents.keys() {
            name.get_ref().parse::<Namespace>().map_err(|error| (name.span(), error.to_string()))?;
        }
        for (name, table) in &self.planner {
            if crate::planner::Registry::is_own(name.get_ref()) {
                return Err((
                    name.span(),
                    format!("`{}` is a built-in planner of rmem; choose another name", name.get_ref()),
                ));
            }
            if table.command.get_ref().is_empty() {
                return Err((
                    table.command.span(),
                    "expected a program and its arguments, found an empty list".to_owned(),
                ));
            }
            if let Some((span, message)) = self.unknown_file(&table.command) {
                return Err((span, message));
            }
            if let Some(unknown) = table.lacks.iter().find(|lack| Feature::named(lack.get_ref()).next().is_none()) {
                let mut known: Vec<&str> = Feature::ALL.iter().map(|feature| feature.requirement()).collect();
                // Two features may have one requirement.
                known.dedup();
                return Err((
                    unknown.span(),
                    format!("`{}` is not a feature of PDDL; expected one of {}", unknown.get_ref(), known.join(", ")),
                ));
            }
        }
        computable::definitions(&self.computables, Path::new(""), &self.text, Path::new(""))?;
        self.scene.kinds(&self.text)?;
        history::rules(self.keep_history.as_ref(), self.history_size.as_ref())?;
        self.backend.check()
    }

    /// The line of a key's value.
    #[must_use]
    pub fn line(&self, span: Range<usize>) -> usize {
        self.text.get(..span.start).unwrap_or_default().matches('\n').count() + 1
    }

    /// The computables; commands run in `folder`. The file itself is at `path`.
    #[must_use]
    pub fn computables(&self, folder: &Path, path: &Path) -> Vec<Definition> {
        // `parse` has checked them.
        computable::definitions(&self.computables, folder, &self.text, path).unwrap_or_default()
    }

    /// The most documents that collections keep.
    #[must_use]
    pub fn most_documents(&self) -> BTreeMap<Namespace, u64> {
        // The names were checked when the file was read.
        let known = self.most_documents.iter();
        known.filter_map(|(name, most)| Some((name.get_ref().parse().ok()?, *most))).collect()
    }

    /// Whose history is kept.
    #[must_use]
    pub fn histories(&self) -> Vec<HistoryRule> {
        // They were checked when the file was read.
        history::rules(self.keep_history.as_ref(), self.history_size.as_ref()).unwrap_or_default()
    }

    /// The most bytes of changes that are kept.
    #[must_use]
    pub fn history_size(&self) -> u64 {
        // It was checked when the file was read.
        history::size(self.history_size.as_ref()).unwrap_or(history::DEFAULT_SIZE)
    }

    /// The kinds of objects in scenes.
    #[must_use]
    pub fn object_kinds(&self) -> Vec<ObjectKind> {
        // They were checked when the file was read.
        self.scene.kinds(&self.text).unwrap_or_default()
    }

    /// The configured planners; relative paths in their commands are relative to `folder`.
    #[must_use]
    pub fn planners(&self, folder: &Path) -> Vec<Configured> {
        let planner = |(name, table): (&Spanned<String>, &PlannerTable)| Configured {
            name: name.get_ref().clone(),
            command: table.command.get_ref().clone(),
            output: match table.output {
                DialectName::Auto => Dialect::Auto,
                DialectName::Ff => Dialect::Ff,
                DialectName::Downward => Dialect::Downward,
                DialectName::Temporal => Dialect::Temporal,
            },
            lacks: table.lacks.iter().flat_map(|lack| Feature::named(lack.get_ref())).collect(),
            folder: folder.to_owned(),
        };
        self.planner.iter().map(planner).collect()
    }

    /// The mongod processes of this robot; relative paths are relative to `folder`.
    #[must_use]
    pub fn backends(&self, folder: &Path) -> Vec<Backend> {
        self.backend.resolve(folder)
    }
}

/// The line around `offset` with its value in quotes, where that is a text without them: `memory = file:robot.rmem`.
fn unquoted(text: &str, offset: usize) -> Option<String> {
    let start = text.get(..offset)?.rfind('\n').map_or(0, |newline| newline + 1);
    let line = text.get(start..)?.lines().next()?;
    let (key, value) = line.split_once('=')?;
    let value = value.split(" #").next().unwrap_or_default().trim();
    let is_word = ["true", "false", "yes", "no", "on", "off"].iter().any(|word| value.eq_ignore_ascii_case(word));
    let is_number = value.chars().all(|c| c.is_ascii_digit() || "+-._".contains(c));
    let is_plain = !is_word && !is_number && !value.contains(['=', '"', '\'', '[', ']', '{', '}', '\\', ',']);
    let is_value = toml::from_str::<toml::Table>(&format!("x = {value}")).is_ok();
    (is_plain && !is_value).then(|| format!("{} = \"{value}\"", key.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(text: &str) -> String {
        File::parse(&Source::new("rmem.toml", text)).unwrap_err().to_string()
    }

    #[test]
    fn a_text_without_quotes_is_shown_with_them() {
        for (text, quoted) in [
            ("memory = file:robot.rmem # mine", "memory = \"file:robot.rmem\""),
            ("format = \"json\"\nmemory = true.rmem", "memory = \"true.rmem\""),
            ("keep_history = 24h", "keep_history = \"24h\""),
            ("collection = robmem.orders", "collection = \"robmem.orders\""),
        ] {
            assert!(complaint(text).contains(&format!("string values are quoted: {quoted}")), "{}", complaint(text));
        }
        for text in ["log_append = True", "clear_on_stop = yes", "port = 027017", "memory == x"] {
            assert!(!complaint(text).contains("are quoted"), "{}", complaint(text));
        }
        for text in ["memory = \"a\" b", "memroy = 1", "shared_databases = [a]", "memory"] {
            assert!(!complaint(text).contains("are quoted"), "{}", complaint(text));
        }
        let secret = complaint("memory = mongodb://me:secret@host/");
        assert!(secret.contains("are quoted") && !secret.contains("secret"), "{secret}");
    }

    #[test]
    fn an_unknown_key_is_an_error_at_its_place() {
        let text = complaint("memory = \"mem:\"\nmemroy = 1\n");
        assert!(text.starts_with("rmem.toml:2:1: unknown field `memroy`"), "{text}");
    }

    #[test]
    fn a_wrong_type_is_an_error_at_its_place() {
        let text = complaint("shared_databases = \"robmem\"\n");
        assert!(text.starts_with("rmem.toml:1:20: expected an array, found \"robmem\""), "{text}");
        let text = complaint("[planner.x]\ncommand = [\"x\"]\noutput = \"lpg\"\n");
        assert!(text.starts_with("rmem.toml:3:10: unknown value `lpg`"), "{text}");
        let text = complaint("[[computable]]\nname='a'\ncollection='a.b'\nspec='{}'\ncache = '5 apples'\n");
        assert!(text.contains("is not a duration"), "{text}");
    }

    #[test]
    fn credentials_are_masked_in_every_excerpt() {
        for text in [
            "memory = \"mongodb://u:s3cret@h\"  x",
            "memroy = \"mongodb://u:s3cret@h\"",
            "memory = [\"mongodb://u:s3@cret@h\"]",
            "memory = 'mongodb://u:s3cret@h\n",
        ] {
            let complaint = complaint(text);
            assert!(!complaint.contains("cret") && complaint.starts_with("rmem.toml:1:"), "{complaint}");
        }
    }

    #[test]
    fn what_toml_cannot_know_is_an_error_at_its_place() {
        assert!(complaint("collection = \"nodot\"\n").starts_with("rmem.toml:1:14: `nodot` is not a namespace"));
        assert!(complaint("format = \"xml\"\n").starts_with("rmem.toml:1:10: unknown format `xml`"));
        assert!(complaint("shared_databases = [\"a\", \"b.c\"]\n").starts_with("rmem.toml:1:26: `b.c`"));
        let text = complaint("[planner.builtin]\ncommand = [\"x\"]\noutput = \"ff\"\n");
        assert!(text.starts_with("rmem.toml:1:10: `builtin` is a built-in planner"), "{text}");
        let text = complaint("[planner.x]\ncommand = [\"x\", \"{domian}\"]\noutput = \"ff\"\n");
        assert!(text.starts_with("rmem.toml:2:18: `{domian}` stands for no file of the run"), "{text}");
        assert!(text.contains("did you mean `{domain}`?"), "{text}");
        let command = |words: &str| format!("[planner.x]\noutput = \"ff\"\ncommand = [\"x\", \"{words}\"]\n");
        let text = complaint(&command("{plan}-{foo}"));
        let expected =
            "rmem.toml:3:25: `{foo}` stands for no file of the run; expected `{domain}`, `{problem}` or `{plan}`";
        assert!(text.starts_with(expected), "{text}");
        assert!(complaint(&command("{plann}")).contains("did you mean `{plan}`?"));
        for own in ["{}", "{ print }", "${HOME}", "{1..3}", "{a,b}", "{", "}{", "{domain} {problem} {plan}"] {
            assert!(File::parse(&Source::new("rmem.toml", command(own))).is_ok(), "{own}");
        }
        let text = complaint("[planner.x]\ncommand = []\noutput = \"ff\"\n");
        assert!(text.starts_with("rmem.toml:2:11: expected a program"), "{text}");
        let computable =
            |rest: &str| complaint(&format!("[[computable]]\nname='a'\ncollection='a.b'\nspec='{{}}'\n{rest}"));
        let text = complaint("[[computable]]\nname='a'\ncollection='a.b'\nspec='{'\n");
        assert!(text.starts_with("rmem.toml:4:8: expected a query"), "{text}");
        for (rest, words) in [
            ("", "rmem.toml:2:6: expected one body"),
            ("pipeline='[]'\ncommand=['x']", "rmem.toml:2:6: expected one body"),
            ("pipeline='['", "rmem.toml:5:12: expected a pipeline"),
            ("command=[]", "rmem.toml:5:9: expected a program"),
            ("builtin='tf'", "rmem.toml:5:9: unknown builtin `tf`; expected one of transform, nearest"),
            ("builtin='nearest'\nframes='a.b'", "rmem.toml:6:8: `frames` has no meaning"),
            ("builtin='transform'\nframes='a'", "rmem.toml:6:8: `a` is not a namespace"),
            (
                "builtin='nearest'\n[[computable]]\nname='a'\ncollection='a.b'\nspec='{}'\nbuiltin='nearest'",
                "rmem.toml:7:6: another computable has the name `a`",
            ),
        ] {
            let text = computable(rest);
            assert!(text.starts_with(words), "{text}");
        }
    }

    #[test]
    fn a_kind_of_objects_that_makes_no_sense_is_an_error_at_its_place() {
        for (rest, wanted) in [
            ("collection='b'", "3:12: `b` is not a namespace"),
            ("collection='a.b'\nquery='{'", "4:9: expected a query"),
            ("collection='a.b'\nquery=\"{x: {$is: 1}}\"", "4:13: expected a query: unknown operator"),
            (
                "collection='a.b'\ngeometry=\"{type: 'box', size: [1, 2, 0]}\"",
                "4:10: its `geometry` is a box that has the size",
            ),
            ("collection='a.b'\nname_key='a.b'", "4:10: `a.b` is not a key"),
            ("collection='a.b'\nnamekey='a'", "4:1: unknown field `namekey`"),
        ] {
            let text = complaint(&format!("[[scene.object]]\nname='block'\n{rest}\n"));
            assert!(text.starts_with(&format!("rmem.toml:{wanted}")), "{text}");
        }
    }

    #[test]
    fn a_history_that_cannot_be_kept_is_an_error_at_its_place() {
        for (text, wanted) in [
            ("[most_documents]\nrobmem = 3", "2:1: `robmem` is not a namespace"),
            ("[most_documents]\n'a.b' = -3", "2:9: "),
            ("keep_history = 'for ever'", "1:16: `for ever` is not a duration"),
            ("keep_history = 24", "1:16: expected a duration, like \"24h\", or a table"),
            ("[keep_history]\nrobmem = '24'", "1:1: `robmem`: `24` is not a duration"),
            ("keep_history = {'a b.c' = '1h'}", "1:16: `a b.c` is neither a database nor a collection"),
            ("history_size = 'much'", "1:16: `much` is not a size"),
        ] {
            let text = complaint(text);
            assert!(text.starts_with(&format!("rmem.toml:{wanted}")), "{text}");
        }
    }

    #[test]
    fn a_backend_that_cannot_be_started_is_an_error_at_its_place() {
        for (table, wanted) in [
            ("port = 0", "3:8: expected a port"),
            ("prot = 1", "3:1: unknown field `prot`"),
            ("port = 1\nmembers = ['robot1']", "4:12: expected a member as HOST:PORT"),
            ("port = 1\nmembers = ['a:1', 'a:1']", "4:19: `a:1` is given twice"),
            ("port = 1\nmembers = ['a:2', 'b:2']", "4:11: no member has the port 1"),
            ("port = 1\noplog_size = '5 apples'", "4:14: `5 apples` is not a size"),
            ("port = 1\ncache_size = '1M'", "4:14: expected at least 256M"),
            (
                "port = 1\narguments = ['--quiet', '--port=3']",
                "4:25: `--port` cannot be given here; use the key `port`",
            ),
            ("port = 1\narguments = ['--fork']", "4:14: `--fork` cannot be given here; rmem gives it"),
            ("port = 1\narguments = ['--config', 'x']", "4:14: `--config` cannot be given here; write the arguments"),
            ("port = 1\nstop_timeout = 'soon'", "4:16: `soon` is not a duration"),
            ("port = 1\nlog = ''", "4:7: expected a text, found an empty one"),
            ("port = 1\nclear_on_stop = 'yes'", "4:17: "),
            ("port = 1\nreplica_set = 'a/b'", "4:15: expected the name of a replica set"),
            ("port = 1\n[backend.shared]\npath = 'y'\nport = 1", "6:8: both backends have this port"),
        ] {
            let text = complaint(&format!("[backend.local]\npath = 'x'\n{table}\n"));
            assert!(text.starts_with(&format!("rmem.toml:{wanted}")), "{text}");
        }
        let text = complaint("[backend.other]\nport = 1\npath = 'x'\n");
        assert!(text.starts_with("rmem.toml:1:10: unknown field `other`"), "{text}");
    }
}
