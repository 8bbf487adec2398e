//! `rmem query NS [QUERY]`: the documents that match.

use super::Context;
use crate::cli::Query;
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::store::{Find, StoreError};

pub(super) fn run(args: &Query, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let find = Find {
        filter: argument("<query>", &args.query)?,
        sort: args.sort.as_deref().map(|text| argument("<sort>", text)).transpose()?.unwrap_or_default(),
        projection: args.fields.as_deref().map(|text| argument("<fields>", text)).transpose()?.unwrap_or_default(),
        skip: args.skip,
        limit: args.limit,
    };
    let texts = [
        ("<query>", args.query.as_str()),
        ("<sort>", args.sort.as_deref().unwrap_or_default()),
        ("<fields>", args.fields.as_deref().unwrap_or_default()),
    ];
    let given: Vec<_> = texts.into_iter().filter(|(_, text)| !text.is_empty() && *text != "{}").collect();
    let memory = context.memory()?;
    if args.explain {
        let account = memory.explain(&args.namespace, &find).map_err(|error| blame(error, &given))?;
        context.print_documents([Ok(account)].into_iter())?;
        return Ok(Exit::Done);
    }
    let documents = match args.meta {
        true => memory.find_with_metadata(&args.namespace, &find),
        false => memory.find(&args.namespace, &find),
    };
    let documents = documents.map_err(|error| blame(error, &given))?;
    context
        .print_documents(documents.map(|document| document.and_then(owned).map_err(|error| blame(error, &given))))?;
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

/// A complaint of a store about a query, shown at the operator or field it is about
/// in the first of the texts that has it; the kind of any other error stays.
pub(super) fn blame(error: StoreError, texts: &[(&'static str, &str)]) -> anyhow::Error {
    let StoreError::Query(query) = &error else { return error.into() };
    let place = query
        .operators()
        .find_map(|word| texts.iter().find_map(|(name, text)| Some((*name, *text, text.find(word)?, word.len()))));
    match (place, texts) {
        (Some((name, text, start, length)), _) => {
            let source = Source::new(name, text);
            Diagnostic::new(&source, Span::new(start, start + length), query.message.clone()).into()
        }
        (None, [(name, text)]) => {
            let source = Source::new(*name, *text);
            Diagnostic::new(&source, Span::new(0, text.len()), query.message.clone()).into()
        }
        _ => error.into(),
    }
}
