//! The deftemplates of `--deftemplates`.

use std::path::PathBuf;

use crate::clips::facts::Schema;
use crate::commands::Context;
use crate::error::Result;
use crate::formats::clips::{Item, Reader};

/// Reads the deftemplates of files; facts in them are skipped.
pub(super) fn read(paths: &[PathBuf], context: &mut Context<'_>) -> Result<Schema> {
    let mut schema = Schema::default();
    for path in paths {
        let source = context.read(path)?;
        for item in Reader::of_templates(&source) {
            if let Item::Template(template) = item? {
                schema.add(template);
            }
        }
    }
    Ok(schema)
}
