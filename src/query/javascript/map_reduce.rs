//! Map-reduce: `map` emits keys with values, `reduce` makes one value of those of a key.

use std::collections::BTreeMap;

use bson::{Bson, Document, RawDocument, doc};

use super::script::Code;
use super::{Program, source};
use crate::query::error::{QueryError, QueryMistake, Result};
use crate::query::key;
use crate::query::limit::Memory;

/// Map-reduce with its functions. `map` sees a document as `this` and calls `emit(key, value)`; `reduce(key, values)`
/// and `finalize(key, value)` return a value.
#[derive(Debug)]
pub struct MapReduce {
    map: Program,
    reduce: Program,
    finalize: Option<Program>,
}

/// How results get into a collection that may have some already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Merging {
    /// The results are all that the collection has afterwards.
    Replace,
    /// A result takes the place of the document with its key.
    Merge,
    /// The same, with results that were reduced with those documents, see [`MapReduce::merge`].
    Reduce,
}

impl Merging {
    /// Returns a pipeline that puts documents into a collection in one step. It is run on that collection.
    #[must_use]
    pub fn stages(self, database: &str, collection: &str, documents: Vec<Document>) -> Vec<Document> {
        let documents: Vec<Bson> = documents.into_iter().map(Bson::Document).collect();
        let into = doc! { "db": database, "coll": collection };
        vec![
            doc! { "$match": { "$alwaysFalse": 1 } },
            doc! { "$unionWith": { "pipeline": [{ "$documents": { "$literal": documents } }] } },
            match self {
                Self::Replace => doc! { "$out": into },
                Self::Merge | Self::Reduce => doc! { "$merge": { "into": into, "whenMatched": "replace" } },
            },
        ]
    }
}

/// The keys emitted so far, in BSON order, with their values.
#[derive(Debug, Default)]
struct Emitted {
    keys: BTreeMap<Vec<u8>, (Bson, Vec<Bson>)>,
    memory: Memory,
}

impl MapReduce {
    /// The names of the functions, as errors name the one that failed.
    pub const FUNCTIONS: [&str; 3] = ["map", "reduce", "finalize"];

    /// Reads functions; `scope` holds variables that all of them see.
    ///
    /// # Errors
    /// If rmem is built without JavaScript.
    pub fn parse(map: &str, reduce: &str, finalize: Option<&str>, scope: &Document) -> Result<Self> {
        let program = |code: String| Program::new("map-reduce", Code::Function(code), scope.clone());
        let function = source::function(map);
        let collecting = format!(
            "(function(document) {{ var all = []; \
             globalThis.emit = function(key, value) {{ \
             if (arguments.length !== 2) throw new Error('emit takes a key and a value'); all.push([key, value]); }}; \
             {function}.call(document); return all; }})"
        );
        let finalize = finalize.map(|code| program(source::function(code))).transpose()?;
        Ok(Self { map: program(collecting)?, reduce: program(source::function(reduce))?, finalize })
    }

    /// Returns `{_id: key, value}` for each key that was emitted, in the order of the keys. A key with one value is not
    /// reduced.
    ///
    /// # Errors
    /// The first error of the input, or of a function, whose name is then the operator of the error.
    pub fn run<E: From<QueryError>, D: AsRef<RawDocument>>(
        &self,
        documents: impl Iterator<Item = std::result::Result<D, E>>,
    ) -> std::result::Result<Vec<Document>, E> {
        let mut emitted = Emitted::default();
        for document in documents {
            let document = Document::try_from(document?.as_ref()).map_err(QueryError::from)?;
            emitted.add(self.map.call(&[Some(Bson::Document(document))]).map_err(of("map"))?)?;
        }
        let results = emitted.keys.into_values().map(|(key, values)| self.result(key, values));
        Ok(results.collect::<Result<_>>()?)
    }

    /// Reduces a result with the one of its key that is stored already, and finalizes it again.
    ///
    /// # Errors
    /// The first error of a function.
    pub fn merge(&self, stored: &Document, result: &mut Document) -> Result<()> {
        let key = result.get("_id").cloned().unwrap_or(Bson::Null);
        let values = [stored, result].map(|of| of.get("value").cloned().unwrap_or(Bson::Undefined));
        *result = self.result(key, values.to_vec())?;
        Ok(())
    }

    fn result(&self, key: Bson, mut values: Vec<Bson>) -> Result<Document> {
        let mut value = match values.len() {
            1 => values.pop(),
            _ => self.reduce.call(&[Some(key.clone()), Some(Bson::Array(values))]).map_err(of("reduce"))?,
        };
        if let Some(finalize) = &self.finalize {
            value = finalize.call(&[Some(key.clone()), value]).map_err(of("finalize"))?;
        }
        let mut result = Document::new();
        result.insert("_id", key);
        result.insert("value", value.unwrap_or(Bson::Undefined));
        Ok(result)
    }
}

/// Says which function an error is of.
fn of(function: &'static str) -> impl Fn(QueryError) -> QueryError {
    move |error| error.of_kind(QueryMistake::InFunction(function))
}

impl Emitted {
    /// Adds what one document emitted: an array of pairs.
    fn add(&mut self, pairs: Option<Bson>) -> Result<()> {
        let Some(Bson::Array(pairs)) = pairs else { return Ok(()) };
        for pair in pairs {
            let Bson::Array(pair) = pair else { continue };
            let Ok([key, value]) = <[Bson; 2]>::try_from(pair) else { continue };
            let key = if key == Bson::Undefined { Bson::Null } else { key };
            self.memory.add(&value)?;
            let entry = self.keys.entry(key::collated(&key)).or_insert_with(|| (key, Vec::new()));
            entry.1.push(value);
        }
        Ok(())
    }
}

#[cfg(all(test, feature = "javascript"))]
mod tests {
    use super::*;
    use bson::{RawDocumentBuf, doc};

    #[test]
    fn values_of_a_key_are_reduced_and_a_single_one_is_not() {
        let documents = [doc! { "k": "a", "n": 1 }, doc! { "k": "b", "n": 2 }, doc! { "k": "a", "n": 3 }];
        let raw = documents.iter().map(|document| Ok::<_, QueryError>(RawDocumentBuf::try_from(document).unwrap()));
        let map_reduce = MapReduce::parse(
            "function() { emit(this.k, this.n * factor) }",
            "function(key, values) { return Array.sum(values) + 0.5 }",
            Some("function(key, value) { return {total: value} }"),
            &doc! { "factor": 10 },
        );
        let found = map_reduce.unwrap().run(raw).unwrap();
        let expected =
            [doc! { "_id": "a", "value": { "total": 40.5 } }, doc! { "_id": "b", "value": { "total": 20.0 } }];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_result_is_reduced_with_the_stored_one() {
        let functions = MapReduce::parse("x", "function(k, v) { return v[0] - v[1] }", None, &doc! {}).unwrap();
        let mut result = doc! { "_id": "a", "value": 3 };
        functions.merge(&doc! { "_id": "a", "value": 10 }, &mut result).unwrap();
        assert_eq!(result, doc! { "_id": "a", "value": 7.0 });
    }
}
