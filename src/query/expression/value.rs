//! What an expression evaluates to.

use bson::Bson;

/// A value that may be missing.
pub(in crate::query) type Value = Option<Bson>;
