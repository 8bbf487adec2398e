//! `$jsonSchema`.

use crate::query::error::{QueryError, Result};
use crate::query::view::{Fields, View};

/// A compiled schema.
#[derive(Debug)]
pub(in crate::query) struct Schema {}

impl Schema {
    pub(super) fn parse(_schema: Fields<'_>) -> Result<Self> {
        Err(QueryError::unsupported("$jsonSchema"))
    }

    pub(super) fn accepts(&self, _value: View<'_>) -> bool {
        false
    }
}
