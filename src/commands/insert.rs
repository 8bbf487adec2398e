//! `rmem insert NS [DOC…|--file F|-]`: store documents in JSON, YAML or CSV; print their ids.
//!
//! Documents are stored as they come, in batches that grow, so that a slow
//! producer's documents are in the memory soon and a long file is read once.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use bson::{Bson, Document};
use clap::{Args, ValueEnum};

use super::query::{blame, in_braces, of_mongosh};
use super::{Context, UsageError, WrongInput, conflict, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::fault::{AtFault as _, Fault};
use crate::formats::command_line::word;
use crate::formats::shell::{self, ReadError, Reader};
use crate::formats::{Diagnostic, Position, Source, Span, csv, yaml};
use crate::input::unreadable;
use crate::interrupt::InterruptGuard;
use crate::memory::Memory;
use crate::output::{Format, amount};
use crate::store::{Namespace, StoreError};

/// What stands below the help of `insert`.
const HELP: &str = "\
Examples:
  rmem insert robmem.worldmodel \"{relation: 'on-table', object: 'A'}\"
  rmem insert robmem.worldmodel --file objects.jsonl
  rmem insert robmem.worldmodel --file objects.yaml
  rmem insert robmem.worldmodel --file objects.csv

Prints the _id of each stored document, one a line. Documents are stored in order; if one is refused, those before \
it stay stored, and those after it are not stored.

YAML is one mapping for each document, in a sequence or separated by ---. In CSV and TSV, the first row has the keys \
('pose.x' is the key x of the document at pose); numbers (.5, +5, 1e3, NaN; not 007, which is text), true, false, dates with time and zone and JSON in braces or \
brackets are read as such, unless a key says the type of its values: 'code.string()', 'n.int64()', 'at.date()'.";

/// Store documents and print their ids
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::VALUES))]
pub struct InsertArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Documents in shell syntax or Extended JSON (default: -, which is stdin)
    #[arg(value_name = "DOC")]
    pub documents: Vec<String>,
    /// Read documents from a file
    #[arg(short, long, value_name = "FILE", conflicts_with = "documents")]
    pub file: Option<PathBuf>,
    /// Format of the file, or of stdin: json, yaml, csv, tsv (default: by the file's extension, else json)
    #[arg(long = "type", value_name = "TYPE", hide_possible_values = true)]
    pub kind: Option<InputFormat>,
}

/// The formats of documents to store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputFormat {
    /// JSON, JSON lines, or shell syntax.
    Json,
    /// Mappings.
    Yaml,
    /// Rows of values, separated by commas.
    Csv,
    /// Rows of values, separated by tabs.
    Tsv,
}

/// What messages call a document that is the only one on the command line.
const ONLY_ARGUMENT: &str = "<argument>";

/// How many documents are stored, and acknowledged, at once at the most.
const LARGEST_BATCH: usize = 1_000;

/// How old a document may get before it is stored with those that came by then.
const FLUSH_INTERVAL: Duration = Duration::from_millis(50);

pub(super) fn run(args: &InsertArgs, context: &mut Context<'_>) -> Result<Exit> {
    if args.kind.is_some() && args.documents.iter().any(|text| text != "-") {
        return Err(UsageError::new(
            "--type is for a file or stdin; documents on the command line are in shell syntax",
        )
        .into());
    }
    let mut memory = context.memory_to_fill()?;
    let progress = args.file.as_ref().map(|_| context.output.progress(&format!("storing in {}", args.namespace)));
    if let Some(progress) = &progress {
        memory = memory.with_meter(progress.meter());
    }
    // An interruption ends the work between two batches; but reading from a pipe may wait for ever.
    let guard = args.file.as_ref().filter(|path| path.is_file()).map(|_| InterruptGuard::new());
    let is_interrupted = || guard.as_ref().is_some_and(|guard| guard.interrupted().load(Ordering::Relaxed));
    let mut batch = Batch::new(args, context.format(&formats::VALUES)?);
    let read = read_all(args, &mut batch, &is_interrupted, &memory, context);
    // What was read before a mistake is stored all the same: the documents are stored in order.
    let stored = batch.store(&memory, context);
    if batch.format == Format::Json {
        context.print_values(std::mem::take(&mut batch.ids).into_iter().map(Ok))?;
    }
    if let Err(error) = stored.and(read) {
        return Err(after(error, batch.stored));
    }
    if is_interrupted() {
        let count = amount(batch.stored as u64, "document");
        context.output.error(&format!("interrupted; the first {count} of the file were stored in {}", args.namespace));
        return Ok(Exit::Interrupted);
    }
    context.output.note(&format!("{} stored in {}", batch.stored, args.namespace));
    if batch.has_world {
        context.output.warn(
            "a document has collections as keys, like a world file; `rmem restore FILE` stores the documents of a \
             world file in their collections",
        );
    }
    Ok(Exit::Done)
}

/// Reads documents from the command line, a file, or stdin, and stores them but for the last batch.
fn read_all(
    args: &InsertArgs,
    batch: &mut Batch<'_>,
    is_interrupted: &dyn Fn() -> bool,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<()> {
    for (index, text) in args.documents.iter().enumerate() {
        if text == "-" {
            read_file(Path::new("-"), args, batch, is_interrupted, memory, context)?;
            continue;
        }
        let name =
            if args.documents.len() == 1 { ONLY_ARGUMENT.to_owned() } else { format!("<argument {}>", index + 1) };
        let source = Source::new(name, text.as_str());
        let documents =
            shell::parse_documents(&source).map_err(|error| of_mongosh(hinted(error, text), &args.namespace, text))?;
        if documents.is_empty() {
            return Err(WrongInput::new(format!("{}: expected a document, found nothing", source.name())).into());
        }
        batch.name = source.name().into();
        for (span, document) in documents {
            batch.add(document, source.position(span.start), memory, context)?;
        }
    }
    match &args.file {
        Some(path) => read_file(path, args, batch, is_interrupted, memory, context),
        None if args.documents.is_empty() => read_file(Path::new("-"), args, batch, is_interrupted, memory, context),
        None => Ok(()),
    }
}

/// Reads the documents of a file, or of stdin for `-`.
fn read_file(
    path: &Path,
    args: &InsertArgs,
    batch: &mut Batch<'_>,
    is_interrupted: &dyn Fn() -> bool,
    memory: &Memory,
    context: &mut Context<'_>,
) -> Result<()> {
    if let Some(read) = reader(args) {
        let source = context.read(path)?;
        let mut documents = read(&source).take_while(|_| !is_interrupted());
        batch.name = source.name().into();
        return documents.try_for_each(|read| {
            let (place, document) = read?;
            batch.add(document, place, memory, context)
        });
    }
    // The ids are printed while stdin is read: the two are apart from here on.
    let (name, mut input): (String, Box<dyn BufRead + '_>) = match path == Path::new("-") {
        true => ("<stdin>".to_owned(), Box::new(context.take_stdin()?)),
        false => {
            let name = path.display().to_string();
            let file = File::open(path).map_err(|error| unreadable(&name, &error))?;
            (name, Box::new(BufReader::new(file)))
        }
    };
    batch.name = name.as_str().into();
    for document in Reader::new(name, &mut input) {
        if is_interrupted() {
            break;
        }
        let (place, document) = document.map_err(of_other_type)?;
        batch.add(document, place, memory, context)?;
    }
    Ok(())
}

/// Reads the documents of a text, each with its place.
type ReadDocuments = for<'a> fn(&'a Source) -> Box<dyn Iterator<Item = Result<(Position, Document), Diagnostic>> + 'a>;

/// The reader of what is not JSON.
fn reader(args: &InsertArgs) -> Option<ReadDocuments> {
    let extension = args.file.as_ref().and_then(|path| path.extension()).and_then(|end| end.to_str());
    let named = match extension.map(str::to_ascii_lowercase).as_deref() {
        Some("yaml" | "yml") => Some(InputFormat::Yaml),
        Some("csv") => Some(InputFormat::Csv),
        Some("tsv") => Some(InputFormat::Tsv),
        _ => None,
    };
    Some(match args.kind.or(named)? {
        InputFormat::Json => return None,
        InputFormat::Yaml => |source| Box::new(yaml::documents(source)),
        InputFormat::Csv => |source| Box::new(rows(source, b',')),
        InputFormat::Tsv => |source| Box::new(rows(source, b'\t')),
    })
}

/// The documents of rows, which begin with their lines.
fn rows(source: &Source, delimiter: u8) -> impl Iterator<Item = Result<(Position, Document), Diagnostic>> {
    csv::documents(source, delimiter).map(|read| read.map(|(line, document)| ((line, 1), document)))
}

/// Whether a document is what a world file has: collections with their documents.
fn is_world(document: &Document) -> bool {
    let is_collection = |(name, value): (&String, &Bson)| {
        let documents = value.as_array().filter(|documents| !documents.is_empty());
        name.parse::<Namespace>().is_ok()
            && documents.is_some_and(|documents| documents.iter().all(|document| document.as_document().is_some()))
    };
    !document.is_empty() && document.iter().all(is_collection)
}

/// The error with how many documents were stored before it, behind the reason.
fn after(error: Error, stored: usize) -> Error {
    let before = match stored {
        0 => return error,
        1 => "1 document was stored before it".to_owned(),
        stored => format!("{stored} documents were stored before it"),
    };
    let reasons = error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
        "" => cause,
        text if text.contains(&cause) => text.to_owned(),
        text => format!("{text}: {cause}"),
    });
    error.context(format!("{reasons}\n  {before}"))
}

/// The error with the option for CSV or YAML, where the first line looks like it.
fn of_other_type(error: ReadError) -> ReadError {
    let ReadError::Text(error) = error else { return error };
    let line = error.excerpt().filter(|_| error.position().0 == 1).unwrap_or_default().trim_end();
    let is_key = |text: &str| {
        let text = text.trim().trim_matches('"');
        let is_literal = ["true", "false", "null", "none"].iter().any(|word| text.eq_ignore_ascii_case(word));
        !text.is_empty() && !is_literal && text.chars().all(|c| c.is_alphanumeric() || "_-.$".contains(c))
    };
    let are_keys = |sign: char| line.contains(sign) && line.split(sign).all(is_key);
    let is_mapping = || line.split_once(':').is_some_and(|(key, _)| is_key(key.trim_start_matches("- ")));
    let (name, kind) = match () {
        () if are_keys(',') => ("CSV", "csv"),
        () if line == "---" || is_mapping() => ("YAML", "yaml"),
        () => return error.into(),
    };
    error.without_hints().hint(format!("for {name}: --type {kind}, or --file with a name that ends in .{kind}")).into()
}

/// The documents that are read and not yet stored.
struct Batch<'a> {
    args: &'a InsertArgs,
    documents: Vec<Document>,
    /// The text that is read.
    name: Rc<str>,
    /// Where each of the documents is: the text, and the line and column in it.
    places: Vec<(Rc<str>, Position)>,
    began: Instant,
    size: usize,
    stored: usize,
    format: Format,
    /// The ids of stored documents, where they are printed as one array.
    ids: Vec<Bson>,
    /// Whether one of the documents looks like a world file.
    has_world: bool,
}

impl<'a> Batch<'a> {
    fn new(args: &'a InsertArgs, format: Format) -> Self {
        let name = ONLY_ARGUMENT.into();
        Self {
            args,
            documents: Vec::new(),
            name,
            places: Vec::new(),
            began: Instant::now(),
            size: 1,
            stored: 0,
            format,
            ids: Vec::new(),
            has_world: false,
        }
    }

    fn add(&mut self, document: Document, place: Position, memory: &Memory, context: &mut Context<'_>) -> Result<()> {
        if self.documents.is_empty() {
            self.began = Instant::now();
        }
        self.has_world |= is_world(&document);
        self.documents.push(shell::with_regexes(document));
        self.places.push((Rc::clone(&self.name), place));
        if self.documents.len() >= self.size || self.began.elapsed() > FLUSH_INTERVAL {
            self.size = (self.size * 2).min(LARGEST_BATCH);
            self.store(memory, context)?;
        }
        Ok(())
    }

    /// Stores the batch and prints the ids, also of those before a document that is refused.
    fn store(&mut self, memory: &Memory, context: &mut Context<'_>) -> Result<()> {
        if self.documents.is_empty() {
            return Ok(());
        }
        let places = std::mem::take(&mut self.places);
        let result = memory.insert(&self.args.namespace, std::mem::take(&mut self.documents));
        let ids = match &result {
            Ok(inserted) => inserted.ids.as_slice(),
            Err(error) => error.stored(),
        };
        self.stored += ids.len();
        match self.format {
            Format::Json => self.ids.extend(ids.iter().cloned()),
            Format::Canonical => context.output.progress_lines(ids.iter().map(shell::canonical_value))?,
            _ => context.output.progress_lines(ids.iter().map(shell::relaxed_value))?,
        }
        let before = self.stored - ids.len();
        let nth = ids.len();
        result.map(drop).map_err(|error| {
            let documents = &self.args.documents;
            let place = places.get(nth).map(|(name, at)| Location { name, at: *at, documents });
            match (&error, place) {
                (StoreError::Duplicate { .. }, Some(place)) => taken(error, &place, memory),
                (
                    StoreError::Query(_) | StoreError::Invalid(_) | StoreError::Stopped { document: Some(_), .. },
                    Some(place),
                ) if (error.fault() == Fault::Input || error.invalid().is_some()) && place.name != ONLY_ARGUMENT => {
                    refused(error, &place)
                }
                _ => blame(counted(error, before), &[]),
            }
        })
    }
}

/// The error for an argument that is not a document, with what to write for the name of a file, or for `key=value`.
fn hinted(error: Diagnostic, text: &str) -> Diagnostic {
    let ends = [".json", ".jsonl", ".ndjson", ".yaml", ".yml", ".csv", ".tsv"];
    if !text.contains('{') && (ends.iter().any(|end| text.ends_with(end)) || Path::new(text).is_file()) {
        return error.without_hints().hint(format!("--file {} reads the documents of a file", word(text)));
    }
    match in_braces(text, false) {
        Some(document) => error.without_hints().hint(format!("a document is written in braces: {document}")),
        None => error,
    }
}

/// Where a document is.
struct Location<'a> {
    /// The text.
    name: &'a str,
    /// The line and column there.
    at: Position,
    /// The documents on the command line.
    documents: &'a [String],
}

impl Location<'_> {
    /// A message at this place: `orders.jsonl:3:1: …` with the line where the text can be read again; the message alone for the
    /// only argument.
    fn mark(&self, message: &str) -> String {
        let (line, column) = self.at;
        if self.name == ONLY_ARGUMENT {
            return message.to_owned();
        }
        let Some(text) = self.line(line) else { return Diagnostic::at(self.name, line, column, message).to_string() };
        let start = text.char_indices().nth(column - 1).map_or(text.len(), |(at, _)| at);
        let source = Source::starting_at(self.name, text.as_str(), line);
        Diagnostic::new(&source, Span::at(start), message).to_string()
    }

    /// A line of the text, from 1; none where it cannot be read twice.
    fn line(&self, line: usize) -> Option<String> {
        let index = line.checked_sub(1)?;
        let argument = self.name.strip_prefix("<argument ").and_then(|rest| rest.strip_suffix('>'));
        if let Some(number) = argument.and_then(|number| number.parse::<usize>().ok()) {
            return self.documents.get(number.checked_sub(1)?)?.lines().nth(index).map(str::to_owned);
        }
        let path = Path::new(self.name);
        let file = path.is_file().then(|| File::open(path).ok()).flatten()?;
        BufReader::new(file).lines().nth(index)?.ok()
    }
}

/// The error for a unique key that is taken, with the place of the document that was to have it, and the one that has it.
fn taken(error: StoreError, place: &Location<'_>, memory: &Memory) -> Error {
    let holder = conflict::holder(&error, memory).as_ref().map(conflict::named).unwrap_or_default();
    let message = place.mark(&format!("{error}{holder}"));
    if message == error.to_string() {
        return error.into();
    }
    Error::from(error).context(message)
}

/// The error for a document that cannot be stored, with its place.
fn refused(error: StoreError, place: &Location<'_>) -> Error {
    let error = match error {
        StoreError::Stopped { source, .. } => *source,
        error => error,
    };
    let message = place.mark(&format!("the document cannot be stored: {error}"));
    Error::from(error).context(message)
}

/// The error with its document counted from the first of all batches.
fn counted(error: StoreError, before: usize) -> StoreError {
    match error {
        StoreError::Stopped { stored, document, source } => {
            StoreError::Stopped { stored, document: document.map(|nth| nth + before), source }
        }
        other => other,
    }
}
