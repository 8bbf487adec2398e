//! `rmem schema NS [QUERY]`: what fields documents have.

use clap::Args;

use super::query::{blame, filter_of, owned};
use super::{Context, formats, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::output::amount;
use crate::store::{Find, Namespace};
use crate::views::schema::Schema;

/// Describe the fields of documents: types, counts, values
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem schema robmem.worldmodel --format table\n\n\
Prints a document for each field, those of documents in documents with dots between: {field, documents, share,\n\
types, distinct, least, greatest, frequent}. Types are those of MongoDB's $type; share is the part of\n\
the documents that have the field; frequent are the three most frequent values, if any occurs twice.\n\
At most 10000 different values are counted.")]
#[command(arg = formats::argument(&formats::DOCUMENTS))]
pub struct SchemaArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
}

pub(super) fn run(args: &SchemaArgs, context: &mut Context<'_>) -> Result<Exit> {
    let given = [("<query>", args.query.as_str())];
    let find = Find { filter: filter_of(&args.namespace, &args.query)?, ..Find::default() };
    let memory = context.memory()?;
    let mut schema = Schema::default();
    for document in memory.find(&args.namespace, &find).map_err(|error| blame(error, &given))? {
        schema.add(&document.and_then(owned).map_err(|error| blame(error, &given))?);
    }
    context.output.note(&format!("{} of {}", amount(schema.documents(), "document"), args.namespace));
    context.print_rows(schema.describe().into_iter().map(Ok))?;
    if schema.documents() == 0 {
        missing::warn(&args.namespace, &memory, context);
    }
    Ok(Exit::Done)
}
