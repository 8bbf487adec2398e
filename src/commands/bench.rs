//! `rmem bench`: how fast the memory is here, and against a MongoDB server.

use anyhow::Context as _;
use bson::Document;
use bson::oid::ObjectId;

use super::context::memory_at;
use super::{Context, UsageError};
use crate::bench::{Extent, Figure, OfMemory, Subject, plot, run as measure};
use crate::cli::Bench;
use crate::exit::Exit;
use crate::formats::shell;
use crate::memory::Memory;
use crate::output::Format;
use crate::store::Namespace;

pub(super) fn run(args: &Bench, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let extent = extent(args);
    let format = context.format(&[Format::Jsonl, Format::Table])?;
    let folder = tempfile::tempdir().context("a folder for the memory that is measured")?;
    let embedded = memory_at(&format!("file:{}", folder.path().join("bench.rmem").display()))?;
    let server = args.against.as_deref().map(Server::open).transpose()?;
    let mut documents = Vec::new();
    let figures = {
        let local = OfMemory { name: "embedded", memory: &embedded, namespace: namespace("rmem_bench", "objects")? };
        let mut subjects: Vec<&dyn Subject> = vec![&local];
        let over = server.as_ref().map(Server::over_server).transpose()?;
        #[cfg(feature = "mongodb")]
        subjects.extend(server.as_ref().map(|server| &server.raw as &dyn Subject));
        subjects.extend(over.as_ref().map(|over| over as &dyn Subject));
        let measured = measure(&subjects, &extent, |figure| tell(figure, format, &mut documents, context));
        if let Some(server) = &server {
            server.clean();
        }
        measured?
    };
    if format == Format::Table {
        context.print_documents(documents.into_iter().map(Ok))?;
    }
    if let Some(folder) = &args.plot {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        context.output.write_file(&folder.join("memory.svg"), plot(&figures).as_bytes())?;
    }
    Ok(Exit::Done)
}

fn extent(args: &Bench) -> Extent {
    let mut documents: Vec<usize> = args.documents.iter().map(|count| *count as usize).collect();
    documents.sort_unstable();
    documents.dedup();
    Extent { documents, rounds: args.rounds as usize }
}

/// Prints a figure at once, or keeps it for the table.
fn tell(
    figure: &Figure,
    format: Format,
    documents: &mut Vec<Document>,
    context: &mut Context<'_>,
) -> anyhow::Result<()> {
    if format == Format::Table {
        documents.push(figure.document());
        return Ok(());
    }
    context.output.line(&shell::relaxed(&figure.document()))?;
    Ok(context.output.flush()?)
}

fn namespace(database: &str, collection: &str) -> anyhow::Result<Namespace> {
    Ok(Namespace::parse(&format!("{database}.{collection}"))?)
}

/// The server that is compared with: as rmem uses it, and as the driver alone does.
struct Server {
    memory: Memory,
    database: String,
    #[cfg(feature = "mongodb")]
    raw: crate::bench::Raw,
}

impl Server {
    fn open(uri: &str) -> anyhow::Result<Self> {
        if !uri.starts_with("mongodb") {
            return Err(UsageError::new("--against takes a MongoDB server, like mongodb://127.0.0.1:27017").into());
        }
        let memory = memory_at(uri)?;
        // Fails within seconds where nobody answers.
        memory.collections()?;
        let database = format!("rmem_bench_{}", ObjectId::new().to_hex());
        Ok(Self {
            #[cfg(feature = "mongodb")]
            raw: crate::bench::Raw::open(uri, memory.describe(), &namespace(&database, "raw")?)?,
            memory,
            database,
        })
    }

    fn over_server(&self) -> anyhow::Result<OfMemory<'_>> {
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
