//! `$group`.

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::accumulator;
use super::documents::Documents;
use super::groups::Accumulators;
use super::partition::{Entry, Grouping};
use super::run::Run;
use crate::query::error::{QueryError, QueryMistake, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::number::Number;
use crate::query::spill::Runs;

/// A compiled `$group`. Groups come out in the order in which they began.
#[derive(Debug)]
pub(super) struct Group {
    id: Expression,
    /// The name of the only field of an `_id` that is an object: null where its value is missing.
    only: Option<String>,
    accumulators: Accumulators,
}

impl Group {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        let no_id = || {
            QueryError::invalid(15_955, "a group specification must include an _id").of_kind(QueryMistake::NoGroupId)
        };
        let Some(id) = spec.get("_id") else {
            return Accumulators::parse(spec.iter(), scope).and_then(|_| Err(no_id()));
        };
        if let Bson::Document(parts) = id
            && parts.values().any(|part| matches!(part, Bson::Boolean(_)) || Number::of(part).is_some())
            && !parts.keys().any(|name| name.starts_with('$'))
        {
            return Err(QueryError::invalid(17_390, "$group does not support inclusion-style expressions"));
        }
        let fields = spec.iter().filter(|(name, _)| *name != "_id");
        let only = match id {
            Bson::Document(parts) if parts.len() == 1 => parts.keys().next().filter(|name| !name.starts_with('$')),
            _ => None,
        };
        let accumulators = Accumulators::parse(fields, scope)?;
        Ok(Self { id: Expression::parse_in(id, scope)?, only: only.cloned(), accumulators })
    }

    /// Returns what comes out for so many documents, where the stage counts all of them.
    pub(super) fn counted(&self, count: i64) -> Option<Document> {
        let (Expression::Constant(id), None, Some(name)) = (&self.id, &self.only, self.accumulators.only_count())
        else {
            return None;
        };
        Some(doc! { "_id": id.clone().unwrap_or(Bson::Null), name: accumulator::count(count) })
    }

    /// Counts by a key.
    pub(super) fn counting(id: Expression) -> Self {
        Self { id, only: None, accumulators: Accumulators::counting() }
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: &Run<'a, E>,
    ) -> std::result::Result<Documents<'a, E>, E> {
        let mut runs = Runs::new(&run.spill().folder);
        let grouping = Grouping { accumulators: &self.accumulators, run, hash: Default::default() };
        let mut items = (0u64..).zip(input).map(|(number, document)| {
            let document = document?;
            let id = self.id_of(&document, run)?;
            Ok(Entry::Document(number, id, document))
        });
        let mut groups = grouping.group(&mut items, 0, &mut runs)?;
        if runs.is_empty() {
            let groups = groups.take().into_iter();
            return Ok(Box::new(groups.map(|group| Ok(self.accumulators.encoded(group)?))));
        }
        let merged = runs.merged()?;
        Ok(Box::new(merged.map(|record| Ok(RawDocumentBuf::from_bytes(record?.1).map_err(QueryError::from)?))))
    }

    /// Returns the `_id` of a document's group.
    fn id_of<E>(&self, document: &RawDocumentBuf, run: &Run<'_, E>) -> Result<Bson> {
        let mut id = self.id.evaluate(&run.environment((&**document).into()))?.unwrap_or(Bson::Null);
        if let (Some(name), Bson::Document(parts)) = (&self.only, &mut id) {
            parts.entry(name.clone()).or_insert(Bson::Null);
        }
        Ok(id)
    }
}
