//! `[[computable]]` in `rmem.toml`.

use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use bson::Document;
use serde::Deserialize;
use toml::Spanned;

use crate::cli::quantity;
use crate::formats::{Source, shell};
use crate::memory::computables::{BUILTINS, Definition, Kind};
use crate::query::Filter;
use crate::store::Namespace;

/// How long a command may take where nothing is said.
const TIMEOUT: Duration = Duration::from_secs(10);

/// What is wrong, and where.
type Complaint = (Range<usize>, String);

/// A computable as it is written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Table {
    name: Spanned<String>,
    collection: Spanned<String>,
    spec: Spanned<String>,
    #[serde(default)]
    priority: i64,
    #[serde(default, deserialize_with = "optional_duration")]
    cache: Option<Duration>,
    #[serde(default, deserialize_with = "optional_duration")]
    timeout: Option<Duration>,
    pipeline: Option<Spanned<String>>,
    from: Option<Spanned<String>>,
    command: Option<Spanned<Vec<String>>>,
    builtin: Option<Spanned<String>>,
    frames: Option<Spanned<String>>,
    position: Option<Spanned<String>>,
}

fn optional_duration<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<Duration>, D::Error> {
    let text = String::deserialize(deserializer)?;
    quantity::duration(&text).map(Some).map_err(serde::de::Error::custom)
}

/// What the tables declare; commands run in `folder`.
pub(super) fn definitions(tables: &[Table], folder: &Path) -> Result<Vec<Definition>, Complaint> {
    let mut definitions: Vec<Definition> = Vec::with_capacity(tables.len());
    for table in tables {
        let definition = table.definition(folder)?;
        if definitions.iter().any(|other| other.name == definition.name) {
            let name = &definition.name;
            return Err((table.name.span(), format!("there are two computables `{name}`; name one otherwise")));
        }
        definitions.push(definition);
    }
    Ok(definitions)
}

impl Table {
    fn definition(&self, folder: &Path) -> Result<Definition, Complaint> {
        let namespace = namespace(&self.collection)?;
        Ok(Definition {
            name: self.name.get_ref().clone(),
            spec: self.spec()?,
            priority: self.priority,
            cache: self.cache,
            body: self.body(&namespace, folder)?,
            namespace,
        })
    }

    fn spec(&self) -> Result<Document, Complaint> {
        let wrong = |words: &str| (self.spec.span(), format!("this is no query: {words}"));
        let spec = shell::parse_document(&Source::new("spec", self.spec.get_ref().as_str()))
            .map_err(|error| wrong(error.message()))?;
        Filter::parse(&spec).map_err(|error| wrong(&error.message))?;
        Ok(spec)
    }

    fn body(&self, namespace: &Namespace, folder: &Path) -> Result<Kind, Complaint> {
        match (&self.pipeline, &self.command, &self.builtin) {
            (Some(pipeline), None, None) => {
                self.refuse("pipeline", &["timeout", "frames", "position"])?;
                let stages = shell::parse_pipeline(&Source::new("pipeline", pipeline.get_ref().as_str()))
                    .map_err(|error| (pipeline.span(), format!("this is no pipeline: {}", error.message())))?;
                let from = self.from.as_ref().map(self::namespace).transpose()?;
                Ok(Kind::Pipeline { from: from.unwrap_or_else(|| namespace.clone()), stages })
            }
            (None, Some(command), None) => {
                self.refuse("command", &["from", "frames", "position"])?;
                let words = command.get_ref().clone();
                if words.first().is_none_or(String::is_empty) {
                    return Err((command.span(), "expected a program and its arguments, found none".to_owned()));
                }
                Ok(Kind::Command { words, folder: folder.to_owned(), timeout: self.timeout.unwrap_or(TIMEOUT) })
            }
            (None, None, Some(builtin)) => self.builtin(builtin, namespace),
            _ => Err((
                self.name.span(),
                "a computable has one body; expected `pipeline`, `command` or `builtin`".to_owned(),
            )),
        }
    }

    fn builtin(&self, name: &Spanned<String>, namespace: &Namespace) -> Result<Kind, Complaint> {
        match name.get_ref().as_str() {
            "transform" => {
                self.refuse("transform", &["from", "timeout", "position"])?;
                let frames = self.frames.as_ref().map(self::namespace).transpose()?;
                let usual = || Namespace { database: namespace.database.clone(), collection: "frames".to_owned() };
                Ok(Kind::Transform { frames: frames.unwrap_or_else(usual) })
            }
            "nearest" => {
                self.refuse("nearest", &["from", "timeout", "frames"])?;
                let position = self.position.as_ref().map_or("translation", |path| path.get_ref().as_str());
                Ok(Kind::Nearest { position: position.to_owned() })
            }
            other => {
                Err((name.span(), format!("there is no builtin `{other}`; expected one of {}", BUILTINS.join(", "))))
            }
        }
    }

    /// Refuses keys that mean nothing for a kind of body.
    fn refuse(&self, kind: &str, keys: &[&str]) -> Result<(), Complaint> {
        for key in keys {
            let span = match *key {
                "from" => self.from.as_ref().map(Spanned::span),
                "frames" => self.frames.as_ref().map(Spanned::span),
                "position" => self.position.as_ref().map(Spanned::span),
                _ => self.timeout.map(|_| self.name.span()),
            };
            if let Some(span) = span {
                return Err((span, format!("`{key}` means nothing for the body `{kind}`")));
            }
        }
        Ok(())
    }
}

fn namespace(name: &Spanned<String>) -> Result<Namespace, Complaint> {
    Namespace::parse(name.get_ref()).map_err(|error| (name.span(), error.to_string()))
}
