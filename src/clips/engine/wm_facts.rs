//! What one engine knows of the world model that executives (CX) keep in common: facts `wm-fact`, a document each.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;

use bson::{DateTime, Document};

/// The template of the facts.
pub(super) const TEMPLATE: &str = "wm-fact";

/// What is known of one fact.
pub(super) struct Known {
    /// The keys of its document that say something; none where it was removed.
    pub(super) content: Option<Document>,
    /// When it was changed, by the clock of the engine that did.
    pub(super) time: DateTime,
}

/// The facts of one engine.
#[derive(Default)]
pub(super) struct WmFacts {
    /// The beginnings of the keys of the facts that are kept in common.
    pub(super) prefixes: RefCell<Vec<Vec<String>>>,
    /// By `id`.
    pub(super) known: RefCell<HashMap<String, Known>>,
    /// Whether the missing identity was reported.
    pub(super) is_told: Cell<bool>,
}

impl WmFacts {
    /// Whether facts with this key are kept in common.
    pub(super) fn is_enabled(&self, key: &[String]) -> bool {
        self.prefixes.borrow().iter().any(|prefix| key.starts_with(prefix))
    }

    /// Keeps what is known of a fact.
    pub(super) fn keep(&self, id: &str, content: Option<Document>, time: DateTime) {
        self.known.borrow_mut().insert(id.to_owned(), Known { content, time });
    }
}

/// The key that an id stands for: of `/domain/fact/at?robot=R1&to=A,B` it is
/// `domain fact at args? robot R1 to [ A B ]`.
pub(super) fn key(id: &str) -> Vec<String> {
    let (path, parameters) = id.split_once('?').map_or((id, None), |(path, parameters)| (path, Some(parameters)));
    let words = |text: &str, separator: char| -> Vec<String> {
        text.split(separator).filter(|word| !word.is_empty()).map(str::to_owned).collect()
    };
    let mut key = words(path, '/');
    let Some(parameters) = parameters else { return key };
    key.push("args?".to_owned());
    for parameter in words(parameters, '&') {
        let (name, value) = parameter.split_once('=').unwrap_or((&parameter, ""));
        key.push(name.to_owned());
        if value.is_empty() || value.contains(',') {
            key.push("[".to_owned());
            key.extend(words(value, ','));
            key.push("]".to_owned());
        } else {
            key.push(value.to_owned());
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_a_key_in_one_word() {
        let spelled = |id: &str| key(id).join(" ");
        assert_eq!(
            spelled("/domain/fact/at?robot=R1&to=A,B&none="),
            "domain fact at args? robot R1 to [ A B ] none [ ]"
        );
        assert_eq!(spelled("/cx/identity"), "cx identity");
        assert_eq!(spelled("/domain/"), "domain");
        let facts = WmFacts::default();
        facts.prefixes.borrow_mut().push(key("/domain/"));
        assert!(facts.is_enabled(&key("/domain/fact/x")) && !facts.is_enabled(&key("/domains/x")));
    }
}
