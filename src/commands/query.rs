//! `rmem query NS [QUERY]`: the documents that match.

use bson::doc;
use clap::Args;

use super::at::AtArgs;
use super::modifiers::{HINT, ModifierArgs};
use super::read::ReadArgs;
use super::{Context, formats, missing};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::fault::{AtFault as _, Fault};
use crate::formats::{Diagnostic, Source, Span, mongosh, nearest, shell};
use crate::memory::{Diagnosis, Memory};
use crate::query::{QueryMistake, known_names, misplaced};
use crate::store::{Find, Namespace, StoreError};

/// What stands below the help of `query`.
const HELP: &str = "\
Examples:
  rmem query robmem.worldmodel \"{relation: 'on'}\" --sort '{object_top: 1}'
  rmem query robmem.worldmodel --fields '{object: 1, _id: 0}' --limit 5
  rmem query robmem.worldmodel '{relation: \"no\", size: {$gt: \"3\"}}' --why";

/// Print the documents that match a query
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::DOCUMENTS))]
pub struct QueryArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents, or - for stdin (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// Sort order, e.g. '{name: 1}' (-1 is descending)
    #[arg(long, value_name = "SORT", allow_hyphen_values = true)]
    pub sort: Option<String>,
    /// Print at most N documents (default: all)
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub limit: u64,
    /// Skip the first N documents
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub skip: u64,
    /// Fields to print, e.g. '{name: 1}', or to leave out, e.g. '{name: 0}'
    #[arg(long, value_name = "PROJECTION")]
    pub fields: Option<String>,
    /// Show the metadata of documents, under `_robmem_info`
    #[arg(long)]
    pub meta: bool,
    /// Which documents are read.
    #[command(flatten)]
    pub read: ReadArgs,
    /// The memory as it was.
    #[command(flatten)]
    pub past: AtArgs,
    /// Print how the query is executed instead of its result: index, keys and documents examined
    #[arg(long)]
    pub explain: bool,
    /// Print how many documents meet each condition instead of the result, and why none does
    #[arg(long, conflicts_with = "explain")]
    pub why: bool,
    /// How strings compare, variables, and the index to read.
    #[command(flatten)]
    pub modifiers: ModifierArgs,
}

pub(super) fn run(args: &QueryArgs, context: &mut Context<'_>) -> Result<Exit> {
    let find = Find {
        filter: filter_of(&args.namespace, &args.query)?,
        sort: args.sort.as_deref().map(|text| fields("<sort>", "--sort ", text)).transpose()?.unwrap_or_default(),
        projection: args
            .fields
            .as_deref()
            .map(|text| fields("<fields>", "--fields ", text))
            .transpose()?
            .unwrap_or_default(),
        skip: args.skip,
        limit: args.limit,
        modifiers: args.modifiers.read()?,
        ..Find::default()
    };
    let texts = [
        ("<query>", args.query.as_str()),
        ("<sort>", args.sort.as_deref().unwrap_or_default()),
        ("<fields>", args.fields.as_deref().unwrap_or_default()),
        args.modifiers.hint(),
    ];
    let memory = args.past.memory(context)?;
    args.read.apply(&args.namespace, &memory, context)?;
    if args.why {
        let diagnosis = memory.diagnose(&args.namespace, &find.filter).map_err(|error| blame(error, &texts))?;
        return why(&diagnosis, &memory, context);
    }
    if args.explain {
        let explanation = memory.explain(&args.namespace, &find).map_err(|error| blame(error, &texts))?;
        context.print_documents([Ok(explanation)].into_iter())?;
        return Ok(Exit::Done);
    }
    let documents = match args.meta {
        true => memory.find_with_metadata(&args.namespace, &find),
        false => memory.find(&args.namespace, &find),
    };
    let documents = documents.map_err(|error| blame(error, &texts))?;
    let documents = documents.map(|document| document.and_then(owned).map_err(|error| blame(error, &texts)));
    if context.print_documents(documents)? == 0 && !missing::warn(&args.namespace, &memory, context) {
        hint(&find, context);
    }
    Ok(Exit::Done)
}

/// Prints where to look when a query matches nothing.
fn hint(find: &Find, context: &mut Context<'_>) {
    if context.is_terminal() && !find.filter.is_empty() {
        context.output.note("no document matches; --why shows which condition none meets");
    }
}

/// Prints a diagnosis: lines for people, or a document where a format is asked for.
fn why(diagnosis: &Diagnosis, memory: &Memory, context: &mut Context<'_>) -> Result<Exit> {
    match context.settings.format.value {
        None => diagnosis.lines().iter().try_for_each(|line| context.output.line(line))?,
        Some(_) => {
            context.print_documents([Ok(diagnosis.to_document())].into_iter())?;
        }
    }
    if diagnosis.documents == 0 {
        missing::warn(&diagnosis.namespace, memory, context);
    }
    Ok(Exit::Done)
}

/// A document whose keys are fields, with numbers for values. A list of names, as other tools take it, gets a hint
/// with `option` in front.
pub(super) fn fields(name: &'static str, option: &str, text: &str) -> Result<bson::Document, Diagnostic> {
    argument(name, text).map_err(|error| {
        // A sign in front is how others write a direction, or that a field is left out.
        let signed = |name| match str::strip_prefix(name, '-') {
            Some(name) if option.contains("--fields") => (name, "0"),
            Some(name) => (name, "-1"),
            None => (name.strip_prefix('+').unwrap_or(name), "1"),
        };
        let names: Vec<(&str, &str)> = text.split([',', ' ']).filter(|name| !name.is_empty()).map(signed).collect();
        let is_name = |(name, _): &(&str, &str)| {
            !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'))
        };
        if names.is_empty() || !names.iter().all(is_name) {
            return error;
        }
        let fields = names.iter().map(|(name, value)| match name.contains(['.', '-']) {
            true => format!("\"{name}\": {value}"),
            false => format!("{name}: {value}"),
        });
        error.without_hints().hint(format!("write {option}'{{{}}}'", fields.collect::<Vec<_>>().join(", ")))
    })
}

/// A document given on the command line; `name` is what messages call it.
pub(super) fn argument(name: &'static str, text: &str) -> Result<bson::Document, Diagnostic> {
    let read = shell::parse_document(&Source::new(name, text)).map(shell::with_regexes_in_arrays);
    read.map_err(|error| match in_braces(text, name == "<query>") {
        // What may be a URI with a password is not repeated.
        Some(document) if !text.contains("://") => {
            error.without_hints().hint(format!("a document is written in braces: {document}"))
        }
        _ => error,
    })
}

/// The query of a command on a collection; a line of mongosh gets the command for it.
pub(super) fn filter_of(namespace: &Namespace, text: &str) -> Result<bson::Document, Diagnostic> {
    argument("<query>", text).map_err(|error| of_mongosh(error, namespace, text))
}

/// The error with the command for a line of mongosh, where the text that is wrong is one.
pub(super) fn of_mongosh(error: Diagnostic, namespace: &Namespace, text: &str) -> Diagnostic {
    let database = &namespace.database;
    let command = mongosh::command(text, database).map(|command| format!("write: {command}"));
    match command.or_else(|| mongosh::advice(text, database)) {
        Some(hint) => error.without_hints().hint(hint),
        None => error,
    }
}

/// What to write for `team=CYAN` and, in a query, for a value alone, which is taken for an `_id`.
pub(super) fn in_braces(text: &str, is_query: bool) -> Option<String> {
    let is_name = |name: &str| {
        name.starts_with(char::is_alphabetic) && name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '.'))
    };
    let value = |text: &str| match text.parse::<f64>() {
        Ok(number) if number.is_finite() => text.to_owned(),
        _ => shell::relaxed_value(&text.trim_matches(['"', '\'']).into()).replace('"', "'"),
    };
    let pair = text.split_once("==").or_else(|| text.split_once(['=', ':']));
    match pair.map(|(name, value)| (name.trim(), value.trim())) {
        Some((name, text)) if is_name(name) && !text.is_empty() && !text.contains(['{', '[', '(', '\\', '\n']) => {
            let name = if name.contains('.') { format!("'{name}'") } else { name.to_owned() };
            Some(format!("{{{name}: {}}}", value(text)))
        }
        None if is_query && text.parse::<f64>().is_ok_and(f64::is_finite) => Some(format!("{{_id: {text}}}")),
        _ => None,
    }
}

/// `{battery: {$gt: 0.6}}` for a query like `{$gt: {battery: 0.6}}`.
fn behind_key(query: &Source, operator: &str) -> Option<String> {
    let query = shell::parse_document(query).ok()?;
    let inner = query.get_document(operator).ok().filter(|inner| inner.len() == 1)?;
    let (key, value) = inner.iter().find(|(key, _)| !key.starts_with('$'))?;
    Some(shell::typed(&doc! { key: { operator: value.clone() } }.into()))
}

/// What to write instead of a mistake; `written` is the name that it is about, as `source` has it.
fn advice(mistake: QueryMistake, written: &str, source: &Source) -> Option<String> {
    match mistake {
        QueryMistake::UnknownName(context) => misplaced(context, written, behind_key(source, written)).or_else(|| {
            let meant = nearest(written, known_names(context).iter().copied())?;
            Some(format!("did you mean `{meant}`?"))
        }),
        QueryMistake::NoArray => Some(format!("write {written}: [{{a: 1}}, {{b: 2}}]")),
        QueryMistake::NoGroupId => {
            Some("_id: '$key' makes a group for each value of key, _id: null makes one group".to_owned())
        }
        QueryMistake::Hint | QueryMistake::InFunction(_) => None,
    }
}

/// Decodes a document of a store.
pub(super) fn owned(document: bson::RawDocumentBuf) -> Result<bson::Document, StoreError> {
    bson::Document::try_from(document.as_ref())
        .map_err(|error| StoreError::Failed { address: "a document of the store".into(), reason: error.to_string() })
}

/// A complaint of a store about a query, shown at the operator or field it is about
/// in the first of the texts that has it; the kind of any other error stays.
pub(super) fn blame(error: StoreError, texts: &[(&'static str, &str)]) -> Error {
    let doing = error.to_string();
    if let StoreError::Partial { source, .. } = error {
        return blame(*source, texts).context(doing);
    }
    let StoreError::Query(query) = &error else { return error.into() };
    // Not what was asked is at fault, but the disk.
    if error.fault() != Fault::Input {
        return error.into();
    }
    // The default of a query was not typed.
    let given = texts.iter().copied().filter(|(_, text)| !matches!(*text, "" | "{}"));
    let (hints, others): (Vec<_>, Vec<_>) = given.partition(|(name, _)| *name == HINT);
    let texts = if hints.is_empty() || query.mistake != Some(QueryMistake::Hint) { others } else { hints };
    let all: Vec<&str> = texts.iter().map(|(_, text)| *text).collect();
    let place = query.place_among(&all).and_then(|(number, place)| Some((texts.get(number)?, place)));
    match (place, texts.as_slice()) {
        (Some(((name, text), place)), _) => {
            let source = Source::new(*name, *text);
            let written = text.get(place.start..place.end).unwrap_or_default().trim_matches(['"', '\'']);
            let error = Diagnostic::new(&source, Span::new(place.start, place.end), query.message.clone());
            let advice = query.mistake.and_then(|mistake| advice(mistake, written, &source));
            advice.into_iter().fold(error, Diagnostic::hint).into()
        }
        (None, [(name, text)]) => {
            let source = Source::new(*name, *text);
            Diagnostic::new(&source, Span::new(0, text.len()), query.message.clone()).into()
        }
        _ => error.into(),
    }
}
