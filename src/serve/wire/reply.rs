//! What the server sends: a document, in the form in which it was asked.

use std::sync::atomic::{AtomicI32, Ordering};

use bson::RawDocument;

use super::message::{Form, Message};
use super::{HEADER, OP_COMPRESSED, OP_MSG, OP_REPLY, compression};

/// OP_REPLY: the server could wait for data; set since MongoDB 1.6.
const AWAIT_CAPABLE: i32 = 8;

/// How an answer is sent.
#[derive(Debug, Clone, Copy)]
pub struct Reply {
    to: i32,
    form: Form,
    is_compressed: bool,
}

impl Reply {
    /// The answer to a message.
    #[must_use]
    pub fn to(message: &Message) -> Self {
        Self { to: message.id, form: message.form, is_compressed: message.is_compressed }
    }

    /// The bytes of the answer.
    #[must_use]
    pub fn bytes(&self, document: &RawDocument) -> Vec<u8> {
        let (operation, start): (i32, &[u8]) = match self.form {
            Form::Msg => (OP_MSG, &[0; 5]),
            Form::Query => (OP_REPLY, &query_start()),
        };
        let body = document.as_bytes();
        if self.is_compressed
            && let Ok(packed) = compression::pack(operation, &[start, body].concat())
        {
            return self.message(OP_COMPRESSED, &[], &packed);
        }
        self.message(operation, start, body)
    }

    fn message(&self, operation: i32, start: &[u8], body: &[u8]) -> Vec<u8> {
        let length = HEADER + start.len() + body.len();
        let mut message = Vec::with_capacity(length);
        for number in [i32::try_from(length).unwrap_or(i32::MAX), next_id(), self.to, operation] {
            message.extend_from_slice(&number.to_le_bytes());
        }
        message.extend_from_slice(start);
        message.extend_from_slice(body);
        message
    }
}

/// Flags, no cursor, from the first document, one document.
fn query_start() -> [u8; 20] {
    let mut start = [0; 20];
    let (flags, rest) = start.split_at_mut(4);
    flags.copy_from_slice(&AWAIT_CAPABLE.to_le_bytes());
    if let Some(count) = rest.get_mut(12..) {
        count.copy_from_slice(&1_i32.to_le_bytes());
    }
    start
}

fn next_id() -> i32 {
    static ID: AtomicI32 = AtomicI32::new(1);
    ID.fetch_add(1, Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::rawdoc;

    #[test]
    fn an_answer_has_the_form_of_its_question() {
        let body = rawdoc! { "ok": 1.0 };
        let of = |form| Reply { to: 7, form, is_compressed: false }.bytes(&body);
        let msg = of(Form::Msg);
        assert_eq!(&msg[8..16], [7_i32.to_le_bytes(), OP_MSG.to_le_bytes()].concat());
        assert_eq!(&msg[21..], body.as_bytes());
        let query = of(Form::Query);
        assert_eq!(&query[12..16], OP_REPLY.to_le_bytes());
        assert_eq!(&query[32..36], 1_i32.to_le_bytes());
        assert_eq!(&query[36..], body.as_bytes());
    }
}
