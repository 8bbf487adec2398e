//! Global variables, as far as their values are known without a running CLIPS.

use std::cell::RefCell;
use std::collections::{HashMap, HashSet};

use super::lexer::{Lexer, Token, TokenKind};
use super::value::Value;
use crate::formats::Diagnostic;

/// The values of global variables, by name without `?*` and `*`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Globals {
    values: HashMap<String, Result<Vec<Value>, String>>,
    used: RefCell<HashSet<String>>,
}

impl Globals {
    /// Keeps the values of a variable, or why they are not known.
    pub(super) fn set(&mut self, name: &str, values: Result<Vec<Value>, String>) {
        self.values.insert(name.to_owned(), values);
    }

    /// Whether the value of a variable was used; it is spelled `?*name*`.
    #[must_use]
    pub fn is_used(&self, spelled: &str) -> bool {
        bare(spelled).is_some_and(|name| self.used.borrow().contains(name))
    }

    /// The values that a word stands for where facts are made: its own, or those of a global variable.
    pub(super) fn values(&self, lexer: &Lexer<'_>, token: Token) -> Result<Vec<Value>, Diagnostic> {
        let Some(name) =
            Some(token).filter(|token| token.kind == TokenKind::Variable).and_then(|_| named(lexer, token))
        else {
            return lexer.value(token).map(|value| vec![value]);
        };
        match self.values.get(name) {
            Some(Ok(values)) => {
                self.used.borrow_mut().insert(name.to_owned());
                Ok(values.clone())
            }
            Some(Err(reason)) => {
                let message = format!("the value of `?*{name}*` is known only to a running CLIPS");
                Err(Diagnostic::new(lexer.source, token.span, message).hint(format!("in its defglobal: {reason}")))
            }
            None => Err(lexer
                .wrong(token, "a value")
                .hint(format!("no defglobal before this place, or in --deftemplates, defines `?*{name}*`"))),
        }
    }
}

/// The name in `?*name*`, without its module.
pub(super) fn named<'a>(lexer: &Lexer<'a>, token: Token) -> Option<&'a str> {
    bare(lexer.text(token))
}

fn bare(text: &str) -> Option<&str> {
    let name = text.trim_start_matches('$').strip_prefix("?*")?.strip_suffix('*')?;
    Some(name.rsplit_once("::").map_or(name, |(_, name)| name))
}
