//! The values of a field, array elements one by one: what `distinct` lists.

use bson::{Bson, RawDocument};

use super::error::{QueryError, Result};
use super::path::Path;
use super::view::View;

/// Shows every value that a dotted path reaches in a document: of an array, its elements.
///
/// # Errors
/// Where the path is not one.
pub fn distinct(document: &RawDocument, path: &str, show: &mut dyn FnMut(Bson)) -> Result<()> {
    if path.contains('\0') {
        return Err(QueryError::invalid(31_032, "the key field cannot contain a NUL"));
    }
    let path = Path::parse(path)?;
    path.any(document.into(), false, &mut |value, _| {
        match value {
            Some(View::Array(items)) => items.iter().for_each(|item| show(item.to_bson())),
            Some(value) => show(value.to_bson()),
            None => {}
        }
        false
    });
    Ok(())
}
