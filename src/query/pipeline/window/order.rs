//! The order of a partition.

use bson::{Bson, Document, RawDocument};

use crate::query::error::Result;
use crate::query::expression::field_value;
use crate::query::path::Path;
use crate::query::sort::Sort;
use crate::query::view::Fields;

/// What the documents of a partition are sorted by, if by anything.
#[derive(Debug, Default)]
pub(super) struct Order {
    sort: Option<Sort>,
    /// The only path that is sorted by, with its direction (descending or not).
    by: Option<(Path, bool)>,
}

impl Order {
    /// Reads a sort pattern.
    pub(super) fn parse(pattern: &Document) -> Result<Self> {
        let sort = Sort::parse(pattern)?;
        let by = match sort.fields().collect::<Vec<_>>().as_slice() {
            [(path, descending)] => Some((Path::parse(path)?, *descending)),
            _ => None,
        };
        Ok(Self { sort: Some(sort), by })
    }

    pub(super) fn is_sorted(&self) -> bool {
        self.sort.is_some()
    }

    /// Whether there is one field only that is sorted by.
    pub(super) fn is_by_one(&self) -> bool {
        self.by.is_some()
    }

    /// Whether that field is sorted by in descending order.
    pub(super) fn is_descending(&self) -> bool {
        self.by.as_ref().is_some_and(|(_, descending)| *descending)
    }

    /// The place of a document, as bytes that compare as the documents do.
    pub(super) fn place(&self, document: &RawDocument) -> Result<Vec<u8>> {
        self.sort.as_ref().map_or(Ok(Vec::new()), |sort| sort.key(document))
    }

    /// The value of the only field that is sorted by.
    pub(super) fn value(&self, fields: Fields<'_>) -> Option<Bson> {
        let (path, _) = self.by.as_ref()?;
        let parts: Vec<String> = path.text().split('.').map(str::to_owned).collect();
        field_value(fields, &parts)
    }
}
