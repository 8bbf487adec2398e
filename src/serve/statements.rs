//! The statements of a write that may be repeated, by their numbers (`stmtIds`).

use bson::{Bson, Document};

use super::failure::{Failure, codes};
use super::fields::whole;
use super::request::Request;
use super::session::Once;

/// A write that is done once, and the statements that it has.
pub(super) struct Repeatable {
    pub(super) once: Once,
    pub(super) statements: Statements,
}

/// The statements of a write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Statements {
    pub(super) numbers: Vec<i64>,
    /// Whether those behind one that fails are not done.
    is_ordered: bool,
    /// Whether the write is one of one statement (`findAndModify`), whose answer says so in another field.
    is_single: bool,
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
        let first = fields.whole("stmtId")?.unwrap_or(0);
        let numbers: Vec<i64> = match fields.array("stmtIds")? {
            Some(numbers) => numbers.iter().filter_map(whole).collect(),
            None => (first..).take(count.unwrap_or(1)).collect(),
        };
        if numbers.len() != count.unwrap_or(1) {
            let message = format!(
                "Number of statement ids must match the number of batch entries. Got {} statement ids but {} operations.",
                numbers.len(),
                count.unwrap_or(1)
            );
            return Err(Failure::new(codes::INVALID_LENGTH, message));
        }
        let is_ordered = fields.optional_flag("ordered")?.unwrap_or(true);
        Ok(Self { numbers, is_ordered, is_single: count.is_none() })
    }

    /// The answer to the same write when it is sent again: with the statements that were done before.
    pub(super) fn repeated(&self, mut reply: Document) -> Document {
        if self.is_single {
            reply.extend(self.numbers.first().map(|number| ("retriedStmtId".to_owned(), small(*number))));
            return reply;
        }
        let errors = reply.get_array("writeErrors").map(Vec::as_slice).unwrap_or_default();
        let index = |error: &Bson| error.as_document().and_then(|error| whole(error.get("index")?));
        let failed: Vec<i64> = errors.iter().filter_map(index).collect();
        let is_done = |nth: i64| match self.is_ordered {
            true => failed.first().is_none_or(|first| nth < *first),
            false => !failed.contains(&nth),
        };
        let done = (0..).zip(&self.numbers).filter(|(nth, _)| is_done(*nth));
        let done: Vec<Bson> = done.map(|(_, number)| small(*number)).collect();
        if !done.is_empty() {
            reply.insert("retriedStmtIds", done);
        }
        reply
    }
}

fn small(number: i64) -> Bson {
    i32::try_from(number).map_or(Bson::Int64(number), Bson::Int32)
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
    fn a_repeated_answer_names_the_statements_that_were_done() {
        let named =
            |more: Document, reply: Document| read(more).unwrap().repeated(reply).get("retriedStmtIds").cloned();
        assert_eq!(named(doc! {}, doc! { "n": 3 }), Some([0, 1, 2].to_vec().into()));
        assert_eq!(named(doc! { "stmtId": 4 }, doc! { "n": 3 }), Some([4, 5, 6].to_vec().into()));
        let failed = doc! { "writeErrors": [{ "index": 1 }] };
        assert_eq!(named(doc! { "stmtIds": [7, 5, 6] }, failed.clone()), Some([7].to_vec().into()));
        assert_eq!(named(doc! { "ordered": false }, failed), Some([0, 2].to_vec().into()));
        assert_eq!(read(doc! { "stmtIds": [7] }).unwrap_err().code, codes::INVALID_LENGTH);
    }
}
