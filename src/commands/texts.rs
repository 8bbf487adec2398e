//! `-` in the place of a query, an update or a pipeline: the text is read from stdin.

use std::path::Path;

use super::{Context, UsageError};
use crate::error::Result;

/// What stands for stdin.
const DASH: &str = "-";

/// Puts what stdin has in the place of the text that is `-`.
///
/// # Errors
/// Where two texts are, or stdin cannot be read.
pub(super) fn read(texts: Vec<&mut String>, context: &mut Context<'_>) -> Result<()> {
    let mut given: Vec<&mut String> = texts.into_iter().filter(|text| *text == DASH).collect();
    match given.as_mut_slice() {
        [] => {}
        [text] => context.read(Path::new(DASH))?.text().trim_end().clone_into(text),
        _ => return Err(UsageError::new("stdin can be read only once; expected `-` for one text at most").into()),
    }
    Ok(())
}
