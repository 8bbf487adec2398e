//! The values that `distinct` lists: those of a field, array elements one by one.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use bson::{Bson, Document, RawDocumentBuf};

use super::dollar::is_reference_key;
use super::error::{QueryError, Result};
use super::key;
use super::limit::ALLOCATION;
use super::path::Path;
use super::spill::{Runs, Spill};
use super::view::View;

/// The name of the only field of a document around a value.
const FIELD: &str = "v";

/// The different values that a dotted path reaches in documents, in BSON order;
/// of an array, its elements. Of equal values (`1` and `1.0`) the first is given.
#[derive(Debug)]
pub struct Distinct {
    path: Path,
    limit: usize,
    /// The values by their keys, as documents of one field.
    values: BTreeMap<Vec<u8>, RawDocumentBuf>,
    /// The bytes of memory that they need.
    held: usize,
    runs: Runs,
}

impl Distinct {
    /// Returns what lists the values at a path.
    ///
    /// # Errors
    /// If the path is not one.
    pub fn new(path: &str, spill: &Spill) -> Result<Self> {
        if path.contains('\0') {
            return Err(QueryError::invalid(31_032, "the key field cannot contain a NUL"));
        }
        check(path).map_err(|error| error.about(path))?;
        let (path, runs) = (Path::parse(path)?, Runs::new(&spill.folder));
        Ok(Self { path, limit: spill.limit, values: BTreeMap::new(), held: 0, runs })
    }

    /// Returns the values.
    ///
    /// # Errors
    /// The first error of the input, or a temporary file that cannot be used.
    pub fn of<E: From<QueryError>>(
        mut self,
        documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
    ) -> std::result::Result<Box<dyn Iterator<Item = Result<Bson>>>, E> {
        let path = self.path.clone();
        for document in documents {
            path.any((&*document?).into(), false, &mut |value, _| {
                match value {
                    Some(View::Array(items)) => items.iter().for_each(|item| self.add(item)),
                    Some(value) => self.add(value),
                    None => {}
                }
                false
            });
            if self.held > self.limit {
                self.spill()?;
            }
        }
        if self.runs.is_empty() {
            return Ok(Box::new(self.values.into_values().map(|value| value_of(&value))));
        }
        self.spill()?;
        let mut last = None;
        Ok(Box::new(self.runs.merged()?.filter_map(move |record| match record {
            Ok((key, _)) if last.as_ref() == Some(&key) => None,
            Ok((key, value)) => {
                last = Some(key);
                Some(RawDocumentBuf::from_bytes(value).map_err(QueryError::from).and_then(|value| value_of(&value)))
            }
            Err(error) => Some(Err(error)),
        })))
    }

    fn add(&mut self, value: View<'_>) {
        let mut key = Vec::new();
        key::append(value, &mut key);
        if let Entry::Vacant(entry) = self.values.entry(key) {
            let document = Document::from_iter([(FIELD.to_owned(), value.to_bson())]);
            // Values of stored documents can be stored.
            let Ok(document) = RawDocumentBuf::try_from(&document) else { return };
            let overhead = 2 * size_of::<(Vec<u8>, RawDocumentBuf)>() + 2 * ALLOCATION;
            self.held += overhead + entry.key().len() + document.as_bytes().len();
            entry.insert(document);
        }
    }

    /// Writes the values that are held as a run.
    fn spill(&mut self) -> Result<()> {
        self.held = 0;
        let values = std::mem::take(&mut self.values).into_iter();
        self.runs.add(values.map(|(key, value)| Ok::<_, QueryError>((key, value.into_bytes()))))
    }
}

fn value_of(document: &RawDocumentBuf) -> Result<Bson> {
    Ok(document.get(FIELD)?.map(Bson::try_from).transpose()?.unwrap_or(Bson::Null))
}

/// Refuses paths with invalid names.
fn check(path: &str) -> Result<()> {
    if path.is_empty() {
        return Err(QueryError::invalid(40_352, "the path of a field cannot be empty"));
    }
    if path.ends_with('.') {
        return Err(QueryError::invalid(40_353, format!("the path {path} may not end with a '.'")));
    }
    for part in path.split('.') {
        if part.is_empty() {
            return Err(QueryError::invalid(15_998, format!("the path {path} may not have empty parts")));
        }
        if part.starts_with('$') && !is_reference_key(part) {
            return Err(QueryError::invalid(16_410, format!("the name {part} may not start with '$'")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    #[test]
    fn refuses_what_is_no_path() {
        for (path, code) in [("", 40_352), ("v.", 40_353), (".v", 15_998), ("v..a", 15_998), ("$v", 16_410)] {
            assert_eq!(Distinct::new(path, &Spill::default()).unwrap_err().code, code, "{path}");
        }
    }

    #[test]
    fn lists_elements_of_arrays_in_order_once() {
        let documents = [rawdoc! {"a": [3, 1]}, rawdoc! {"a": 2.0}, rawdoc! {"b": 1}, rawdoc! {"a": [2, [1]]}];
        let wanted = [Bson::Int32(1), Bson::Double(2.0), Bson::Int32(3), Bson::Array(vec![Bson::Int32(1)])];
        for limit in [0, 200, usize::MAX] {
            let values = Distinct::new("a", &Spill { limit, ..Spill::default() }).unwrap();
            let values = values.of(documents.iter().cloned().map(Ok::<_, QueryError>)).unwrap();
            assert_eq!(values.collect::<Result<Vec<_>>>().unwrap(), wanted, "{limit}");
        }
    }
}
