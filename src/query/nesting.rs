//! The limit of nesting, which bounds every recursion over values.

use bson::raw::RawIter;
use bson::spec::ElementType;
use bson::{RawBsonRef, RawDocument};

use super::error::{QueryError, Result};

/// The most levels of a document, as in MongoDB.
pub(super) const MAX_DEPTH: usize = 200;

/// Refuses invalid BSON and documents nested deeper than 200 levels.
///
/// Documents from outside must pass this check first: every other function of this module recurses over values.
///
/// # Errors
/// If the bytes are invalid or nested too deeply.
pub fn check(document: &RawDocument) -> Result<()> {
    let mut levels: Vec<RawIter<'_>> = vec![document.iter_elements()];
    while let Some(level) = levels.last_mut() {
        let Some(element) = level.next() else {
            levels.pop();
            continue;
        };
        let element = element?;
        let inner = match (element.element_type(), element.value()?) {
            (ElementType::EmbeddedDocument, RawBsonRef::Document(inner)) => inner.iter_elements(),
            (ElementType::Array, RawBsonRef::Array(inner)) => inner.iter_elements(),
            (_, RawBsonRef::JavaScriptCodeWithScope(code)) => code.scope.iter_elements(),
            _ => continue,
        };
        if levels.len() >= MAX_DEPTH {
            return Err(QueryError::invalid(15, "a document may not be nested deeper than 200 levels"));
        }
        levels.push(inner);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a document of so many levels, made without recursion.
    fn nested(levels: usize) -> Vec<u8> {
        let mut bytes = vec![5, 0, 0, 0, 0];
        for _ in 1..levels {
            let mut outer = Vec::with_capacity(bytes.len() + 8);
            outer.extend_from_slice(&i32::try_from(bytes.len() + 8).unwrap().to_le_bytes());
            outer.extend_from_slice(&[3, b'a', 0]);
            outer.extend_from_slice(&bytes);
            outer.push(0);
            bytes = outer;
        }
        bytes
    }

    #[test]
    fn refuses_what_is_nested_too_deeply_without_running_out_of_stack() {
        assert!(check(RawDocument::from_bytes(&nested(200)).unwrap()).is_ok());
        assert!(check(RawDocument::from_bytes(&nested(201)).unwrap()).is_err());
        assert!(check(RawDocument::from_bytes(&nested(20_000)).unwrap()).is_err());
    }
}
