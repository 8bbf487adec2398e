//! The deftemplates and global variables of `--deftemplates`.

use std::path::PathBuf;

use crate::clips::facts::Schema;
use crate::commands::Context;
use crate::error::Result;
use crate::formats::clips::{Item, Reader};

/// Reads the deftemplates and defglobals of files; facts in them are skipped.
pub(super) fn read(paths: &[PathBuf], context: &mut Context<'_>) -> Result<Schema> {
    let mut schema = Schema::default();
    for path in paths {
        let source = context.read(path)?;
        let mut reader = Reader::of_templates(&source).with_globals(schema.globals.clone());
        for item in reader.by_ref() {
            if let Item::Template(template) = item? {
                schema.add(template);
            }
        }
        schema.globals = reader.into_globals();
    }
    Ok(schema)
}
