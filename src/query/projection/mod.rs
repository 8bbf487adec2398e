//! Projections: which fields of a document are given, and which are computed.
//!
//! One tree serves `find`, `$project`, `$addFields` and `$unset`; only `find`
//! has `$slice`, `$elemMatch` and the positional `$` of projections.

mod apply;
mod find;
mod parse;
mod tree;

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf};

use super::error::Result;
use super::expression::{Scope, Variables};
use super::filter::Filter;
use super::limit::{check_result, encode_result};
use find::Transform;
pub(super) use tree::{Branch, Policy};

/// A compiled projection.
#[derive(Debug)]
pub struct Projection {
    root: Branch,
    transforms: Vec<Transform>,
    variables: Variables,
}

impl Projection {
    /// Reads a projection as `find` takes it.
    ///
    /// # Errors
    /// If MongoDB refuses it.
    pub fn parse(projection: &Document) -> Result<Self> {
        Self::parse_with(projection, &Document::new())
    }

    /// [`Projection::parse`] with constants its expressions can use as `$$name`.
    ///
    /// # Errors
    /// As [`Projection::parse`].
    pub fn parse_with(projection: &Document, constants: &Document) -> Result<Self> {
        let (scope, variables) = Scope::with_constants(constants)?;
        let (root, transforms) = parse::projection(projection, Policy::Find, &scope)?;
        Ok(Self { root, transforms, variables })
    }

    /// Returns the projected document. `filter` is the one the document matched, for the positional `$`.
    ///
    /// # Errors
    /// If an expression fails on the document.
    pub fn apply(&self, document: &RawDocument, filter: &Filter, now: DateTime) -> Result<RawDocumentBuf> {
        let projected = apply::projected(&self.root, document, &self.variables, now)?;
        if self.transforms.is_empty() {
            if self.root.computes() {
                check_result(&projected)?;
            }
            return Ok(projected);
        }
        let whole = Document::try_from(document)?;
        let mut projected = Document::try_from(projected)?;
        for transform in &self.transforms {
            projected = transform.apply(projected, &whole, filter, now)?;
        }
        encode_result(&projected)
    }
}

/// A projection of a pipeline stage.
#[derive(Debug)]
pub(super) struct Shape {
    root: Branch,
}

impl Shape {
    /// Reads what `$project` takes.
    pub(super) fn project(spec: &Document, scope: &Scope) -> Result<Self> {
        let (root, _) = parse::projection(spec, Policy::Stage, scope)?;
        Ok(Self { root })
    }

    /// Reads what `$addFields` and `$set` take.
    pub(super) fn add_fields(spec: &Document, scope: &Scope) -> Result<Self> {
        Ok(Self { root: parse::additions(spec, scope)? })
    }

    /// Reads the paths that `$unset` removes.
    pub(super) fn unset(paths: &[Bson]) -> Result<Self> {
        Ok(Self { root: parse::removals(paths)? })
    }

    pub(super) fn apply(&self, document: &RawDocument, variables: &Variables, now: DateTime) -> Result<RawDocumentBuf> {
        apply::projected(&self.root, document, variables, now)
    }
}
