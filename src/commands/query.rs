//! `rmem query NS [QUERY]`: the documents that match.

use super::Context;
use crate::cli::Query;
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, shell};
use crate::store::{Find, StoreError};

pub(super) fn run(args: &Query, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let find = Find {
        filter: argument("<query>", &args.query)?,
        sort: args.sort.as_deref().map(|text| argument("<sort>", text)).transpose()?.unwrap_or_default(),
        projection: args.fields.as_deref().map(|text| argument("<fields>", text)).transpose()?.unwrap_or_default(),
        skip: args.skip,
        limit: args.limit,
    };
    let memory = context.memory()?;
    let documents = match args.meta {
        true => memory.find_with_metadata(&args.namespace, &find)?,
        false => memory.find(&args.namespace, &find)?,
    };
    context.print_documents(documents.map(|document| document.and_then(owned)))?;
    Ok(Exit::Done)
}

/// A document given on the command line; `name` is what messages call it.
pub(super) fn argument(name: &'static str, text: &str) -> Result<bson::Document, Diagnostic> {
    shell::parse_document(&Source::new(name, text))
}

/// Decodes a document of a store.
pub(super) fn owned(document: bson::RawDocumentBuf) -> Result<bson::Document, StoreError> {
    bson::Document::try_from(document.as_ref())
        .map_err(|error| StoreError::Failed { address: "a document of the store".into(), reason: error.to_string() })
}
