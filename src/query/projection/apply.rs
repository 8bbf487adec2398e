//! Projecting a document.

use bson::raw::RawDocument;
use bson::{Bson, DateTime, Document, RawDocumentBuf};

use super::tree::{Branch, Mode, Treatment};
use crate::query::error::Result;
use crate::query::expression::{Environment, Variables};
use crate::query::limit::Held;

/// Without decoding, where only whole fields at the top are named.
pub(super) fn flat(root: &Branch, document: &RawDocument) -> Result<Option<RawDocumentBuf>> {
    if root.children.iter().any(|(_, item)| !matches!(item, Treatment::Named)) {
        return Ok(None);
    }
    let mut projected = RawDocumentBuf::new();
    for element in document {
        let (name, value) = element?;
        if root.child(name.as_str()).is_some() == (root.mode == Mode::Include) {
            projected.append(name, value);
        }
    }
    Ok(Some(projected))
}

/// Returns the projected document; computed fields see the whole one.
pub(super) fn branch(root: &Branch, document: &Document, variables: &Variables, now: DateTime) -> Result<Document> {
    let environment = Environment::new(document.into(), variables, now);
    let mut projected = named(root, document);
    if root.computes() {
        computed(root, &mut projected, &environment, &mut Held::default())?;
    }
    Ok(projected)
}

/// Leaves fields in or out.
fn named(branch: &Branch, document: &Document) -> Document {
    let mut projected = Document::new();
    for (name, value) in document {
        let kept = match (branch.child(name), branch.mode) {
            (None, Mode::Include) | (Some(Treatment::Named), Mode::Exclude) => None,
            (None, _) | (Some(Treatment::Named), _) => Some(value.clone()),
            (Some(Treatment::Computed(_)), Mode::Include) => None,
            // What is computed takes this place, or removes it.
            (Some(Treatment::Computed(_)), _) => Some(Bson::Null),
            (Some(Treatment::Branch(inner)), _) => named_value(inner, value),
        };
        if let Some(value) = kept {
            projected.insert(name.clone(), value);
        }
    }
    projected
}

fn named_value(branch: &Branch, value: &Bson) -> Option<Bson> {
    match value {
        Bson::Document(document) => Some(Bson::Document(named(branch, document))),
        Bson::Array(items) => Some(Bson::Array(items.iter().filter_map(|item| named_value(branch, item)).collect())),
        other => (branch.mode != Mode::Include || branch.computes()).then(|| other.clone()),
    }
}

/// Puts computed fields in, in the order of the specification.
fn computed(branch: &Branch, document: &mut Document, environment: &Environment<'_>, held: &mut Held) -> Result<()> {
    for (name, item) in &branch.children {
        match item {
            Treatment::Named => {}
            Treatment::Computed(expression) => match expression.evaluate(environment)? {
                Some(value) => {
                    held.add(&value)?;
                    document.insert(name.clone(), value);
                }
                None => {
                    document.remove(name);
                }
            },
            Treatment::Branch(inner) if inner.computes() => {
                let value = document.get(name).cloned();
                document.insert(name.clone(), computed_value(inner, value, environment, held)?);
            }
            Treatment::Branch(_) => {}
        }
    }
    Ok(())
}

fn computed_value(
    branch: &Branch,
    value: Option<Bson>,
    environment: &Environment<'_>,
    held: &mut Held,
) -> Result<Bson> {
    match value {
        Some(Bson::Document(mut document)) => {
            computed(branch, &mut document, environment, held)?;
            Ok(Bson::Document(document))
        }
        Some(Bson::Array(items)) => {
            let items = items.into_iter().map(|item| computed_value(branch, Some(item), environment, held));
            Ok(Bson::Array(items.collect::<Result<_>>()?))
        }
        _ => {
            let mut document = Document::new();
            computed(branch, &mut document, environment, held)?;
            Ok(Bson::Document(document))
        }
    }
}
