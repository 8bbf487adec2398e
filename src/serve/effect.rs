//! What a statement of a write that may be repeated did, as it is kept for the next time the statement is sent.

use bson::{Bson, Document, doc};

use super::failure::{Failure, codes};
use super::fields::number;
use crate::store::Updated;

/// What a statement did. One that changed nothing did nothing, and is done again when it is sent again.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Effect {
    Inserted,
    Updated,
    /// The `_id` of the new document.
    Upserted(Bson),
    Deleted,
    /// A `findAndModify` that changed or made a document, with its whole answer.
    Modified(Document),
    /// One that removed a document.
    Removed(Document),
}

impl Effect {
    /// What an update did, where it changed something.
    pub(super) fn of(updated: &Updated) -> Option<Self> {
        match &updated.upserted {
            Some(id) => Some(Self::Upserted(id.clone())),
            None => (updated.modified > 0).then_some(Self::Updated),
        }
    }

    /// The same as an answer to the same update.
    ///
    /// # Errors
    /// Where the statement was no update.
    pub(super) fn updated(self) -> Result<Updated, Failure> {
        match self {
            Self::Updated | Self::Modified(_) => Ok(Updated { matched: 1, modified: 1, ..Updated::default() }),
            Self::Upserted(id) => Ok(Updated { upserted: Some(id), ..Updated::default() }),
            Self::Inserted | Self::Deleted | Self::Removed(_) => Err(self.incompatible("update", 40_638)),
        }
    }

    /// The answer of a `findAndModify`.
    ///
    /// # Errors
    /// Where the statement was none, or one that removes is one that does not.
    pub(super) fn modified(self, removes: bool) -> Result<Document, Failure> {
        match self {
            Self::Modified(reply) if !removes => Ok(reply),
            Self::Removed(reply) if removes => Ok(reply),
            other => Err(other.incompatible("findAndModify", 40_606)),
        }
    }

    fn incompatible(&self, command: &str, code: i32) -> Failure {
        let message = format!(
            "{command} retry request is not compatible with previous write in the transaction of type: {}",
            self.name()
        );
        Failure::new(code, message)
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Inserted => "inserted",
            Self::Updated => "updated",
            Self::Upserted(_) => "upserted",
            Self::Deleted => "deleted",
            Self::Modified(_) => "modified",
            Self::Removed(_) => "removed",
        }
    }

    fn value(&self) -> Option<Bson> {
        match self {
            Self::Upserted(id) => Some(id.clone()),
            Self::Modified(reply) | Self::Removed(reply) => Some(reply.clone().into()),
            Self::Inserted | Self::Updated | Self::Deleted => None,
        }
    }

    fn read(name: &str, value: Option<&Bson>) -> Option<Self> {
        match (name, value) {
            ("inserted", None) => Some(Self::Inserted),
            ("updated", None) => Some(Self::Updated),
            ("deleted", None) => Some(Self::Deleted),
            ("upserted", Some(id)) => Some(Self::Upserted(id.clone())),
            ("modified", Some(Bson::Document(reply))) => Some(Self::Modified(reply.clone())),
            ("removed", Some(Bson::Document(reply))) => Some(Self::Removed(reply.clone())),
            _ => None,
        }
    }
}

/// Successive statements that did the same.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run {
    first: i64,
    last: i64,
    effect: Effect,
}

impl Run {
    /// Joins statements, in the order of their numbers, that did the same: a large insert is one run.
    pub(super) fn join<'e>(effects: impl Iterator<Item = (&'e i64, &'e Effect)>) -> Vec<Self> {
        let mut runs: Vec<Self> = Vec::new();
        for (&number, effect) in effects {
            match runs.last_mut() {
                Some(run) if run.effect == *effect && effect.value().is_none() && run.last + 1 == number => {
                    run.last = number;
                }
                _ => runs.push(Self { first: number, last: number, effect: effect.clone() }),
            }
        }
        runs
    }

    pub(super) fn to_document(&self) -> Document {
        let mut run = doc! { "first": number(self.first), "last": number(self.last), "effect": self.effect.name() };
        run.extend(self.effect.value().map(|value| ("value".to_owned(), value)));
        run
    }

    /// Reads the statements of a run with their effects.
    ///
    /// # Errors
    /// Where it is none.
    pub(super) fn read(kept: &Bson) -> Result<impl Iterator<Item = (i64, Effect)>, Failure> {
        let read = |run: &Document| {
            let effect = Effect::read(run.get_str("effect").ok()?, run.get("value"))?;
            let end = |name| run.get(name).and_then(super::fields::whole);
            Some((end("first")?..=end("last")?).map(move |number| (number, effect.clone())))
        };
        let damaged = || Failure::new(codes::INTERNAL, format!("what was kept of a write is damaged: {kept}"));
        kept.as_document().and_then(read).ok_or_else(damaged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn effects_are_kept_in_runs_and_read_again() {
        let reply = doc! { "value": { "_id": 1 } };
        let effects = BTreeMap::from([
            (0, Effect::Inserted),
            (1, Effect::Inserted),
            (3, Effect::Inserted),
            (4, Effect::Updated),
            (5, Effect::Deleted),
            (6, Effect::Upserted(7.into())),
            (7, Effect::Upserted(7.into())),
            (8, Effect::Modified(reply.clone())),
            (9, Effect::Removed(reply)),
        ]);
        let kept: Vec<Bson> = Run::join(effects.iter()).iter().map(|run| run.to_document().into()).collect();
        assert_eq!(kept.len(), 8);
        assert_eq!(kept[0].to_string(), doc! { "first": 0, "last": 1, "effect": "inserted" }.to_string());
        let read = kept.iter().flat_map(|run| Run::read(run).unwrap()).collect();
        assert_eq!(effects, read);
        assert!(Run::read(&doc! { "first": 1, "last": 2, "effect": "upserted" }.into()).is_err());
    }
}
