//! Resume tokens: where in the order of changes a stream is.
//!
//! `{_data: HEX}`: the position, 8 bytes so that tokens sort as they follow each other, and what is there.

use bson::{Bson, Document, doc};

use crate::serve::failure::{Failure, codes};

/// A place in the order of changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Token {
    pub(super) position: i64,
    pub(super) kind: TokenKind,
}

/// What is at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TokenKind {
    /// A change.
    Change,
    /// The end of a stream, behind the change that ended it.
    End,
    /// Nothing; all changes up to it have been looked at.
    Between,
}

impl Token {
    pub(super) fn to_document(self) -> Document {
        let kind: u8 = match self.kind {
            TokenKind::Change => 1,
            TokenKind::End => 2,
            TokenKind::Between => 3,
        };
        doc! { "_data": format!("{:016x}{kind:02x}", self.position) }
    }

    /// Reads a token.
    ///
    /// # Errors
    /// Where it is none of these.
    pub(super) fn read(token: &Document) -> Result<Self, Failure> {
        let data = match token.get("_data") {
            Some(Bson::String(data)) if data.is_empty() => {
                return Err(Failure::new(EMPTY, "invalid empty resume token"));
            }
            Some(Bson::String(data)) if !is_hexadecimal(data) => {
                return Err(Failure::new(codes::FAILED_TO_PARSE, "resume token string was not a valid hex string"));
            }
            Some(Bson::String(data)) if data.len() == 18 => data,
            Some(Bson::String(_)) => return Err(invalid()),
            _ => return Err(Failure::new(NO_TEXT, "a resume token has a text under `_data`")),
        };
        let (position, kind) = data.split_at_checked(16).ok_or_else(invalid)?;
        let kind = match kind {
            "01" => TokenKind::Change,
            "02" => TokenKind::End,
            "03" => TokenKind::Between,
            _ => return Err(invalid()),
        };
        let position = i64::from_str_radix(position, 16).map_err(|_| invalid())?;
        Ok(Self { position, kind })
    }
}

/// MongoDB's codes of tokens that are none.
const EMPTY: i32 = 40_649;
const NO_TEXT: i32 = 40_647;

fn is_hexadecimal(text: &str) -> bool {
    text.len().is_multiple_of(2) && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

fn invalid() -> Failure {
    let message = "the resume token was not made by this memory; expected one that a change stream of it gave";
    Failure::new(codes::INVALID_TOKEN, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_read_as_written_and_sort_by_position() {
        let token = |position| Token { position, kind: TokenKind::Change };
        let text = |position| token(position).to_document().get_str("_data").unwrap().to_owned();
        assert_eq!(Token::read(&token(7).to_document()), Ok(token(7)));
        assert!(text(9) < text(10) && text(255) < text(256));
        for (wrong, code) in [
            (doc! {}, NO_TEXT),
            (doc! { "_data": 3 }, NO_TEXT),
            (doc! { "_data": "" }, EMPTY),
            (doc! { "_data": "82a" }, codes::FAILED_TO_PARSE),
            (doc! { "_data": "x".repeat(18) }, codes::FAILED_TO_PARSE),
            (doc! { "_data": "82ab" }, codes::INVALID_TOKEN),
            (doc! { "_data": "8".repeat(18) }, codes::INVALID_TOKEN),
        ] {
            assert_eq!(Token::read(&wrong).unwrap_err().code, code, "{wrong}");
        }
    }
}
