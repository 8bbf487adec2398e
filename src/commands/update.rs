//! `rmem update NS QUERY UPDATE`: change documents.

use bson::{Bson, Document};

use super::Context;
use super::query::{argument, blame};
use crate::cli::Update;
use crate::exit::Exit;
use crate::formats::{Diagnostic, Source, Span, shell};
use crate::store::{UpdateRequest, UpdateSpec};

pub(super) fn run(args: &Update, context: &mut Context<'_>) -> anyhow::Result<Exit> {
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
