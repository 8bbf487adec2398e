//! Projecting a document: fields are copied as bytes, and only what is computed is encoded.

use bson::raw::{CStr, RawArrayBuf, RawBson, RawDocument};
use bson::{DateTime, Document, RawBsonRef, RawDocumentBuf};

use super::tree::{Branch, Mode, Treatment};
use crate::query::error::Result;
use crate::query::expression::{Environment, Variables};
use crate::query::limit::Held;

/// Returns the projected document; computed fields see the whole one.
///
/// # Errors
/// If a field cannot be computed, or the document is damaged.
pub(super) fn projected(
    root: &Branch,
    document: &RawDocument,
    variables: &Variables,
    now: DateTime,
) -> Result<RawDocumentBuf> {
    let environment = Environment::new(document.into(), variables, now);
    Projected { environment, held: Held::default() }.branch(root, Some(document), 1)
}

struct Projected<'a> {
    environment: Environment<'a>,
    held: Held,
}

impl Projected<'_> {
    /// A document so many levels deep, made of one that is there or of none.
    fn branch(&mut self, branch: &Branch, document: Option<&RawDocument>, level: usize) -> Result<RawDocumentBuf> {
        let computed = self.computed(branch, level)?;
        let value =
            |name: &CStr| computed.as_deref().map(|computed| computed.get(name)).transpose().map(Option::flatten);
        let (mut projected, mut placed) = (RawDocumentBuf::new(), Vec::new());
        for element in document.into_iter().flatten() {
            let (name, old) = element?;
            match (branch.child(name.as_str()), branch.mode) {
                (None, Mode::Include) | (Some(Treatment::Named), Mode::Exclude) => {}
                (None | Some(Treatment::Named), _) => projected.append(name, old),
                (Some(Treatment::Computed(_)), Mode::Include) => {}
                (Some(_), _) if placed.contains(&name) => {}
                // What is computed takes this place, or removes what is there.
                (Some(Treatment::Computed(_)), _) => {
                    placed.push(name);
                    value(name)?.into_iter().for_each(|value| projected.append(name, value));
                }
                (Some(Treatment::Branch(inner)), _) => {
                    placed.push(name);
                    let value = self.within(inner, old, level + 1)?;
                    value.into_iter().for_each(|value| projected.append(name, value));
                }
            }
        }
        // What is new comes last, in the order of the specification.
        for (name, item) in &branch.children {
            if !matches!(item, Treatment::Named) && !placed.iter().any(|placed| *placed == name.as_str()) {
                let name: &CStr = name.as_str().try_into()?;
                match item {
                    Treatment::Branch(inner) if inner.computes() => {
                        projected.append(name, self.branch(inner, None, level + 1)?);
                    }
                    _ => value(name)?.into_iter().for_each(|value| projected.append(name, value)),
                }
            }
        }
        Ok(projected)
    }

    /// What takes the place of a value; of an array, of each of its elements.
    fn within(&mut self, branch: &Branch, value: RawBsonRef<'_>, level: usize) -> Result<Option<RawBson>> {
        Ok(match value {
            RawBsonRef::Document(document) => Some(RawBson::Document(self.branch(branch, Some(document), level)?)),
            RawBsonRef::Array(items) => {
                let mut kept = RawArrayBuf::new();
                for item in items {
                    self.within(branch, item?, level + 1)?.into_iter().for_each(|item| kept.push(item));
                }
                Some(RawBson::Array(kept))
            }
            _ if branch.computes() => Some(RawBson::Document(self.branch(branch, None, level)?)),
            other => (branch.mode != Mode::Include).then(|| other.into()),
        })
    }

    /// The computed fields of a branch that have a value, where it has such fields.
    fn computed(&mut self, branch: &Branch, level: usize) -> Result<Option<RawDocumentBuf>> {
        let mut values: Option<Document> = None;
        for (name, item) in &branch.children {
            let Treatment::Computed(expression) = item else { continue };
            if let Some(value) = expression.evaluate(&self.environment)? {
                self.held.add_below(&value, level)?;
                values.get_or_insert_default().insert(name.clone(), value);
            }
        }
        Ok(values.as_ref().map(RawDocumentBuf::try_from).transpose()?)
    }
}
