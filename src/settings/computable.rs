//! `[[computable]]` in `rmem.toml`.

use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use bson::Document;
use serde::Deserialize;
use toml::{Spanned, Value};

use super::quoted::{Mistake, Quoted};
use crate::formats::quantity;
use crate::formats::{Diagnostic, Source, Span, plain, shell};
use crate::memory::computables::{
    BUILTINS, BodyKind, Definition, NO_PROGRAMS, Options, Origin, check_adds, check_pipeline,
};
use crate::query::Filter;
use crate::store::{Namespace, NamespaceError};

/// The default time limit of a command.
const TIMEOUT: Duration = Duration::from_secs(10);

/// A computable in the file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Table {
    name: Spanned<String>,
    collection: Spanned<Value>,
    spec: Spanned<String>,
    #[serde(default)]
    priority: i64,
    cache: Option<Spanned<String>>,
    adds: Option<Spanned<Value>>,
    timeout: Option<Spanned<String>>,
    pipeline: Option<Spanned<String>>,
    from: Option<Spanned<String>>,
    command: Option<Spanned<Vec<String>>>,
    builtin: Option<Spanned<String>>,
    frames: Option<Spanned<String>>,
    position: Option<Spanned<String>>,
}

/// Returns the definitions in the tables; commands run in `folder`. A mistake in a query or pipeline
/// is placed inside the string of the `file` that holds it, which is at `path`.
pub(super) fn definitions(
    tables: &[Table],
    folder: &Path,
    file: &str,
    path: &Path,
) -> Result<Vec<Definition>, Mistake> {
    let mut definitions: Vec<Definition> = Vec::with_capacity(tables.len());
    for table in tables {
        let name = table.name.get_ref();
        if definitions.iter().any(|other| other.name == *name) {
            return Err((
                table.name.span(),
                format!("another computable has the name `{name}`; expected different names"),
            ));
        }
        for namespace in table.namespaces()? {
            let line = file.get(..table.name.span().start).unwrap_or_default().matches('\n').count() + 1;
            let origin = Origin::Settings(format!("{}:{line}", path.display()));
            definitions.push(table.definition(namespace, folder, file, origin)?);
        }
    }
    Ok(definitions)
}

/// A file of computables alone.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tables {
    #[serde(default, rename = "computable")]
    computables: Vec<Table>,
}

/// Reads a file of `[[computable]]` tables that are to be kept in a memory: the definitions of each, one for each of its
/// collections.
///
/// # Errors
/// Where TOML, a key or a type is wrong, or a computable is a program.
pub fn read_kept(source: &Source) -> Result<Vec<Vec<Definition>>, Diagnostic> {
    let complain =
        |span: Range<usize>, message: String| Diagnostic::new(source, Span::new(span.start, span.end), message);
    let tables: Tables = toml::from_str(source.text()).map_err(|error| {
        let message = error.message().lines().next().unwrap_or_default();
        complain(error.span().unwrap_or_default(), plain::kinds(message, "table"))
    })?;
    for table in &tables.computables {
        if let Some(command) = &table.command {
            return Err(complain(command.span(), NO_PROGRAMS.to_owned()));
        }
    }
    let path = Path::new(source.name());
    let all = definitions(&tables.computables, Path::new(""), source.text(), path);
    let all = all.map_err(|(span, message)| complain(span, message))?;
    let same = |one: &Definition, other: &Definition| one.name == other.name;
    Ok(all.chunk_by(same).map(<[Definition]>::to_vec).collect())
}

impl Table {
    /// The collection, or several.
    fn namespaces(&self) -> Result<Vec<Namespace>, Mistake> {
        let span = || self.collection.span();
        let read = |name: &Value| match name {
            Value::String(name) => name.parse().map_err(|error: NamespaceError| (span(), error.to_string())),
            other => {
                let found = other.type_str();
                Err((span(), format!("expected a collection, or an array of collections, found {found}")))
            }
        };
        let namespaces: Vec<Namespace> = match self.collection.get_ref() {
            Value::Array(names) => names.iter().map(read).collect::<Result<_, _>>()?,
            name => vec![read(name)?],
        };
        match namespaces.iter().enumerate().find(|(at, name)| namespaces.iter().take(*at).any(|other| other == *name)) {
            Some((_, name)) => Err((span(), format!("{name} is given twice"))),
            None if namespaces.is_empty() => Err((span(), "expected a collection, found none".to_owned())),
            None => Ok(namespaces),
        }
    }

    /// The keys that the computable adds to stored documents, where it does.
    fn adds(&self) -> Result<Option<Vec<String>>, Mistake> {
        let Some(adds) = &self.adds else { return Ok(None) };
        let keys = match adds.get_ref() {
            Value::Boolean(adds) => adds.then(Vec::new),
            Value::Array(keys) => keys.iter().map(|key| key.as_str().map(str::to_owned)).collect(),
            _ => None,
        };
        match (&keys, adds.get_ref(), &self.cache, &self.builtin) {
            (None, Value::Boolean(_), ..) => Ok(None),
            (None, ..) => Err((adds.span(), "expected true, or an array of the added keys: [\"distance\"]".to_owned())),
            (_, _, Some(cache), _) => {
                Err((cache.span(), "`cache` has no meaning where keys are added: they are stored nowhere".to_owned()))
            }
            (_, _, _, Some(builtin)) => {
                Err((builtin.span(), "keys are added by a `pipeline` or a `command`, not by a builtin".to_owned()))
            }
            (Some(keys), Value::Array(_), ..) => {
                check_adds(keys).map_err(|wrong| (adds.span(), wrong))?;
                Ok(Some(keys.clone()))
            }
            _ => Ok(keys),
        }
    }

    fn definition(
        &self,
        namespace: Namespace,
        folder: &Path,
        file: &str,
        origin: Origin,
    ) -> Result<Definition, Mistake> {
        if self.name.get_ref().trim().is_empty() {
            return Err((self.name.span(), "expected a name for the computable, found an empty one".to_owned()));
        }
        Ok(Definition {
            name: self.name.get_ref().clone(),
            spec: self.spec(file)?,
            priority: self.priority,
            adds: self.adds()?,
            cache: duration(self.cache.as_ref(), "leave `cache` out to compute for each query")?,
            body: self.body(&namespace, folder, file)?,
            namespace,
            origin,
        })
    }

    fn spec(&self, file: &str) -> Result<Document, Mistake> {
        let text = Quoted { string: &self.spec, file };
        let spec = shell::parse_document(&text.source()).map_err(|error| text.syntax("expected a query", &error))?;
        Filter::parse(&spec).map_err(|error| text.refused("expected a query", &error))?;
        Ok(spec)
    }

    fn body(&self, namespace: &Namespace, folder: &Path, file: &str) -> Result<BodyKind, Mistake> {
        match (&self.pipeline, &self.command, &self.builtin) {
            (Some(pipeline), None, None) => {
                self.refuse("pipeline", &["timeout", "frames", "position"])?;
                let text = Quoted { string: pipeline, file };
                let wrong = "expected a pipeline";
                let stages = shell::parse_pipeline(&text.source()).map_err(|error| text.syntax(wrong, &error))?;
                check_pipeline(&stages).map_err(|error| text.refused(wrong, &error))?;
                let from = self.from.as_ref().map(self::namespace).transpose()?;
                Ok(BodyKind::Pipeline { from: from.unwrap_or_else(|| namespace.clone()), stages })
            }
            (None, Some(command), None) => {
                self.refuse("command", &["from", "frames", "position"])?;
                let words = command.get_ref().clone();
                if words.first().is_none_or(String::is_empty) {
                    return Err((command.span(), "expected a program and its arguments, found none".to_owned()));
                }
                let timeout = duration(self.timeout.as_ref(), "leave `timeout` out for 10s")?.unwrap_or(TIMEOUT);
                Ok(BodyKind::Command { words, folder: folder.to_owned(), timeout })
            }
            (None, None, Some(builtin)) => self.builtin(builtin, namespace),
            _ => Err((self.name.span(), "expected one body: `pipeline`, `command` or `builtin`".to_owned())),
        }
    }

    fn builtin(&self, name: &Spanned<String>, namespace: &Namespace) -> Result<BodyKind, Mistake> {
        let Some(builtin) = BUILTINS.iter().find(|builtin| builtin.name == name.get_ref()) else {
            let known: Vec<&str> = BUILTINS.iter().map(|builtin| builtin.name).collect();
            let known = known.join(", ");
            return Err((name.span(), format!("unknown builtin `{}`; expected one of {known}", name.get_ref())));
        };
        self.refuse(builtin.name, &["from", "timeout"])?;
        let given = [("frames", &self.frames), ("position", &self.position)];
        let given = given.into_iter().filter_map(|(key, value)| Some((key, value.as_ref()?)));
        let mut options = Options::new();
        for (key, value) in given.clone() {
            if !builtin.keys.contains(&key) {
                return Err((value.span(), format!("`{key}` has no meaning for the body `{}`", builtin.name)));
            }
            options.insert(key.to_owned(), value.get_ref().clone());
        }
        builtin.check(&options, namespace).map_err(|(wrong, words)| {
            let span =
                given.clone().find(|(key, _)| *key == wrong).map_or_else(|| name.span(), |(_, value)| value.span());
            (span, words)
        })?;
        Ok(BodyKind::Builtin { name: builtin.name.to_owned(), options })
    }

    /// Refuses keys without a meaning for a kind of body.
    fn refuse(&self, kind: &str, keys: &[&str]) -> Result<(), Mistake> {
        for key in keys {
            let span = match *key {
                "from" => self.from.as_ref().map(Spanned::span),
                "frames" => self.frames.as_ref().map(Spanned::span),
                "position" => self.position.as_ref().map(Spanned::span),
                _ => self.timeout.as_ref().map(Spanned::span),
            };
            if let Some(span) = span {
                return Err((span, format!("`{key}` has no meaning for the body `{kind}`")));
            }
        }
        Ok(())
    }
}

fn namespace(name: &Spanned<String>) -> Result<Namespace, Mistake> {
    name.get_ref().parse().map_err(|error: NamespaceError| (name.span(), error.to_string()))
}

/// Reads a duration that is not zero.
fn duration(text: Option<&Spanned<String>>, otherwise: &str) -> Result<Option<Duration>, Mistake> {
    let Some(text) = text else { return Ok(None) };
    match quantity::duration(text.get_ref()) {
        Ok(duration) if duration.is_zero() => {
            Err((text.span(), format!("expected a duration above zero, found `{}`; {otherwise}", text.get_ref())))
        }
        Ok(duration) => Ok(Some(duration)),
        Err(words) => Err((text.span(), words)),
    }
}
