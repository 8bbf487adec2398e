//! `rmem scene check`: objects that overlap, or are too close.

use std::path::Path;

use bson::doc;
use clap::Args;

use super::selection::{Selection, not_negative};
use crate::commands::Context;
use crate::error::Result;
use crate::exit::Exit;
use crate::scene::Invalid;
use crate::scene::check::check;
use crate::scene::mesh::Meshes;

const HELP: &str = "\
Examples:
  rmem scene check robmem.objects --frame map
  rmem scene check robmem.objects --frame map --distance 0.02

Prints a document for each pair of objects that overlap, or are closer than --distance: {first, second,
distance, depth}, nearest first. Exits with 1 if there are any. An overlap below
a micrometre is contact, as of a cup on a table. Meshes are checked by their convex hulls; a plane is
solid below. An attached object may touch the links of its key `touch`.";

/// Find objects that overlap or are too close
#[derive(Debug, Args)]
#[command(after_help = HELP)]
#[command(arg = crate::commands::formats::argument(&crate::commands::formats::DOCUMENTS))]
pub struct CheckArgs {
    #[command(flatten)]
    pub(super) selection: Selection,
    /// Least distance between objects, in metres (default: 0)
    #[arg(long, value_name = "METRES", default_value_t = 0.0, hide_default_value = true)]
    #[arg(allow_negative_numbers = true, value_parser = not_negative)]
    distance: f64,
}

pub(super) fn run(args: &CheckArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let mut found = args.selection.objects(&memory, context)?;
    let mut meshes = Meshes::in_folder(Path::new(""));
    for located in &mut found.objects {
        if let Err(reason) = meshes.load(&mut located.object) {
            let (namespace, id) = (located.namespace.clone(), located.id.clone());
            found.invalid.push(Invalid { namespace, id, reason: reason.into() });
        }
    }
    let found = args.selection.more.accept(found, context)?;
    let scene = found.scene(&args.selection.frame);
    let pairs = check(&scene, args.distance);
    let documents = pairs.iter().map(|pair| {
        let mut written = doc! { "first": pair.first, "second": pair.second, "distance": pair.distance + 0.0 };
        if pair.distance < 0.0 {
            written.insert("depth", -pair.distance);
        }
        Ok(written)
    });
    context.print_documents(documents)?;
    Ok(if pairs.is_empty() { Exit::Done } else { Exit::No })
}
