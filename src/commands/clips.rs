//! `rmem clips export|import|run`: documents to CLIPS facts and back, and CLIPS itself.

#[cfg_attr(not(feature = "clips-engine"), path = "clips/without.rs")]
mod run;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;

use bson::{Bson, Document, doc};

use super::query::{argument, owned};
use super::{Context, UsageError, WrongInput};
use crate::cli::{Clips, ClipsCommand, ClipsExport, ClipsImport, NestedValues};
use crate::clips::facts::{Exporter, FactError, INITIAL, Importer, Nested, RELATION, Schema};
use crate::exit::Exit;
use crate::formats::clips::{Fact, Item, Reader, is_symbol, write_fact, write_operand, write_remark, write_value};
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::memory::Memory;
use crate::store::{Find, Namespace};

/// How many keys are looked up at once.
const BATCH: usize = 1_000;

/// How many names of a kind are told.
const NAMES: usize = 10;

pub(super) fn run(args: &Clips, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    match &args.command {
        ClipsCommand::Export(args) => export(args, context),
        ClipsCommand::Import(args) => import(args, context),
        ClipsCommand::Run(args) => run::run(args, context),
    }
}

fn export(args: &ClipsExport, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let (form, arguments) = Form::of(args)?;
    let schema = schema(&args.deftemplates, context)?;
    let nested = match args.nested {
        NestedValues::Refuse => Nested::Refuse,
        NestedValues::Flatten => Nested::Flatten,
        NestedValues::Json => Nested::Json,
    };
    let exporter = Exporter { schema: &schema, nested, strict: args.strict };
    let mut text = form.opening();
    let mut count = 0_usize;
    if let Some(path) = &args.from {
        if !arguments.is_empty() {
            return Err(UsageError::new("documents come from --from or from a namespace, not from both").into());
        }
        let source = context.read(path)?;
        for (span, document) in shell::parse_documents(&source)? {
            let fact = exporter.fact(&document).map_err(|error| complain(&source, span, &error))?;
            form.write(&fact, &mut text);
            count += 1;
        }
    } else {
        let mut arguments = arguments.into_iter();
        let namespace = match arguments.next() {
            Some(name) => Namespace::parse(name)?,
            None => context.settings.collection.value.clone(),
        };
        let filter = arguments.next().map(|query| argument("<query>", query)).transpose()?.unwrap_or_default();
        let memory = context.memory()?;
        for document in memory.find_with_metadata(&namespace, &Find { filter, ..Find::default() })? {
            let document = document.and_then(owned)?;
            let fact = exporter.fact(&document).map_err(|error| refuse(&namespace, &document, &error))?;
            form.write(&fact, &mut text);
            count += 1;
        }
    }
    text.push_str(form.closing());
    context.output.write_file(&args.output, text.as_bytes())?;
    context.output.note(&format!("{count} {}", plural(count, "fact", "facts")));
    Ok(Exit::Done)
}

/// What facts are written as.
enum Form<'a> {
    Facts,
    Deffacts(&'a str),
    Assert,
}

impl<'a> Form<'a> {
    /// The form, and the arguments that are left: where `--as facts` stands before
    /// them, its second value is the first of them.
    fn of(args: &'a ClipsExport) -> Result<(Self, Vec<&'a str>), UsageError> {
        let mut words = args.form.iter().map(String::as_str);
        let (form, more) = match (words.next(), words.next()) {
            (Some("facts"), more) => (Self::Facts, more),
            (Some("assert"), more) => (Self::Assert, more),
            (Some("deffacts"), Some(name)) if is_symbol(name) => (Self::Deffacts(name), None),
            (Some("deffacts"), _) => return Err(UsageError::new("expected --as deffacts NAME, the name a symbol")),
            _ => return Err(UsageError::new("expected --as facts, --as deffacts NAME, or --as assert")),
        };
        let places = [&args.namespace, &args.query];
        let arguments: Vec<&str> = more.into_iter().chain(places.into_iter().flatten().map(String::as_str)).collect();
        match arguments.get(2) {
            Some(extra) => Err(UsageError::new(format!("unexpected argument `{extra}`; expected NS and QUERY only"))),
            None => Ok((form, arguments)),
        }
    }

    fn opening(&self) -> String {
        match self {
            Self::Deffacts(name) => format!("(deffacts {name}\n"),
            Self::Facts | Self::Assert => String::new(),
        }
    }

    fn closing(&self) -> &'static str {
        match self {
            Self::Deffacts(_) => ")\n",
            Self::Facts | Self::Assert => "",
        }
    }

    fn write(&self, fact: &Fact, text: &mut String) {
        match self {
            Self::Facts => write_fact(fact, write_value, text),
            Self::Deffacts(_) => {
                text.push_str("   ");
                write_fact(fact, write_operand, text);
            }
            Self::Assert => {
                text.push_str("(assert ");
                write_fact(fact, write_operand, text);
                text.push(')');
            }
        }
        write_remark(fact, text);
        text.push('\n');
    }
}

fn complain(source: &Source, span: Span, error: &FactError) -> Diagnostic {
    let complaint = Diagnostic::new(source, span, error.to_string());
    if error.is_nested() { complaint.hint(NESTED) } else { complaint }
}

fn refuse(namespace: &Namespace, document: &Document, error: &FactError) -> WrongInput {
    let id = document.get("_id").map(shell::relaxed_value).unwrap_or_default();
    let hint = if error.is_nested() { format!("\n  = hint: {NESTED}") } else { String::new() };
    WrongInput::new(format!("{namespace}, document {id}: {error}{hint}"))
}

const NESTED: &str = "--nested flatten makes slots of nested keys, --nested json writes a string";

/// The templates of files; facts in them are not looked at.
fn schema(paths: &[PathBuf], context: &mut Context<'_>) -> anyhow::Result<Schema> {
    let mut schema = Schema::default();
    for path in paths {
        let source = context.read(path)?;
        for item in Reader::of_templates(&source) {
            if let Item::Template(template) = item? {
                schema.add(template);
            }
        }
    }
    Ok(schema)
}

fn import(args: &ClipsImport, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let schema = schema(&args.deftemplates, context)?;
    let source = context.read(&args.file)?;
    let namespace = args.into.clone().unwrap_or_else(|| context.settings.collection.value.clone());
    let (mut found, skipped) = documents(&source, schema, args)?;
    let memory = context.memory_to_fill()?;
    if let Some(key) = &args.key {
        replace(key, &source, &mut found, &memory, &namespace)?;
    }
    let put = memory.put(&namespace, found.into_iter().map(|(_, document)| document).collect())?;
    let line = format!("{{\"inserted\":{},\"replaced\":{},\"unchanged\":{}}}", put.inserted, put.replaced, put.same);
    context.output.line(&line)?;
    tell(&skipped, context);
    Ok(Exit::Done)
}

/// The names of what was passed over, by kind.
type Skipped = BTreeMap<String, Vec<String>>;

/// Documents, each with the place of its fact.
type Found = Vec<(Span, Document)>;

/// The documents of a text.
fn documents(source: &Source, mut schema: Schema, args: &ClipsImport) -> Result<(Found, Skipped), Diagnostic> {
    let names: Vec<String> = schema.names().map(str::to_owned).collect();
    let (mut documents, mut skipped) = (Vec::new(), Skipped::new());
    for item in Reader::new(source, names) {
        match item? {
            Item::Template(template) => schema.add(template),
            Item::Skipped { kind, name } => skipped.entry(kind).or_default().push(name),
            Item::Fact(fact) => {
                let importer = Importer { schema: &schema, strict: args.strict };
                let document =
                    importer.document(&fact).map_err(|error| Diagnostic::new(source, error.span, error.message))?;
                documents.push((fact.span, document));
            }
        }
    }
    Ok((documents, skipped))
}

/// Gives each document the `_id` of the stored one with the same key.
fn replace(
    key: &str,
    source: &Source,
    documents: &mut Found,
    memory: &Memory,
    namespace: &Namespace,
) -> anyhow::Result<()> {
    // CLIPS asserts this one by itself; it tells nothing.
    let initial = |document: &Document| document.get_str(RELATION).is_ok_and(|name| name == INITIAL);
    documents.retain(|(_, document)| !initial(document));
    let mut seen = HashMap::new();
    for (span, document) in documents.iter() {
        let value = match document.get(key) {
            None => return Err(Diagnostic::new(source, *span, format!("expected the slot `{key}`, the key")).into()),
            Some(Bson::Array(_)) => {
                return Err(
                    Diagnostic::new(source, *span, format!("expected one value in the slot `{key}`, the key")).into()
                );
            }
            Some(value) => value,
        };
        if let Some(first) = seen.insert(identity(value), *span) {
            let (line, column) = source.position(first.start);
            let message = format!("another fact has the key `{key}` {}", shell::relaxed_value(value));
            return Err(Diagnostic::new(source, *span, message).hint(format!("it stands at {line}:{column}")).into());
        }
    }
    for batch in documents.chunks_mut(BATCH) {
        let values: Vec<Bson> = batch.iter().filter_map(|(_, document)| document.get(key).cloned()).collect();
        let stored = stored(key, values, memory, namespace)?;
        for (_, document) in batch {
            if let Some(id) = document.get(key).and_then(|value| stored.get(&identity(value))) {
                let rest = std::mem::take(document);
                *document = doc! { "_id": id.clone() }.into_iter().chain(rest).collect();
            }
        }
    }
    Ok(())
}

/// The `_id`s of the documents with these keys.
fn stored(
    key: &str,
    values: Vec<Bson>,
    memory: &Memory,
    namespace: &Namespace,
) -> anyhow::Result<HashMap<String, Bson>> {
    let find = Find { filter: doc! { key: { "$in": values } }, projection: doc! { key: 1 }, ..Find::default() };
    let mut ids = HashMap::new();
    let mut twice = HashSet::new();
    for document in memory.find(namespace, &find)? {
        let mut document = document.and_then(owned)?;
        let (Some(value), Some(id)) = (document.remove(key), document.remove("_id")) else { continue };
        let name = identity(&value);
        if ids.insert(name.clone(), id).is_some() && twice.insert(name) {
            let value = shell::relaxed_value(&value);
            let message = format!("{namespace} holds two documents with the key `{key}` {value}; nothing was imported");
            return Err(WrongInput::new(message).into());
        }
    }
    Ok(ids)
}

/// What is equal for values that the memory takes as equal.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "only exact numbers are converted")]
fn identity(value: &Bson) -> String {
    match value {
        Bson::Int32(number) => number.to_string(),
        Bson::Int64(number) => number.to_string(),
        Bson::Double(number) if number.trunc() == *number && number.abs() < 9e18 => (*number as i64).to_string(),
        other => shell::canonical_value(other),
    }
}

/// Says what was passed over.
fn tell(skipped: &Skipped, context: &mut Context<'_>) {
    for (kind, names) in skipped {
        let named: Vec<&str> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        let more = named.len().saturating_sub(NAMES);
        let shown = named.iter().take(NAMES).copied().collect::<Vec<_>>().join(", ");
        let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
        let list = if shown.is_empty() { String::new() } else { format!(": {shown}{rest}") };
        context.output.note(&format!("passed over {} {kind}{list}", names.len()));
    }
}

fn plural(count: usize, one: &'static str, many: &'static str) -> &'static str {
    if count == 1 { one } else { many }
}
