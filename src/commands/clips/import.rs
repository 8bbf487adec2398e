//! `rmem clips import [FILE]`: CLIPS facts as documents.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use bson::{Bson, Document, doc};
use clap::Args;

use super::schema;
use crate::clips::facts::{Found, Importer, Schema, give_ids, remove_repeated, remove_stored, spelled};
use crate::commands::{Context, UsageError, WrongInput, conflict, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::clips::{self, Body, Fact, Globals, Item, Reader, Slot};
use crate::formats::command_line::word;
use crate::formats::{Diagnostic, Source, Span, Texts, nearest};
use crate::memory::Memory;
use crate::saturate::to_i64;
use crate::store::{Namespace, StoreError};

/// What stands below the help of `clips import`.
const HELP: &str = "\
Examples:
  rmem clips import facts.txt --into robmem.worldmodel --deftemplates templates.clp --key sync-id
  rmem clips import machines.clp orders.clp --key name,team

Reads facts as (save-facts) writes them, what (facts) lists, deffacts, and the facts in programs. Equal facts are one \
fact, as in CLIPS, also if one of them is in the collection already.";

/// Store CLIPS facts as documents, all or none
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct ImportArgs {
    /// Files with facts, deffacts or programs (default: -, which is stdin)
    #[arg(value_name = "FILE", default_value = "-", hide_default_value = true)]
    pub files: Vec<PathBuf>,
    /// Collection to store into (default: --collection)
    #[arg(long, value_name = "NS")]
    pub into: Option<Namespace>,
    /// File with deftemplates, which check facts and give defaults, and defglobals (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// Slots that identify facts: a fact replaces the document with the same values (can be repeated)
    #[arg(long, value_name = "SLOT,…", value_delimiter = ',')]
    pub key: Vec<String>,
    /// Fail if a fact has no deftemplate
    #[arg(long)]
    pub strict: bool,
}

/// How many names of a kind are printed.
const NAMES: usize = 10;
/// The construct that asserts instances.
const INSTANCES: &str = "definstances";
/// The construct of global variables.
const GLOBALS: &str = "defglobal";
/// What is said about it.
const NO_INSTANCES: &str = "instances of classes cannot be imported, only facts";

pub(super) fn run(args: &ImportArgs, context: &mut Context<'_>) -> Result<Exit> {
    refuse_namespace(args)?;
    let mut schema = schema::read(&args.deftemplates, context)?;
    let progress = context.output.progress("importing facts");
    let sources = args.files.iter().map(|file| context.read_clips(file)).collect::<Result<Vec<Source>>>()?;
    let (first, others) = sources.split_first().ok_or_else(|| UsageError::new("expected a file"))?;
    let texts = Texts::new(first, others.iter().cloned());
    let namespace = args.into.clone().unwrap_or_else(|| context.settings.collection.value.clone());
    let (mut found, mut remarks) = (Vec::new(), Remarks::default());
    for (base, source) in texts.iter() {
        let own = documents(source, &mut schema, args, &mut remarks)?;
        remarks.check_imported(source, &own)?;
        let placed = own.into_iter().map(|(span, document)| (Span::new(base + span.start, base + span.end), document));
        found.extend(placed);
    }
    let repeated = remove_repeated(&mut found);
    let memory = context.memory_to_fill()?.with_meter(progress.meter());
    // Another import sees what this one stores before it looks for its own facts.
    let (stored, put) = memory.atomically(&[&namespace], Error::from, |_| {
        let stored = match args.key.as_slice() {
            [] => remove_stored(&mut found, &memory, &namespace)?,
            keys => {
                let keys = &spelled(keys, &found, &schema.respelled);
                give_ids(keys, &texts, &mut found, &memory, &namespace, &schema.respelled)?;
                0
            }
        };
        let documents = found.iter().map(|(_, document)| document.clone()).collect();
        let put = memory.put(&namespace, documents).map_err(|error| taken(error, &found, &texts, &memory))?;
        Ok::<_, Error>((stored, put))
    })?;
    drop(progress);
    let is_empty = repeated == 0 && stored == 0 && found.is_empty();
    let count = to_i64::<u64>;
    let unchanged = put.same + u64::try_from(stored).unwrap_or(u64::MAX);
    let result =
        doc! { "inserted": count(put.inserted), "replaced": count(put.replaced), "unchanged": count(unchanged) };
    context.print_result(result)?;
    schema.respelled.take().iter().for_each(|name| context.output.note(name));
    if repeated > 0 {
        context.output.note(&format!("{} in the text more than once; each was imported once", facts(repeated)));
    }
    if stored > 0 {
        context.output.note(&format!("{} in {namespace} already", facts(stored)));
    }
    if is_empty {
        remarks.report_empty(context);
    }
    remarks.report(&schema, args, context);
    Ok(Exit::Done)
}

/// Refuses a collection among the files, as most commands have it.
fn refuse_namespace(args: &ImportArgs) -> Result<()> {
    let namespace = |file: &PathBuf| file.to_string_lossy().parse::<Namespace>().ok().filter(|_| !file.exists());
    let Some(found) = args.files.iter().find_map(namespace).filter(|_| args.into.is_none()) else { return Ok(()) };
    let name = found.to_string();
    let others = args.files.iter().map(|file| file.to_string_lossy()).filter(|file| *file != name);
    // A file that is not there may be meant, too.
    if args.files.len() < 2 {
        return Ok(());
    }
    let files = others.map(|file| word(&file)).collect::<Vec<_>>().join(" ");
    let advice = "the collection is given by an option: rmem clips import";
    Err(UsageError::new(format!("there is no file {name}; {advice} {files} --into {name}")).into())
}

/// The error for a unique key that is taken, at the fact that was to have it, with the document that has it.
fn taken(error: StoreError, found: &Found, texts: &Texts, memory: &Memory) -> Error {
    let StoreError::Duplicate { key, .. } = &error else { return error.into() };
    let has = |document: &Document, (path, wanted): (&String, &Bson)| match document.get(path) {
        Some(Bson::Array(values)) => values.contains(wanted),
        value => value.unwrap_or(&Bson::Null) == wanted,
    };
    let holder = conflict::holder(&error, memory);
    // A fact that takes the place of the document that has the key is no other document.
    let is_other = |document: &Document| holder.is_none() || document.get("_id") != holder.as_ref();
    let mut facts = found.iter().filter(|(_, document)| {
        !key.values().is_empty() && key.values().iter().all(|wanted| has(document, wanted)) && is_other(document)
    });
    let place = |span: &Span| {
        let (source, place) = texts.locate(*span);
        let (line, column) = source.position(place.start);
        format!("{}:{line}:{column}", source.name())
    };
    let stored = holder.as_ref().map(conflict::named).unwrap_or_default();
    let message = match (facts.next(), facts.next()) {
        (Some((first, _)), Some((second, _))) if holder.is_none() => {
            let (first, second) = (place(first), place(second));
            let what = format!("{second}: the fact at {first} has the same {key}; nothing was imported");
            return StoreError::Held { what }.into();
        }
        (Some((fact, _)), _) => format!("{}: {error}{stored}; nothing was imported", place(fact)),
        _ => format!("{error}{stored}; nothing was imported"),
    };
    Error::from(error).context(message)
}

/// `1 fact was`, `2 facts were`.
fn facts(count: usize) -> String {
    if count == 1 { "1 fact was".to_owned() } else { format!("{count} facts were") }
}

/// What is said about the texts besides their facts.
#[derive(Debug, Default)]
struct Remarks {
    /// The names of what was passed over, by kind.
    skipped: BTreeMap<String, Vec<String>>,
    /// The global variables whose values facts have.
    used: Vec<String>,
    /// How many deftemplates the texts have.
    templates: usize,
    /// Templates that are not among the known ones.
    unknown: BTreeSet<String>,
    /// Slots that CLIPS would take for calls, with their templates.
    doubtful: BTreeSet<(String, String)>,
    /// Slots that were left out, with their templates: only a running CLIPS knows their defaults.
    left_out: BTreeSet<(String, String)>,
}

/// The documents of a text, each with its place in it. Its deftemplates and defglobals are added to the schema.
fn documents(
    source: &Source,
    schema: &mut Schema,
    args: &ImportArgs,
    remarks: &mut Remarks,
) -> Result<Found, Diagnostic> {
    let names: Vec<String> = schema.names().map(str::to_owned).collect();
    let mut documents = Vec::new();
    let mut reader = Reader::new(source, names).with_globals(std::mem::take(&mut schema.globals));
    for item in reader.by_ref() {
        match item? {
            Item::Template(template) => {
                remarks.templates += 1;
                schema.add(template);
            }
            Item::Skipped { kind, name } => remarks.skipped.entry(kind).or_default().push(name),
            Item::Fact(fact) => {
                let importer = Importer { schema, strict: args.strict };
                let document =
                    importer.document(&fact).map_err(|error| Diagnostic::new(source, error.span, error.message))?;
                remarks.note(&fact, schema);
                documents.push((fact.span, document));
            }
        }
    }
    remarks.doubtful.extend(reader.doubtful().iter().cloned());
    schema.globals = reader.into_globals();
    remarks.take_used(&schema.globals);
    Ok(documents)
}

impl Remarks {
    /// Notes what has to be said about a fact.
    fn note(&mut self, fact: &Fact, schema: &Schema) {
        match (schema.get(&fact.name), &fact.body) {
            (None, Body::Slots(_)) => drop(self.unknown.insert(fact.name.clone())),
            // Ordered facts need no deftemplate.
            (None, Body::Ordered(_)) if nearest(&fact.name, schema.names()).is_some() => {
                self.unknown.insert(fact.name.clone());
            }
            (Some(template), Body::Slots(filled)) => {
                let is_left_out = |slot: &&Slot| {
                    slot.default == clips::Default::Unknown && filled.iter().all(|filled| filled.name != slot.name)
                };
                let left_out = template.slots.iter().filter(is_left_out);
                self.left_out.extend(left_out.map(|slot| (template.name.clone(), slot.name.clone())));
            }
            _ => {}
        }
    }

    /// Takes the global variables whose values were used out of what was passed over.
    fn take_used(&mut self, globals: &Globals) {
        let Some(names) = self.skipped.get_mut(GLOBALS) else { return };
        let (used, unused) = std::mem::take(names).into_iter().partition::<Vec<_>, _>(|name| globals.is_used(name));
        self.used.extend(used);
        match unused.is_empty() {
            true => drop(self.skipped.remove(GLOBALS)),
            false => *names = unused,
        }
    }

    /// Says why nothing was imported, where the texts have no facts.
    fn report_empty(&self, context: &mut Context<'_>) {
        let templates = match self.templates {
            0 => "",
            _ => ": deftemplates say which slots facts have, for facts of other files with --deftemplates",
        };
        context.output.note(&format!("there are no facts to import{templates}"));
    }

    /// Refuses a text that has instances and no facts.
    fn check_imported(&self, source: &Source, found: &Found) -> Result<(), WrongInput> {
        match self.skipped.contains_key(INSTANCES) && found.is_empty() {
            true => Err(WrongInput::new(format!("{}: {NO_INSTANCES}; nothing was imported", source.name()))),
            false => Ok(()),
        }
    }

    fn report(&self, schema: &Schema, args: &ImportArgs, context: &mut Context<'_>) {
        if !args.deftemplates.is_empty() {
            for name in &self.unknown {
                let hint = nearest(name, schema.names()).map(|name| format!("; did you mean `{name}`?"));
                let hint = hint.unwrap_or_default();
                context.output.warn(&format!("no deftemplate `{name}`; its facts were not checked{hint}"));
            }
        }
        for (template, slot) in &self.doubtful {
            context.output.warn(&format!(
                "no deftemplate `{template}`: took `{slot}` for a slot; CLIPS would call the function `{slot}`"
            ));
        }
        for (template, slot) in &self.left_out {
            context.output.note(&format!(
                "the slot `{slot}` of `{template}` was left out where a fact does not give it: its default is computed by CLIPS"
            ));
        }
        if self.skipped.contains_key(INSTANCES) {
            context.output.warn(NO_INSTANCES);
        }
        self.report_skipped(context);
    }

    /// Says what was passed over.
    fn report_skipped(&self, context: &mut Context<'_>) {
        let used = (!self.used.is_empty()).then_some(("used the values of", GLOBALS, &self.used));
        let skipped = self.skipped.iter().map(|(kind, names)| ("passed over", kind.as_str(), names));
        for (what, kind, names) in used.into_iter().chain(skipped) {
            let named: Vec<&str> = names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
            let more = named.len().saturating_sub(NAMES);
            let shown = named.iter().take(NAMES).copied().collect::<Vec<_>>().join(", ");
            let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
            let list = if shown.is_empty() { String::new() } else { format!(": {shown}{rest}") };
            context.output.note(&format!("{what} {} {kind}{list}", names.len()));
        }
    }
}
