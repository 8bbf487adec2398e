//! `$unwind`: a document per element of an array.

use bson::{Bson, Document};

use super::documents::{Documents, encode};
use crate::query::error::{QueryError, Result};
use crate::query::path::check_plain;

/// A compiled `$unwind`.
#[derive(Debug)]
pub(super) struct Unwind {
    path: Vec<String>,
    index: Option<Vec<String>>,
    preserve: bool,
}

impl Unwind {
    pub(super) fn parse(argument: &Bson) -> Result<Self> {
        let (mut path, mut index, mut preserve) = (None, None, false);
        let wrong = |code, message: &str| Err(QueryError::invalid(code, message));
        match argument {
            Bson::String(text) => path = Some(text.as_str()),
            Bson::Document(fields) => {
                for (name, value) in fields {
                    match (name.as_str(), value) {
                        ("path", Bson::String(text)) => path = Some(text),
                        ("preserveNullAndEmptyArrays", Bson::Boolean(value)) => preserve = *value,
                        ("includeArrayIndex", Bson::String(text)) if text.starts_with('$') => {
                            return wrong(28_822, "includeArrayIndex of $unwind may not start with '$'");
                        }
                        ("includeArrayIndex", Bson::String(text)) if !text.is_empty() => index = Some(parts(text)?),
                        ("path", _) => return wrong(28_808, "the path of $unwind must be a string"),
                        ("preserveNullAndEmptyArrays", _) => {
                            return wrong(28_809, "preserveNullAndEmptyArrays of $unwind must be a boolean");
                        }
                        ("includeArrayIndex", _) => {
                            return wrong(28_810, "includeArrayIndex of $unwind must be a non-empty string");
                        }
                        _ => return wrong(28_811, &format!("unrecognized option to $unwind: {name}")),
                    }
                }
            }
            _ => return Err(QueryError::invalid(15_981, "$unwind needs a string or an object")),
        }
        let path = path.filter(|path| !path.is_empty());
        let path = path.ok_or_else(|| QueryError::invalid(28_812, "no path specified to $unwind stage"))?;
        let path = path
            .strip_prefix('$')
            .ok_or_else(|| QueryError::invalid(28_818, "the path option to $unwind should be prefixed with a '$'"))?;
        Ok(Self { path: parts(path)?, index, preserve })
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(&'a self, input: Documents<'a, E>) -> Documents<'a, E> {
        Box::new(input.flat_map(move |document| {
            let unwound = document.and_then(|document| {
                let document = Document::try_from(document).map_err(QueryError::from)?;
                Ok(self.unwound(document))
            });
            match unwound {
                Ok(documents) => Box::new(documents.map(|document| Ok(encode(&document)?))) as Documents<'a, E>,
                Err(error) => Box::new(std::iter::once(Err(error))),
            }
        }))
    }

    /// Where the array is.
    pub(super) fn path(&self) -> &[String] {
        &self.path
    }

    /// Returns the documents that one document becomes, made one after the other.
    fn unwound<'a>(&'a self, mut document: Document) -> Box<dyn Iterator<Item = Document> + 'a> {
        let items = match find(&mut document, &self.path) {
            Some(place @ Bson::Array(_)) => match std::mem::replace(place, Bson::Null) {
                Bson::Array(items) => items,
                _ => Vec::new(),
            },
            Some(Bson::Null | Bson::Undefined) | None if !self.preserve => return Box::new(std::iter::empty()),
            _ => {
                self.number(&mut document, None);
                return Box::new(std::iter::once(document));
            }
        };
        if items.is_empty() {
            if !self.preserve {
                return Box::new(std::iter::empty());
            }
            // What takes the place of the array is where the array was.
            if !self.index.as_ref().is_some_and(|index| index.starts_with(&self.path)) {
                remove(&mut document, &self.path);
            }
            self.number(&mut document, None);
            return Box::new(std::iter::once(document));
        }
        Box::new(items.into_iter().enumerate().map(move |(index, item)| {
            let mut copy = document.clone();
            if let Some(place) = find(&mut copy, &self.path) {
                *place = item;
            }
            self.number(&mut copy, i64::try_from(index).ok());
            copy
        }))
    }

    fn number(&self, document: &mut Document, index: Option<i64>) {
        if let Some(path) = &self.index {
            put(document, path, index.map_or(Bson::Null, Bson::Int64));
        }
    }
}

fn parts(path: &str) -> Result<Vec<String>> {
    let parts: Vec<String> = path.split('.').map(str::to_owned).collect();
    check_plain(path)?;
    if path.contains('\0') || parts.len() > 200 {
        return Err(QueryError::invalid(16_410, format!("the field path '{path}' is not valid")));
    }
    Ok(parts)
}

fn find<'a>(document: &'a mut Document, path: &[String]) -> Option<&'a mut Bson> {
    let (name, rest) = path.split_first()?;
    let value = document.get_mut(name)?;
    if rest.is_empty() {
        return Some(value);
    }
    match value {
        Bson::Document(inner) => find(inner, rest),
        _ => None,
    }
}

fn remove(document: &mut Document, path: &[String]) {
    match path {
        [name] => {
            document.remove(name);
        }
        [name, rest @ ..] => {
            if let Some(Bson::Document(inner)) = document.get_mut(name) {
                remove(inner, rest);
            }
        }
        [] => {}
    }
}

/// Sets a value at a path of documents, making them where needed.
pub(super) fn put(document: &mut Document, path: &[String], value: Bson) {
    match path {
        [name] => {
            document.insert(name.clone(), value);
        }
        [name, rest @ ..] => {
            let mut inner = match document.get_mut(name) {
                Some(Bson::Document(inner)) => std::mem::take(inner),
                _ => Document::new(),
            };
            put(&mut inner, rest, value);
            document.insert(name.clone(), inner);
        }
        [] => {}
    }
}
