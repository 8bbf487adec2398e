//! `rmem bench`: how fast the memory is here, and against a MongoDB server.

use std::path::PathBuf;

use bson::Document;
use clap::Args;

use super::context::memory_at;
use super::{Context, UsageError, formats};
use crate::bench::{Extent, Figure, OfMemory, Subject, computable, plots, run as measure};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::Memory;
use crate::memory::computables::Registry;
use crate::output::Format;
use crate::query::object_id;
use crate::store::Namespace;
use crate::views::pictures;

/// The formats: lines appear as they are measured.
const FORMATS: [Format; 3] = [Format::Jsonl, Format::Json, Format::Table];

/// What stands below the help of `bench`.
const HELP: &str = "\
Examples:
  rmem bench
  rmem bench --against mongodb://127.0.0.1:27017 --plot figures

Measures inserts, queries, updates and a computable of a robot that tidies up, without and with an index, on an \
embedded memory; with --against, also on a MongoDB server, through the driver alone (journaled writes) and through \
rmem. Prints medians in microseconds, the ratio of server to embedded memory, and the overhead of rmem on the server \
in percent. mongod evaluates $where for some 5,000 documents a second: 100,000 of them take minutes in all.";

/// Measure the speed of the memory
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&FORMATS))]
pub struct BenchArgs {
    /// Number of documents (can be repeated)
    #[arg(long, value_name = "N", default_values_t = [1_000, 10_000, 100_000], value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub documents: Vec<u32>,
    /// Number of repetitions of each operation
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub rounds: u32,
    /// MongoDB server to compare with; uses a temporary database rmem_bench_… there
    #[arg(long, value_name = "URI")]
    pub against: Option<String>,
    /// Draw the figures to DIR: figure-6-2.svg without an index, figure-6-3.svg with
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
}

pub(super) fn run(args: &BenchArgs, context: &mut Context<'_>) -> Result<Exit> {
    let extent = extent(args);
    let format = context.format(&FORMATS)?;
    if args.plot.is_some() {
        pictures::ready()?;
    }
    let folder = tempfile::tempdir_in(context.temporary()).context("a folder for the memory that is measured")?;
    let local = namespace("rmem_bench", "objects")?;
    let embedded = memory_at(&format!("file:{}", folder.path().join("bench.rmem").display()))?
        .with_computables(registry(&local, context)?);
    let server = args.against.as_deref().map(|uri| Server::open(uri, context)).transpose()?;
    let mut documents = Vec::new();
    let figures = {
        let local = OfMemory { name: "embedded", memory: &embedded, namespace: local };
        let mut subjects: Vec<&dyn Subject> = vec![&local];
        let over = server.as_ref().map(Server::over_server).transpose()?;
        #[cfg(feature = "mongodb")]
        subjects.extend(server.as_ref().map(|server| &server.raw as &dyn Subject));
        subjects.extend(over.as_ref().map(|over| over as &dyn Subject));
        let progress = context.output.progress("measuring");
        let measured = measure(&subjects, &extent, |figure| {
            progress.say(&format!("measuring, after {} of {} documents", figure.work.name(), figure.documents));
            print(figure, format, &mut documents, context)
        });
        drop(progress);
        if let Some(server) = &server {
            server.clean();
        }
        measured?
    };
    if format != Format::Jsonl {
        context.print_rows(documents.into_iter().map(Ok))?;
    }
    if let Some(folder) = &args.plot {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for drawn in plots(&figures)? {
            context.output.write_file(&folder.join(drawn.name), drawn.picture.svg().as_bytes())?;
        }
    }
    Ok(Exit::Done)
}

fn extent(args: &BenchArgs) -> Extent {
    let mut documents: Vec<usize> = args.documents.iter().map(|count| *count as usize).collect();
    documents.sort_unstable();
    documents.dedup();
    Extent { documents, rounds: args.rounds as usize }
}

/// Prints a figure at once, or keeps it for the table.
fn print(figure: &Figure, format: Format, documents: &mut Vec<Document>, context: &mut Context<'_>) -> Result<()> {
    if format != Format::Jsonl {
        documents.push(figure.document());
        return Ok(());
    }
    context.output.line(&shell::relaxed(&figure.document()))?;
    Ok(context.output.flush()?)
}

fn namespace(database: &str, collection: &str) -> Result<Namespace> {
    Ok(Namespace::parse(&format!("{database}.{collection}"))?)
}

/// The computables of a memory that is measured.
fn registry(namespace: &Namespace, context: &Context<'_>) -> Result<Registry> {
    Ok(Registry::new(vec![computable(namespace)], &context.host())?)
}

/// The server that is compared with: as rmem uses it, and as the driver alone does.
struct Server {
    memory: Memory,
    database: String,
    #[cfg(feature = "mongodb")]
    raw: crate::bench::Raw,
}

impl Server {
    fn open(uri: &str, context: &Context<'_>) -> Result<Self> {
        if !uri.starts_with("mongodb") {
            return Err(UsageError::new("--against takes a MongoDB server, like mongodb://127.0.0.1:27017").into());
        }
        let memory = memory_at(uri)?;
        // Fails within seconds where no server answers.
        memory.collections()?;
        let database = format!("rmem_bench_{}", object_id::new().to_hex());
        let memory = memory.with_computables(registry(&namespace(&database, "objects")?, context)?);
        Ok(Self {
            #[cfg(feature = "mongodb")]
            raw: crate::bench::Raw::open(uri, memory.describe(), &namespace(&database, "raw")?)?,
            memory,
            database,
        })
    }

    fn over_server(&self) -> Result<OfMemory<'_>> {
        let namespace = namespace(&self.database, "objects")?;
        Ok(OfMemory { name: "rmem_on_mongod", memory: &self.memory, namespace })
    }

    /// Removes what was stored on the server, as far as it still answers.
    fn clean(&self) {
        for collection in ["raw", "objects"] {
            if let Ok(namespace) = namespace(&self.database, collection) {
                let _ = self.memory.drop_collection(&namespace);
            }
        }
    }
}
