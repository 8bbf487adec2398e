//! Fields of documents of one kind: several at once, in one pass over each document.
//!
//! The names of the document before are remembered in their order. Where the next one has the same, each name is only
//! compared, and not searched for its end.

use bson::{RawBsonRef, RawDocument};

use super::element::{decode, length, text_and_rest};

/// How many names of a document are remembered.
const REMEMBERED: usize = 64;

/// Reads the same fields of one document after the other.
#[derive(Debug, Default)]
pub struct Row {
    names: Vec<String>,
    /// The wanted names, each with its NUL.
    wanted: Vec<Vec<u8>>,
    /// The names of the document before, each with its NUL, and which of the wanted ones it is.
    before: Vec<(Vec<u8>, Option<usize>)>,
    /// Of each wanted field, its type and where its value is; none where the document has no such field.
    found: Vec<Option<(u8, usize, usize)>>,
}

impl Row {
    /// One that reads the fields of these names, each of which is there once.
    #[must_use]
    pub fn new(names: &[String]) -> Self {
        let wanted: Vec<Vec<u8>> = names.iter().map(|name| [name.as_bytes(), &[0]].concat()).collect();
        Self { names: names.to_owned(), found: vec![None; wanted.len()], wanted, before: Vec::new() }
    }

    /// Looks at a document. Damaged bytes end it without an error.
    pub fn read(&mut self, document: &RawDocument) {
        self.found.fill(None);
        let bytes = document.as_bytes();
        let (mut at, mut missing) = (4, self.found.len());
        for nth in 0.. {
            if missing == 0 {
                return;
            }
            let Some((type_code, rest)) = bytes.get(at..).and_then(<[u8]>::split_first) else { return };
            let known = self.before.get(nth).filter(|(name, _)| rest.starts_with(name));
            let Some((name, place)) = known.map(|(name, place)| (name.len(), *place)).or_else(|| self.note(nth, rest))
            else {
                return;
            };
            let start = at + 1 + name;
            let Some(size) = bytes.get(start..).and_then(|value| length(*type_code, value)) else { return };
            let end = start.saturating_add(size);
            // Of two fields of one name, the first counts.
            if let Some(found @ None) = place.and_then(|place| self.found.get_mut(place)) {
                *found = Some((*type_code, start, end));
                missing -= 1;
            }
            at = end;
        }
    }

    /// The length of a name that was not there in the document before, with its NUL, and which of the wanted ones it is.
    fn note(&mut self, nth: usize, rest: &[u8]) -> Option<(usize, Option<usize>)> {
        let (name, _) = text_and_rest(rest)?;
        let name = rest.get(..=name.len())?;
        let place = self.wanted.iter().position(|wanted| wanted == name);
        if nth < REMEMBERED {
            self.before.truncate(nth);
            self.before.push((name.to_owned(), place));
        }
        Some((name.len(), place))
    }

    /// The value of a wanted field of the document that was looked at; none where it has no such field.
    #[must_use]
    pub fn get<'a>(&self, nth: usize, document: &'a RawDocument) -> Option<RawBsonRef<'a>> {
        let (type_code, start, end) = (*self.found.get(nth)?)?;
        let name = self.names.get(nth)?;
        decode(document, name, type_code, document.as_bytes().get(start..end)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    fn read(row: &mut Row, document: &RawDocument) -> Vec<Option<String>> {
        row.read(document);
        (0..row.wanted.len()).map(|nth| row.get(nth, document).map(|value| format!("{value:?}"))).collect()
    }

    #[test]
    fn fields_are_found_whatever_the_document_before_had() {
        let names = ["b".to_owned(), "a".to_owned(), "long name".to_owned()];
        let documents = [
            rawdoc! { "_id": 1, "a": "x", "b": [1, { "a": 5 }], "c": null },
            rawdoc! { "_id": 2, "a": "yy", "b": [], "c": null },
            rawdoc! { "a": true, "_id": 3, "b": 1.5 },
            rawdoc! {},
            rawdoc! { "ab": 1, "b": { "b": 1 }, "a": 2_i64, "a": 3, "long name": "n" },
            rawdoc! { "b": 1, "bx": 1, "": 2, "a": 7 },
            rawdoc! { "_id": 1, "a": "x", "b": bson::DateTime::from_millis(5), "c": null },
        ];
        let mut row = Row::new(&names);
        for document in documents.iter().chain(documents.iter().rev()) {
            let wanted: Vec<_> = names
                .iter()
                .map(|name| super::super::field(document, name).map(|value| format!("{value:?}")))
                .collect();
            assert_eq!(read(&mut row, document), wanted, "{document:?}");
        }
    }

    #[test]
    fn many_names_are_found() {
        let mut document = bson::RawDocumentBuf::new();
        for nth in 0..200 {
            document.append(bson::raw::CString::try_from(format!("k{nth}")).unwrap(), nth);
        }
        let mut row = Row::new(&["k3".to_owned(), "k199".to_owned()]);
        for _ in 0..2 {
            assert_eq!(read(&mut row, &document), [Some("Int32(3)".to_owned()), Some("Int32(199)".to_owned())]);
        }
    }

    #[test]
    fn damaged_bytes_end_a_document() {
        let whole = rawdoc! { "a": "text", "b": { "c": 1 } };
        for length in 5..whole.as_bytes().len() {
            let mut bytes = whole.as_bytes()[..length].to_vec();
            bytes[..4].copy_from_slice(&(length as i32).to_le_bytes());
            bytes[length - 1] = 0;
            let Ok(document) = RawDocument::from_bytes(&bytes) else { continue };
            let mut row = Row::new(&["b".to_owned()]);
            row.read(&whole);
            let _ = read(&mut row, document);
        }
    }
}
