//! `rmem update NS QUERY UPDATE`: change documents.

use bson::{Bson, Document};
use clap::Args;

use super::Context;
use super::query::{argument, blame};
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::store::{Namespace, UpdateRequest, UpdateSpec};

/// Change documents: operators, a replacement, or a pipeline
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  rmem update robmem.worldmodel \"{object: 'A'}\" \"{\\$set: {color: 'red'}}\" --many"
)]
pub struct UpdateArgs {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents
    #[arg(value_name = "QUERY")]
    pub query: String,
    /// Operators, a replacement, or a pipeline
    #[arg(value_name = "UPDATE")]
    pub update: String,
    /// All matches, not only the first
    #[arg(long)]
    pub many: bool,
    /// Insert where nothing matches
    #[arg(long)]
    pub upsert: bool,
    /// What `$[identifier]` stands for (can be repeated)
    #[arg(long = "array-filter", value_name = "QUERY")]
    pub array_filters: Vec<String>,
}

pub(super) fn run(args: &UpdateArgs, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let request = UpdateRequest {
        filter: argument("<query>", &args.query)?,
        update: specification(&Source::new("<update>", args.update.as_str()))?,
        array_filters: args
            .array_filters
            .iter()
            .map(|text| argument("<array-filter>", text))
            .collect::<Result<_, _>>()?,
        many: args.many,
        upsert: args.upsert,
    };
    let updated = context.memory()?.update(&args.namespace, &request);
    let updated = updated.map_err(|error| blame(error, &[("<update>", &args.update), ("<query>", &args.query)]))?;
    let mut result = bson::doc! { "matched": count(updated.matched), "modified": count(updated.modified) };
    if let Some(id) = updated.upserted {
        result.insert("upserted", id);
    }
    context.output.line(&shell::relaxed(&result))?;
    Ok(Exit::Done)
}

/// An update is a document, or a pipeline in brackets.
fn specification(source: &Source) -> Result<UpdateSpec, Diagnostic> {
    match shell::parse_value(source)? {
        Bson::Document(document) => Ok(UpdateSpec::Document(document)),
        Bson::Array(stages) => {
            let stages: Option<Vec<Document>> = stages
                .into_iter()
                .map(|stage| match stage {
                    Bson::Document(stage) => Some(stage),
                    _ => None,
                })
                .collect();
            let whole = Span::new(0, source.text().len());
            stages
                .map(UpdateSpec::Pipeline)
                .ok_or_else(|| Diagnostic::new(source, whole, "expected an array of stages"))
        }
        _ => {
            Err(Diagnostic::new(source, Span::new(0, source.text().len()), "expected a document or an array of stages")
                .hint("like {$set: {color: 'red'}}"))
        }
    }
}

fn count(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}
