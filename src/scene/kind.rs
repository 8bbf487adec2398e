//! Kinds of objects by configuration: `[[scene.object]]` in `rmem.toml`.

use bson::{Document, RawDocument};

use crate::formats::scene::{Object, Shape};
use crate::query::{Filter, QueryError};
use crate::store::Namespace;

/// The key that names an object where nothing else is configured.
pub const NAME: &str = "name";

/// A kind of objects: which documents they are, and what these do not say themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectKind {
    /// What messages call it.
    pub name: String,
    /// Where its documents are.
    pub namespace: Namespace,
    /// Which documents there.
    pub query: Document,
    /// The key that names the object.
    pub name_key: String,
    /// A file that describes it.
    pub model: Option<String>,
    /// Its shapes, for documents without `geometry`.
    pub geometry: Vec<Shape>,
}

impl ObjectKind {
    /// Fills in what a document does not say.
    pub fn complete(&self, object: &mut Object) {
        if object.shapes.is_empty() {
            object.shapes.clone_from(&self.geometry);
        }
        if object.model.is_none() {
            object.model.clone_from(&self.model);
        }
    }
}

/// Kinds with their queries ready to match.
pub struct Kinds<'a> {
    kinds: Vec<(&'a ObjectKind, Filter)>,
}

impl<'a> Kinds<'a> {
    /// The kinds of a collection.
    ///
    /// # Errors
    /// Where a query is not a query.
    pub fn of(kinds: &'a [ObjectKind], namespace: &Namespace) -> Result<Self, QueryError> {
        let own = kinds.iter().filter(|kind| kind.namespace == *namespace);
        let kinds = own.map(|kind| Ok((kind, Filter::parse(&kind.query)?))).collect::<Result<_, QueryError>>()?;
        Ok(Self { kinds })
    }

    /// The first kind that a document is of.
    ///
    /// # Errors
    /// Where the document is malformed.
    pub fn find(&self, document: &RawDocument) -> Result<Option<&'a ObjectKind>, QueryError> {
        for (kind, filter) in &self.kinds {
            if filter.matches(document)? {
                return Ok(Some(kind));
            }
        }
        Ok(None)
    }
}
