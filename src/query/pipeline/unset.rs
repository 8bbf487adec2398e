//! `$unset` of fields at the top of documents: their bytes are left out, and nothing is decoded.

use bson::{Bson, RawDocumentBuf};

use crate::query::error::Result;

/// Returns the names of the fields where none is a path into another.
pub(super) fn plain_names(argument: &Bson) -> Option<Vec<String>> {
    let name = |path: &Bson| path.as_str().filter(|path| !path.contains('.')).map(str::to_owned);
    match argument {
        Bson::Array(paths) => paths.iter().map(name).collect(),
        path => name(path).map(|name| vec![name]),
    }
}

/// Returns a document without the fields of these names.
pub(super) fn without(document: RawDocumentBuf, names: &[String]) -> Result<RawDocumentBuf> {
    let bytes = document.as_bytes();
    let (mut kept, mut start, mut copied) = (Vec::new(), 4, 0);
    for element in document.iter_elements() {
        let element = element?;
        let key = element.key().as_str();
        let end = start + 1 + key.len() + 1 + element.size();
        if names.iter().any(|name| name == key) {
            if kept.is_empty() {
                kept.reserve(bytes.len());
            }
            kept.extend_from_slice(bytes.get(copied..start).unwrap_or_default());
            copied = end;
        }
        start = end;
    }
    if copied == 0 {
        return Ok(document);
    }
    kept.extend_from_slice(bytes.get(copied..).unwrap_or_default());
    let size = i32::try_from(kept.len()).unwrap_or(i32::MAX).to_le_bytes();
    kept.iter_mut().zip(size).for_each(|(byte, of_size)| *byte = of_size);
    Ok(RawDocumentBuf::from_bytes(kept)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Document, doc};

    #[test]
    fn fields_are_left_out_wherever_they_stand() {
        let whole = doc! { "a": 1, "b": { "a": [1, "x"] }, "c": "text", "d": bson::Bson::Null };
        let raw = RawDocumentBuf::try_from(&whole).unwrap();
        for names in [vec!["a"], vec!["b", "d"], vec!["c", "a"], vec!["x"], vec!["a", "b", "c", "d"]] {
            let expected = whole.iter().filter(|(key, _)| !names.contains(&key.as_str()));
            let expected: Document = expected.map(|(key, value)| (key.clone(), value.clone())).collect();
            let names: Vec<String> = names.into_iter().map(str::to_owned).collect();
            assert_eq!(without(raw.clone(), &names).unwrap(), RawDocumentBuf::try_from(&expected).unwrap());
        }
    }

    #[test]
    fn a_path_is_no_plain_name() {
        assert_eq!(plain_names(&"a".into()), Some(vec!["a".to_owned()]));
        assert_eq!(plain_names(&bson::bson!(["a", "b"])), Some(vec!["a".to_owned(), "b".to_owned()]));
        assert_eq!(plain_names(&bson::bson!(["a", "b.c"])), None);
    }
}
