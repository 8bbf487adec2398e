//! The deftemplates and global variables of `--deftemplates`.

use std::path::PathBuf;

use crate::clips::facts::Schema;
use crate::commands::{Context, WrongInput};
use crate::error::Result;
use crate::formats::clips::{Item, Reader};

/// Reads the deftemplates and defglobals of files; facts in them are skipped.
pub(super) fn read(paths: &[PathBuf], context: &mut Context<'_>) -> Result<Schema> {
    let mut schema = Schema::default();
    for path in paths {
        let source = context.read_clips(path)?;
        let mut reader = Reader::of_templates(&source).with_globals(schema.globals.clone());
        let mut is_used = false;
        for item in reader.by_ref() {
            match item? {
                Item::Template(template) => {
                    schema.add(template);
                    is_used = true;
                }
                Item::Skipped { kind, .. } => is_used |= kind == "defglobal",
                Item::Fact(_) => {}
            }
        }
        if !is_used {
            return Err(WrongInput::new(format!("--deftemplates: {} has no deftemplate", source.name())).into());
        }
        schema.globals = reader.into_globals();
    }
    Ok(schema)
}
