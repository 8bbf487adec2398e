//! The statements of a write that may be repeated, by their numbers (`stmtIds`).
//!
//! A client may send some of them again, with others or without: those that were done before are answered with
//! what they did then, and the others are done.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bson::{Bson, Document};

use super::effect::{Effect, Run};
use super::failure::{Failure, codes};
use super::request::Request;
use super::session::Once;

/// The number of a statement that is not to be known again.
const UNNUMBERED: i64 = -1;

/// A write that is done once, and the statements that it has.
pub(super) struct Repeatable {
    pub(super) once: Once,
    pub(super) statements: Arc<Statements>,
}

/// The statements of a write, and what those of its number did until now.
#[derive(Debug, Default)]
pub(super) struct Statements {
    numbers: Vec<i64>,
    done: Mutex<Done>,
}

#[derive(Debug, Default)]
struct Done {
    effects: BTreeMap<i64, Effect>,
    /// Whether there are some that are not kept yet.
    is_new: bool,
}

impl Statements {
    /// Reads the numbers of a command's statements: from 0 on, where it gives none.
    ///
    /// # Errors
    /// Where they are no numbers, or not as many as there are statements.
    pub(super) fn read(request: &Request) -> Result<Self, Failure> {
        let fields = request.fields();
        let mut lists = ["documents", "updates", "deletes"].into_iter();
        let count = lists.find_map(|name| request.body.get_array(name).ok()).map(Vec::len);
        let first = fields.int("stmtId")?;
        // `findAndModify` has one statement, and does not know the field.
        let numbers = if count.is_some() { fields.ints("stmtIds")? } else { None };
        let count = count.unwrap_or(1);
        if first.is_some() && numbers.is_some() {
            let message = "May not specify both stmtId and stmtIds in write command.";
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
        let first = first.map_or(0, i64::from);
        let numbers = match numbers {
            Some(numbers) => numbers.into_iter().map(i64::from).collect(),
            None if first == UNNUMBERED => vec![UNNUMBERED; count],
            None => (first..).take(count).collect::<Vec<_>>(),
        };
        if numbers.len() != count {
            let message = format!(
                "Number of statement ids must match the number of batch entries. Got {} statement ids but {count} operations.",
                numbers.len(),
            );
            return Err(Failure::new(codes::INVALID_LENGTH, message));
        }
        Ok(Self { numbers, done: Mutex::default() })
    }

    /// The number of a statement, by its place.
    fn number(&self, place: usize) -> Option<i64> {
        self.numbers.get(place).copied().filter(|number| *number != UNNUMBERED)
    }

    /// What a statement did when it was sent before: its number, and its effect.
    pub(super) fn repeated(&self, place: usize) -> Option<(i64, Effect)> {
        let number = self.number(place)?;
        Some((number, self.done().effects.get(&number)?.clone()))
    }

    /// Notes what statements did.
    pub(super) fn note(&self, places: Range<usize>, effect: &Effect) {
        let done = &mut *self.done();
        for number in places.filter_map(|place| self.number(place)) {
            if let Entry::Vacant(entry) = done.effects.entry(number) {
                entry.insert(effect.clone());
                done.is_new = true;
            }
        }
    }

    /// Takes in what is kept of the write's statements.
    pub(super) fn recall(&self, kept: &[Bson]) -> Result<(), Failure> {
        let mut done = self.done();
        kept.iter().try_for_each(|run| Run::read(run).map(|effects| done.effects.extend(effects)))
    }

    /// What is to be kept, where there is more than before.
    pub(super) fn to_be_kept(&self) -> Option<Vec<Document>> {
        let done = self.done();
        done.is_new.then(|| Run::join(done.effects.iter()).iter().map(Run::to_document).collect())
    }

    fn done(&self) -> MutexGuard<'_, Done> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn read(more: Document) -> Result<Statements, Failure> {
        let mut body = doc! { "insert": "c", "documents": [{}, {}, {}], "$db": "a" };
        body.extend(more);
        Statements::read(&Request::read(body)?)
    }

    #[test]
    fn statements_are_numbered_from_0_or_as_the_client_says() {
        let numbers = |more| read(more).map(|statements| statements.numbers).map_err(|failure| failure.code);
        assert_eq!(numbers(doc! {}), Ok(vec![0, 1, 2]));
        assert_eq!(numbers(doc! { "stmtId": 4 }), Ok(vec![4, 5, 6]));
        assert_eq!(numbers(doc! { "stmtIds": [7, 5, 6] }), Ok(vec![7, 5, 6]));
        assert_eq!(numbers(doc! { "stmtIds": [7] }), Err(codes::INVALID_LENGTH));
        assert_eq!(numbers(doc! { "stmtIds": [7_i64, 5, 6] }), Err(codes::TYPE_MISMATCH));
        assert_eq!(numbers(doc! { "stmtId": 1, "stmtIds": [7, 5, 6] }), Err(codes::INVALID_OPTIONS));
    }

    #[test]
    fn what_statements_did_is_known_again_by_their_numbers() {
        let statements = read(doc! { "stmtIds": [7, -1, 6] }).unwrap();
        assert_eq!(statements.to_be_kept(), None);
        statements.note(0..3, &Effect::Inserted);
        let kept: Vec<Bson> = statements.to_be_kept().unwrap().into_iter().map(Bson::Document).collect();
        let again = read(doc! { "stmtIds": [5, 6, -1] }).unwrap();
        again.recall(&kept).unwrap();
        assert_eq!(again.repeated(0), None);
        assert_eq!(again.repeated(1), Some((6, Effect::Inserted)));
        assert_eq!(again.repeated(2), None);
        assert_eq!(again.to_be_kept(), None);
    }
}
