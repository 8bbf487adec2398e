//! `insert`

use bson::{Bson, Document, doc};

use super::definition::Command;
use super::write::{COMMON, Outcome, is_ordered, statements};
use crate::memory::Memory;
use crate::serve::call::Call;
use crate::serve::effect::Effect;
use crate::serve::failure::{Answer, Failure};

pub(super) const COMMANDS: &[Command] = &[Command::write("insert", insert).transactional()];

fn insert(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    fields.known(&[&COMMON[..], &["documents"]].concat())?;
    let (ordered, documents) = (is_ordered(call)?, statements(fields, "documents")?);
    let (mut outcome, mut start, mut size) = (Outcome::default(), 0, documents.len());
    // Documents are stored together, up to the next one that is refused. Where one was, the next are likely to be: few are
    // tried at first, so that the work does not grow with the square of their number.
    while let Some(rest) = documents.get(start..).filter(|rest| !rest.is_empty()) {
        if outcome.repeated(call, start).is_some() {
            outcome.n += 1;
            start += 1;
            continue;
        }
        let is_new = |(place, _): &(usize, _)| *place == 0 || call.statements.repeated(start + place).is_none();
        let batch = rest.iter().take(size).enumerate().take_while(is_new);
        let batch: Vec<Document> = batch.map(|(_, document)| (*document).clone()).collect();
        match call.access(memory).insert(&ns, batch) {
            Ok(inserted) => {
                let stored = inserted.ids.len();
                call.statements.note(start..start + stored, &Effect::Inserted);
                outcome.n += stored as u64;
                start += stored;
                size = size.saturating_mul(2);
            }
            Err(error) => {
                let stored = error.stored().len();
                call.statements.note(start..start + stored, &Effect::Inserted);
                size = stored + 1;
                outcome.n += stored as u64;
                let index = start + stored;
                let id = documents.get(index).and_then(|document| document.get("_id"));
                let failure = described(Failure::from(error), id);
                if !outcome.fail(index, failure, ordered)? {
                    break;
                }
                start = index + 1;
            }
        }
    }
    outcome.reply(doc! {})
}

/// A taken `_id` is reported as the value it is, whatever it looks like as text.
fn described(mut failure: Failure, id: Option<&Bson>) -> Failure {
    let is_of_id = failure.details.get_document("keyPattern").is_ok_and(|pattern| pattern.contains_key("_id"));
    if let (true, Some(id)) = (is_of_id, id) {
        failure.details.insert("keyValue", doc! { "_id": id });
    }
    failure
}
