//! What the store needs of the query language.

use bson::{Bson, Document, RawBsonRef, RawDocument};

use crate::query::QueryError;

/// A filter, understood.
pub(super) struct Filter {
    fields: Document,
}

impl Filter {
    pub(super) fn parse(filter: &Document) -> Result<Self, QueryError> {
        let plain = |value: &Bson| !matches!(value, Bson::Document(_) | Bson::Array(_) | Bson::RegularExpression(_));
        match filter.iter().find(|(key, value)| key.starts_with('$') || key.contains('.') || !plain(value)) {
            Some((key, _)) => Err(QueryError::unsupported(key)),
            None => Ok(Self { fields: filter.clone() }),
        }
    }

    pub(super) fn matches(&self, document: &RawDocument) -> bool {
        self.fields.iter().all(|(key, wanted)| match document.get(key) {
            Ok(Some(value)) => Bson::try_from(value).is_ok_and(|value| value == *wanted),
            Ok(None) => *wanted == Bson::Null,
            Err(_) => false,
        })
    }
}

/// Bytes that are equal where values are.
pub(super) fn encode(value: RawBsonRef<'_>) -> Vec<u8> {
    let mut document = bson::RawDocumentBuf::new();
    document.append(bson::raw::cstr!("k"), value);
    document.into_bytes()
}
