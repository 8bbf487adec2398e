//! Reads `defglobal`.

use super::expression::evaluate;
use super::global::{Globals, named};
use super::lexer::{Lexer, TokenKind};
use super::value::Value;
use crate::formats::{Diagnostic, Span};

/// Reads global variables behind the word `defglobal`, with its `)`, and keeps their values; returns how they are
/// spelled. What is no assignment is skipped.
pub(super) fn read<'a>(lexer: &mut Lexer<'a>, open: Span, globals: &mut Globals) -> Result<Vec<&'a str>, Diagnostic> {
    let mut names = Vec::new();
    loop {
        let token = lexer.next()?;
        match token.kind {
            TokenKind::Close => return Ok(names),
            TokenKind::End => {
                let (line, column) = lexer.source.position(open.start);
                let error = lexer.wrong(token, "`)`");
                return Err(error.hint(format!("the list opened at {line}:{column} is not closed")));
            }
            TokenKind::Variable => {
                let Some(name) = named(lexer, token) else { continue };
                names.push(lexer.text(token));
                let equals = lexer.peek(0)?;
                if equals.kind == TokenKind::Symbol && lexer.text(equals) == "=" {
                    lexer.next()?;
                    let values = value(lexer, globals)?.map_err(|error| error.message().to_owned());
                    globals.set(name, values);
                }
            }
            _ => {}
        }
    }
}

/// The value behind `=`; an error inside where it is not known here.
fn value(lexer: &mut Lexer<'_>, globals: &Globals) -> Result<Result<Vec<Value>, Diagnostic>, Diagnostic> {
    let token = lexer.peek(0)?;
    match token.kind {
        TokenKind::Open => evaluate(lexer, globals),
        TokenKind::Close | TokenKind::End => Ok(Err(lexer.wrong(token, "a value"))),
        _ => {
            lexer.next()?;
            Ok(globals.values(lexer, token))
        }
    }
}
