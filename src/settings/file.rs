//! `rmem.toml`: its keys, their types, and positions for what is wrong in it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;

use super::quantity;
use crate::formats::{Diagnostic, Source, Span};
use crate::planner::{Configured, Dialect};

/// The settings file as it is written; an unknown key or a wrong type is an error.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct File {
    /// URI of the local store.
    pub memory: Option<Spanned<String>>,
    /// URI of the store of shared databases.
    pub shared: Option<Spanned<String>>,
    /// Which databases go to `shared`.
    pub shared_databases: Option<Spanned<Vec<String>>>,
    /// The namespace where none is given.
    pub collection: Option<Spanned<String>>,
    /// How documents are printed.
    pub format: Option<Spanned<String>>,
    /// The log of operations.
    pub log: Option<Spanned<String>>,
    /// `[planner.NAME]`
    #[serde(default)]
    planner: BTreeMap<String, PlannerTable>,
    /// `[[computable]]`
    #[serde(default, rename = "computable")]
    pub computables: Vec<Computable>,
    /// `[backend.local]`, `[backend.shared]`
    #[serde(default)]
    pub backend: BTreeMap<String, Backend>,
    #[serde(skip)]
    text: String,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlannerTable {
    command: Vec<String>,
    output: DialectName,
}

/// How a planner spells its plans, in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum DialectName {
    /// As FF prints them.
    Ff,
    /// As Fast Downward writes plan files.
    Downward,
    /// As temporal planners print them.
    Temporal,
}

/// A computable by configuration: `[[computable]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Computable {
    /// What messages call it.
    pub name: String,
    /// The namespace it computes for.
    pub collection: String,
    /// The query that asked queries are matched against.
    pub spec: String,
    /// Higher runs first.
    #[serde(default)]
    pub priority: i64,
    /// How long its documents stay good.
    #[serde(default, deserialize_with = "optional_duration")]
    pub cache: Option<std::time::Duration>,
    /// How long a command may take.
    #[serde(default, deserialize_with = "optional_duration")]
    pub timeout: Option<std::time::Duration>,
    /// Body: an aggregation over the memory.
    pub pipeline: Option<String>,
    /// Body: a program.
    pub command: Option<Vec<String>>,
    /// Body: one of rmem's own.
    pub builtin: Option<String>,
}

/// A mongod process of this robot: `[backend.local]`, `[backend.shared]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backend {
    /// The TCP port on loopback.
    pub port: u16,
    /// The folder of its data.
    pub path: String,
    /// The replica set's name.
    pub replica_set: Option<String>,
    /// `host:port` of every member.
    #[serde(default)]
    pub members: Vec<String>,
    /// Size of the operations log in megabytes.
    pub oplog_size: Option<u32>,
}

fn optional_duration<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<std::time::Duration>, D::Error> {
    let text = String::deserialize(deserializer)?;
    quantity::duration(&text).map(Some).map_err(serde::de::Error::custom)
}

impl File {
    /// Reads a settings file.
    ///
    /// # Errors
    /// Where TOML, a key or a type is wrong.
    pub fn parse(source: &Source) -> Result<Self, Diagnostic> {
        let mut file: Self = toml::from_str(source.text()).map_err(|error| {
            let span = error.span().unwrap_or_default();
            let message = error.message().lines().next().unwrap_or_default().to_owned();
            Diagnostic::new(source, Span::new(span.start, span.end), message)
        })?;
        source.text().clone_into(&mut file.text);
        Ok(file)
    }

    /// The line of a key's value.
    #[must_use]
    pub fn line(&self, span: Range<usize>) -> usize {
        self.text.get(..span.start).unwrap_or_default().matches('\n').count() + 1
    }

    /// The configured planners; relative paths in their commands are relative to `folder`.
    #[must_use]
    pub fn planners(&self, folder: &Path) -> Vec<Configured> {
        let planner = |(name, table): (&String, &PlannerTable)| Configured {
            name: name.clone(),
            command: table.command.clone(),
            output: match table.output {
                DialectName::Ff => Dialect::Ff,
                DialectName::Downward => Dialect::Downward,
                DialectName::Temporal => Dialect::Temporal,
            },
            folder: folder.to_owned(),
        };
        self.planner.iter().map(planner).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(text: &str) -> String {
        File::parse(&Source::new("rmem.toml", text)).unwrap_err().to_string()
    }

    #[test]
    fn an_unknown_key_is_an_error_at_its_place() {
        let text = complaint("memory = \"mem:\"\nmemroy = 1\n");
        assert!(text.starts_with("rmem.toml:2:1: unknown field `memroy`"), "{text}");
    }

    #[test]
    fn a_wrong_type_is_an_error_at_its_place() {
        let text = complaint("shared_databases = \"robmem\"\n");
        assert!(text.starts_with("rmem.toml:1:20: invalid type"), "{text}");
        let text = complaint("[planner.x]\ncommand = [\"x\"]\noutput = \"lpg\"\n");
        assert!(text.starts_with("rmem.toml:3:10: unknown variant `lpg`"), "{text}");
        let text = complaint("[[computable]]\nname='a'\ncollection='a.b'\nspec='{}'\ncache = '5 apples'\n");
        assert!(text.contains("is not a duration"), "{text}");
    }
}
