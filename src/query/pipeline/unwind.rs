//! `$unwind`: a document per element of an array. Documents are copied as bytes.

use std::ops::Range;

use bson::raw::CString;
use bson::{Bson, Document, RawBson, RawDocument, RawDocumentBuf};

use super::documents::{Documents, encode};
use crate::query::element::{ARRAY, DOCUMENT, Elements, extent};
use crate::query::error::{QueryError, Result};
use crate::query::path::check_plain;

/// The types of what is no value for an element.
const UNDEFINED: u8 = 0x06;
const NULL: u8 = 0x0A;

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
        Box::new(input.flat_map(move |document| match document {
            Ok(document) => Box::new(self.unwound(document).map(|unwound| Ok(unwound?))) as Documents<'a, E>,
            Err(error) => Box::new(std::iter::once(Err(error))),
        }))
    }

    /// Where the array is.
    pub(super) fn path(&self) -> &[String] {
        &self.path
    }

    /// Returns the documents that one document becomes, made one after the other.
    fn unwound(&self, document: RawDocumentBuf) -> Box<dyn Iterator<Item = Result<RawDocumentBuf>> + '_> {
        let Some(place) = Place::of(&document, &self.path).filter(|place| !place.is_null(&document)) else {
            return self.kept(document);
        };
        let Some(items) = place.items(&document) else {
            return Box::new(std::iter::once(self.numbered(document, None)));
        };
        if items.is_empty() {
            // What takes the place of the array is where the array was.
            let is_replaced = self.index.as_ref().is_some_and(|index| index.starts_with(&self.path));
            return match self.preserve && !is_replaced {
                true => Box::new(std::iter::once(place.put(&document, None).and_then(|put| self.numbered(put, None)))),
                false => self.kept(document),
            };
        }
        Box::new(items.into_iter().enumerate().map(move |(nth, item)| {
            place.put(&document, Some(item)).and_then(|put| self.numbered(put, i64::try_from(nth).ok()))
        }))
    }

    /// A document that has no element.
    fn kept(&self, document: RawDocumentBuf) -> Box<dyn Iterator<Item = Result<RawDocumentBuf>> + '_> {
        Box::new(self.preserve.then(|| self.numbered(document, None)).into_iter())
    }

    /// The document with the number of its element, where that is wanted.
    fn numbered(&self, document: RawDocumentBuf, number: Option<i64>) -> Result<RawDocumentBuf> {
        let Some(path) = &self.index else { return Ok(document) };
        if let [name] = path.as_slice()
            && extent(&document, name).is_none()
        {
            let mut document = document;
            document.append(CString::try_from(name.as_str())?, number.map_or(RawBson::Null, RawBson::Int64));
            return Ok(document);
        }
        let mut document = Document::try_from(document)?;
        put(&mut document, path, number.map_or(Bson::Null, Bson::Int64));
        encode(&document)
    }
}

/// Where a value is in the bytes of a document.
struct Place {
    /// Where the documents around it begin, with their lengths.
    around: Vec<usize>,
    /// Where its type is, behind which its name is.
    start: usize,
    value: Range<usize>,
}

/// The type of an element of an array, and where its value is.
type Item = (u8, Range<usize>);

impl Place {
    /// The place of what is at a path through documents.
    fn of(document: &RawDocument, path: &[String]) -> Option<Self> {
        let (last, outer) = path.split_last()?;
        let (mut around, mut begin, mut inner) = (vec![0], 0, document);
        for name in outer {
            let (start, end) = extent(inner, name)?;
            let value = start + name.len() + 2;
            if inner.as_bytes().get(start) != Some(&DOCUMENT) {
                return None;
            }
            inner = RawDocument::from_bytes(inner.as_bytes().get(value..end)?).ok()?;
            begin += value;
            around.push(begin);
        }
        let (start, end) = extent(inner, last)?;
        Some(Self { around, start: begin + start, value: begin + start + last.len() + 2..begin + end })
    }

    fn type_code(&self, document: &RawDocument) -> Option<u8> {
        document.as_bytes().get(self.start).copied()
    }

    /// Whether nothing is there but null.
    fn is_null(&self, document: &RawDocument) -> bool {
        matches!(self.type_code(document), Some(NULL | UNDEFINED))
    }

    /// The elements of the array that is there, if one is.
    fn items(&self, document: &RawDocument) -> Option<Vec<Item>> {
        let bytes = document.as_bytes().get(self.value.clone()).filter(|_| self.type_code(document) == Some(ARRAY))?;
        let mut elements = Elements::new(RawDocument::from_bytes(bytes).ok()?);
        let mut items = Vec::new();
        while let Some(element) = elements.next() {
            let end = self.value.end - elements.left();
            items.push((element.type_code, end - element.value.len()..end));
        }
        Some(items)
    }

    /// The document with one of its own values there, or with nothing.
    fn put(&self, document: &RawDocument, item: Option<Item>) -> Result<RawDocumentBuf> {
        let bytes = document.as_bytes();
        let part = |range: Range<usize>| bytes.get(range).unwrap_or_default();
        // No more than it needs: many may be kept, and the array is in none of them.
        let item_length = item.as_ref().map_or(0, |(_, value)| value.len());
        let mut made = Vec::with_capacity(bytes.len() - self.value.len() + item_length);
        made.extend_from_slice(part(0..self.start));
        if let Some((type_code, value)) = item {
            made.push(type_code);
            made.extend_from_slice(part(self.start + 1..self.value.start));
            made.extend_from_slice(part(value));
        }
        made.extend_from_slice(part(self.value.end..bytes.len()));
        let shorter = i32::try_from(bytes.len() - made.len()).unwrap_or(0);
        for begin in &self.around {
            if let Some(length) = made.get_mut(*begin..).and_then(<[u8]>::first_chunk_mut) {
                *length = (i32::from_le_bytes(*length) - shorter).to_le_bytes();
            }
        }
        Ok(RawDocumentBuf::from_bytes(made)?)
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
