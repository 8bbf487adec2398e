//! `rmem clips export [NS [QUERY]]`: documents as CLIPS facts.

use std::path::{Path, PathBuf};

use bson::Document;
use clap::{Args, ValueEnum};

use super::schema;
use crate::clips::facts::{Exporter, FactError, Nested, loadable};
use crate::commands::query::{argument, blame, owned};
use crate::commands::{Context, UsageError, WrongInput, formats, missing};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::clips::{Fact, is_symbol, write_fact, write_operand, write_remark, write_value};
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::store::{Find, Namespace};

/// What stands below the help of `clips export`.
const HELP: &str = "\
Examples:
  rmem clips export robmem.worldmodel \"{relation: 'on'}\" > facts.txt
  rmem clips export --deftemplates templates.clp --as deffacts world -o world.clp

Forms: facts is for (load-facts), deffacts NAME for (load), assert for (batch).";

/// Write documents as CLIPS facts
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::FACTS))]
pub struct ExportArgs {
    /// Collection, as DATABASE.COLLECTION (default: --collection)
    #[arg(value_name = "NS")]
    pub namespace: Option<String>,
    /// Query that selects documents (default: all documents)
    #[arg(value_name = "QUERY")]
    pub query: Option<String>,
    /// Read documents from a file instead of the memory; - is stdin
    #[arg(long, value_name = "FILE", conflicts_with = "namespace")]
    pub from: Option<PathBuf>,
    /// File with deftemplates, which decide the types of slots (can be repeated)
    #[arg(long, value_name = "FILE")]
    pub deftemplates: Vec<PathBuf>,
    /// Form of the facts: facts, deffacts NAME, or assert (default: facts)
    #[arg(long = "as", value_name = "FORM", num_args = 1..=2, default_value = "facts", hide_default_value = true)]
    pub form: Vec<String>,
    /// Treatment of nested documents: refuse, flatten (join keys with _), json (write a string)
    #[arg(long, value_name = "HOW", default_value = "refuse", hide_possible_values = true)]
    pub nested: NestedValues,
    /// Fail if a document has no deftemplate
    #[arg(long)]
    pub strict: bool,
    /// Leave out documents that no fact can hold, with a warning for each
    #[arg(long)]
    pub skip_invalid: bool,
    /// File to write; - is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
}

/// How many documents that are left out have a warning of their own.
const WARNED: usize = 20;

/// What becomes of values that no slot of a fact can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum NestedValues {
    /// They are errors.
    #[default]
    Refuse,
    /// Keys are joined with `_`.
    Flatten,
    /// They are written as JSON, in a string.
    Json,
}

pub(super) fn run(args: &ExportArgs, context: &mut Context<'_>) -> Result<Exit> {
    let (form, arguments) = Form::of(args)?;
    let schema = schema::read(&args.deftemplates, context)?;
    let nested = match args.nested {
        NestedValues::Refuse => Nested::Refuse,
        NestedValues::Flatten => Nested::Flatten,
        NestedValues::Json => Nested::Json,
    };
    let mut facts = Facts {
        exporter: Exporter { schema: &schema, nested, strict: args.strict },
        text: form.opening(),
        form,
        skips_invalid: args.skip_invalid,
        written: 0,
        left_out: 0,
    };
    match &args.from {
        None => facts.add_collection(&arguments, context)?,
        Some(path) if arguments.is_empty() => facts.add_file(path, context)?,
        Some(_) => {
            return Err(UsageError::new("documents come from --from or from a namespace, not from both").into());
        }
    }
    context.output.write_file(&args.output, facts.closed().as_bytes())?;
    schema.respelled.take().iter().for_each(|name| context.output.note(name));
    context.output.note(&facts.summary());
    Ok(Exit::Done)
}

/// The facts that are written.
struct Facts<'a> {
    exporter: Exporter<'a>,
    form: Form<'a>,
    text: String,
    /// Whether documents that no fact can hold are left out, and no error.
    skips_invalid: bool,
    written: usize,
    left_out: usize,
}

impl Facts<'_> {
    /// Adds the documents of a file.
    fn add_file(&mut self, path: &Path, context: &mut Context<'_>) -> Result<()> {
        let source = context.read(path)?;
        for (span, document) in shell::parse_documents(&source)? {
            self.add(&document, context, |error| complain(&source, span, error).into())?;
        }
        Ok(())
    }

    /// Adds the documents of a collection: `[NS [QUERY]]`.
    fn add_collection(&mut self, arguments: &[&str], context: &mut Context<'_>) -> Result<()> {
        let namespace = match arguments.first() {
            Some(name) => name.parse()?,
            None => context.settings.collection.value.clone(),
        };
        let query = arguments.get(1).copied();
        let filter = query.map(|query| argument("<query>", query)).transpose()?.unwrap_or_default();
        let texts = query.map(|query| ("<query>", query));
        let shown = |error| blame(error, texts.as_slice());
        let memory = context.memory()?;
        let found = memory.find_with_metadata(&namespace, &Find { filter, ..Find::default() });
        for document in found.map_err(shown)? {
            let document = document.and_then(owned).map_err(shown)?;
            self.add(&document, context, |error| refuse(&namespace, &document, error).into())?;
        }
        if self.written + self.left_out == 0 {
            missing::warn(&namespace, &memory, context);
        }
        Ok(())
    }

    /// Adds the fact of a document; `explain` gives the error where no fact can hold it.
    fn add(
        &mut self,
        document: &Document,
        context: &mut Context<'_>,
        explain: impl FnOnce(&FactError) -> Error,
    ) -> Result<()> {
        match self.form.fact(&self.exporter, document) {
            Ok(fact) => {
                self.form.write(&fact, &mut self.text);
                self.written += 1;
            }
            Err(error) if self.skips_invalid => {
                self.left_out += 1;
                if self.left_out <= WARNED {
                    context.output.warn(&explain(&error).to_string());
                }
            }
            Err(error) => return Err(explain(&error)),
        }
        Ok(())
    }

    /// The whole text.
    fn closed(&mut self) -> &str {
        self.text.push_str(self.form.closing());
        &self.text
    }

    /// How many facts were written, and how many documents left out.
    fn summary(&self) -> String {
        let left_out = match self.left_out {
            0 => String::new(),
            count => format!("; {count} {} left out", plural(count, "document was", "documents were")),
        };
        format!("{} {}{left_out}", self.written, plural(self.written, "fact", "facts"))
    }
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
    fn of(args: &'a ExportArgs) -> Result<(Self, Vec<&'a str>), UsageError> {
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

    /// The fact of a document, if this form can have it.
    fn fact(&self, exporter: &Exporter<'_>, document: &Document) -> Result<Fact, FactError> {
        let fact = exporter.fact(document)?;
        match self {
            Self::Facts => loadable(&fact).map(|()| fact),
            Self::Deffacts(_) | Self::Assert => Ok(fact),
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
    match error.hint() {
        Some(hint) => complaint.hint(hint),
        None => complaint,
    }
}

fn refuse(namespace: &Namespace, document: &Document, error: &FactError) -> WrongInput {
    let id = document.get("_id").map(shell::relaxed_value).unwrap_or_default();
    let hint = error.hint().map(|hint| format!("\n  = hint: {hint}")).unwrap_or_default();
    WrongInput::new(format!("{namespace}, document {id}: {error}{hint}"))
}

fn plural(count: usize, one: &'static str, many: &'static str) -> &'static str {
    if count == 1 { one } else { many }
}
