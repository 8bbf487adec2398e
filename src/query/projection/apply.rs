//! Projecting a document: fields are copied as bytes, and only what is computed is encoded.

use bson::raw::RawDocument;
use bson::{DateTime, Document, RawDocumentBuf};

use super::tree::{Branch, Mode, Treatment};
use crate::query::element::{ARRAY, DOCUMENT, Element, Elements};
use crate::query::error::Result;
use crate::query::expression::{Environment, Variables};
use crate::query::limit::Held;

/// Returns the projected document; computed fields see the whole one.
///
/// # Errors
/// If a field cannot be computed.
pub(super) fn projected(
    root: &Branch,
    document: &RawDocument,
    variables: &Variables,
    now: DateTime,
) -> Result<RawDocumentBuf> {
    let environment = Environment::new(document.into(), variables, now);
    let bytes = Vec::with_capacity(document.as_bytes().len());
    let mut projection = Projection { environment, held: Held::default(), bytes };
    projection.branch(root, Some(document), 1)?;
    let mut bytes = projection.bytes;
    if bytes.len() < bytes.capacity() / 2 {
        // Many may be kept.
        bytes.shrink_to_fit();
    }
    Ok(RawDocumentBuf::from_bytes(bytes)?)
}

/// A projected document that is being written.
struct Projection<'a> {
    environment: Environment<'a>,
    held: Held,
    bytes: Vec<u8>,
}

impl Projection<'_> {
    /// Writes a document so many levels deep, made of one that is there or of none.
    fn branch(&mut self, branch: &Branch, document: Option<&RawDocument>, level: usize) -> Result<()> {
        let computed = self.computed(branch, document, level)?;
        let value = |name: &[u8]| Elements::new(computed.as_deref()?).find(name);
        let begin = self.begin();
        let mut placed: Vec<&[u8]> = Vec::new();
        for element in document.map(Elements::new).into_iter().flatten() {
            let name = element.name_bytes();
            match (branch.child(name), branch.mode) {
                (None, Mode::Include) | (Some(Treatment::Named), Mode::Exclude) => {}
                (None | Some(Treatment::Named), _) => self.put(name, element),
                (Some(Treatment::Computed(_)), Mode::Include) => {}
                (Some(_), _) if placed.contains(&name) => {}
                // What is computed takes this place, or removes what is there.
                (Some(Treatment::Computed(_)), _) => {
                    placed.push(name);
                    value(name).into_iter().for_each(|value| self.put(name, value));
                }
                (Some(Treatment::Branch(inner)), _) => {
                    placed.push(name);
                    if let Err(error) = self.within(inner, name, element, level + 1) {
                        let nth = branch.children.iter().position(|(child, _)| child.as_bytes() == name);
                        return self.branches(branch, nth.unwrap_or(0), document, level).and(Err(error));
                    }
                }
            }
        }
        // What is new comes last, in the order of the specification.
        for (name, item) in &branch.children {
            let name = name.as_bytes();
            match item {
                Treatment::Named => {}
                _ if placed.contains(&name) => {}
                Treatment::Computed(_) => value(name).into_iter().for_each(|value| self.put(name, value)),
                Treatment::Branch(inner) if inner.computes() => {
                    self.name(DOCUMENT, name);
                    self.branch(inner, None, level + 1)?;
                }
                Treatment::Branch(_) => {}
            }
        }
        self.end(begin);
        Ok(())
    }

    /// Writes what takes the place of a value; of an array, of each of its elements. Returns whether there is something.
    fn within(&mut self, branch: &Branch, name: &[u8], element: Element<'_>, level: usize) -> Result<bool> {
        match element.type_code {
            DOCUMENT => {
                self.name(DOCUMENT, name);
                self.branch(branch, Some(RawDocument::from_bytes(element.value)?), level)?;
            }
            ARRAY => {
                self.name(ARRAY, name);
                let (begin, mut kept) = (self.begin(), 0_usize);
                for item in Elements::new(RawDocument::from_bytes(element.value)?) {
                    kept += usize::from(self.within(branch, kept.to_string().as_bytes(), item, level + 1)?);
                }
                self.end(begin);
            }
            _ if branch.computes() => {
                self.name(DOCUMENT, name);
                self.branch(branch, None, level)?;
            }
            _ if branch.mode == Mode::Include => return Ok(false),
            _ => self.put(name, element),
        }
        Ok(true)
    }

    /// The computed fields of a branch that have a value, where it has such fields.
    fn computed(
        &mut self,
        branch: &Branch,
        document: Option<&RawDocument>,
        level: usize,
    ) -> Result<Option<RawDocumentBuf>> {
        let mut values: Option<Document> = None;
        for (nth, (name, item)) in branch.children.iter().enumerate() {
            let Treatment::Computed(expression) = item else { continue };
            let value = match expression.evaluate(&self.environment) {
                Ok(value) => value,
                Err(error) => return self.branches(branch, nth, document, level).and(Err(error)),
            };
            if let Some(value) = value {
                self.held.add_below(&value, level)?;
                values.get_or_insert_default().insert(name.clone(), value);
            }
        }
        Ok(values.as_ref().map(RawDocumentBuf::try_from).transpose()?)
    }

    /// Computes the first so many branches for their errors: the first one in the order of the specification counts.
    fn branches(&mut self, branch: &Branch, most: usize, document: Option<&RawDocument>, level: usize) -> Result<()> {
        for (name, item) in branch.children.iter().take(most) {
            let Treatment::Branch(inner) = item else { continue };
            let element = document.and_then(|document| Elements::new(document).find(name.as_bytes()));
            match element {
                _ if !inner.computes() => {}
                Some(element) => drop(self.within(inner, name.as_bytes(), element, level + 1)?),
                None => self.branch(inner, None, level + 1)?,
            }
        }
        Ok(())
    }

    /// Begins a document or an array; returns where its length is.
    fn begin(&mut self) -> usize {
        self.bytes.extend_from_slice(&[0; 4]);
        self.bytes.len() - 4
    }

    /// Ends the document or array that began there.
    fn end(&mut self, begin: usize) {
        self.bytes.push(0);
        let length = i32::try_from(self.bytes.len() - begin).unwrap_or(i32::MAX);
        let place = self.bytes.get_mut(begin..).and_then(<[u8]>::first_chunk_mut);
        place.into_iter().for_each(|place| *place = length.to_le_bytes());
    }

    /// Writes the type and the name of an element.
    fn name(&mut self, type_code: u8, name: &[u8]) {
        self.bytes.push(type_code);
        self.bytes.extend_from_slice(name);
        self.bytes.push(0);
    }

    /// Writes the value of an element under a name.
    fn put(&mut self, name: &[u8], element: Element<'_>) {
        self.name(element.type_code, name);
        self.bytes.extend_from_slice(element.value);
    }
}
