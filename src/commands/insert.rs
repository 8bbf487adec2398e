//! `rmem insert NS [DOC…|--file F|-]`: store documents; print their ids.

use std::path::Path;

use anyhow::Context as _;

use super::Context;
use crate::cli::Insert;
use crate::exit::Exit;
use crate::formats::{Source, shell};
use crate::store::StoreError;

/// How many documents are stored, and acknowledged, at once.
const BATCH: usize = 1_000;

pub(super) fn run(args: &Insert, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let memory = context.memory()?;
    let mut documents = Vec::new();
    for text in &args.documents {
        let source = if text == "-" { context.read(Path::new("-"))? } else { Source::new("<argument>", text.as_str()) };
        documents.extend(shell::parse_documents(&source)?.into_iter().map(|(_, document)| document));
    }
    if args.documents.is_empty() {
        let source = context.read(args.file.as_deref().unwrap_or(Path::new("-")))?;
        documents.extend(shell::parse_documents(&source)?.into_iter().map(|(_, document)| document));
    }
    let total = documents.len();
    let mut stored = 0;
    while !documents.is_empty() {
        let rest = documents.split_off(documents.len().min(BATCH));
        let result = memory.insert(&args.namespace, std::mem::replace(&mut documents, rest));
        let ids = match &result {
            Ok(inserted) => inserted.ids.as_slice(),
            Err(error) => error.stored(),
        };
        for id in ids {
            context.output.line(&shell::relaxed_value(id))?;
        }
        let (before, now) = (stored, ids.len());
        stored += now;
        let result = result.map_err(|error| counted(error, before));
        result.with_context(|| format!("stored {stored} of {total} documents; the next one was refused"))?;
    }
    context.output.note(&format!("{stored} stored in {}", args.namespace));
    Ok(Exit::Done)
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
