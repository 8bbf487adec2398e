//! The values that `distinct` lists: those of a field, array elements one by one.

use std::collections::BTreeMap;

use bson::{Bson, RawDocumentBuf};

use super::dollar::is_reference_key;
use super::error::QueryError;
use super::key;
use super::path::Path;
use super::view::View;

/// Returns the different values that a dotted path reaches in documents, in BSON order;
/// of an array, its elements. Of equal values (`1` and `1.0`) the first is given.
///
/// # Errors
/// The first error of the input, or where the path is not one.
pub fn distinct<E: From<QueryError>>(
    documents: impl Iterator<Item = Result<RawDocumentBuf, E>>,
    path: &str,
) -> Result<Vec<Bson>, E> {
    if path.contains('\0') {
        return Err(QueryError::invalid(31_032, "the key field cannot contain a NUL").into());
    }
    check(path).map_err(|error| error.about(path))?;
    let path = Path::parse(path)?;
    let mut values: BTreeMap<Vec<u8>, Bson> = BTreeMap::new();
    let mut add = |value: View<'_>| {
        let mut key = Vec::new();
        key::append(value, &mut key);
        values.entry(key).or_insert_with(|| value.to_bson());
    };
    for document in documents {
        path.any((&*document?).into(), false, &mut |value, _| {
            match value {
                Some(View::Array(items)) => items.iter().for_each(&mut add),
                Some(value) => add(value),
                None => {}
            }
            false
        });
    }
    Ok(values.into_values().collect())
}

/// Refuses paths with invalid names.
fn check(path: &str) -> Result<(), QueryError> {
    if path.is_empty() {
        return Err(QueryError::invalid(40_352, "the path of a field cannot be empty"));
    }
    if path.ends_with('.') {
        return Err(QueryError::invalid(40_353, format!("the path {path} may not end with a '.'")));
    }
    for part in path.split('.') {
        if part.is_empty() {
            return Err(QueryError::invalid(15_998, format!("the path {path} may not have empty parts")));
        }
        if part.starts_with('$') && !is_reference_key(part) {
            return Err(QueryError::invalid(16_410, format!("the name {part} may not start with '$'")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    #[test]
    fn refuses_what_is_no_path() {
        for (path, code) in [("", 40_352), ("v.", 40_353), (".v", 15_998), ("v..a", 15_998), ("$v", 16_410)] {
            let documents = std::iter::empty::<Result<RawDocumentBuf, QueryError>>();
            assert_eq!(distinct(documents, path).unwrap_err().code, code, "{path}");
        }
    }

    #[test]
    fn lists_elements_of_arrays_in_order_once() {
        let documents = [rawdoc! {"a": [3, 1]}, rawdoc! {"a": 2.0}, rawdoc! {"b": 1}, rawdoc! {"a": [2, [1]]}];
        let values = distinct(documents.into_iter().map(Ok::<_, QueryError>), "a").unwrap();
        let wanted = vec![Bson::Int32(1), Bson::Double(2.0), Bson::Int32(3), Bson::Array(vec![Bson::Int32(1)])];
        assert_eq!(values, wanted);
    }
}
