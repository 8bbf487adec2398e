//! Actions of the driver, with what a request says beside its query.

use bson::{Bson, Document};

use crate::deadline;
use crate::query::{Collation, QueryError};
use crate::saturate::to_i64;
use crate::store::Hint;

/// An action of the driver with those of the modifiers of a request that are named: the driver's actions have methods of
/// the same names, and no trait.
macro_rules! modified {
    ($action:expr, $modifiers:expr, $($kind:ident)+) => {{
        let (mut action, modifiers): (_, &Modifiers) = ($action, $modifiers);
        $(modified!(@$kind action, modifiers);)+
        action
    }};
    (@collation $action:ident, $modifiers:ident) => {
        if let Some(collation) = &$modifiers.collation {
            $action = $action.collation(of_driver(collation)?);
        }
    };
    (@variables $action:ident, $modifiers:ident) => {
        if !$modifiers.variables.is_empty() {
            $action = $action.let_vars($modifiers.variables.clone());
        }
    };
    // What is left of the time that the operation may take; zero would be no limit.
    (@time $action:ident, $modifiers:ident) => {
        if let Some(left) = crate::deadline::left() {
            $action = $action.max_time(left.max(std::time::Duration::from_millis(1)));
        }
    };
    (@hint $action:ident, $modifiers:ident) => {
        if let Some(hint) = &$modifiers.hint {
            $action = $action.hint(hint_of_driver(hint));
        }
    };
}

/// An action of the driver that stores documents also where they do not pass the validator of their collection, where the
/// store does so at present.
macro_rules! bypassing {
    ($store:expr, $action:expr) => {{
        let mut action = $action;
        if $store.is_bypassing.get() {
            action = action.bypass_document_validation(true);
        }
        action
    }};
}

pub(super) use {bypassing, modified};

/// What is left of the time that an operation may take, in milliseconds, as a command takes it: zero would be no limit.
pub(super) fn max_time() -> Option<i64> {
    deadline::left().map(|left| to_i64(left.as_millis().max(1)))
}

/// A collation as the driver takes it.
pub(super) fn of_driver(collation: &Collation) -> Result<mongodb::options::Collation, QueryError> {
    Ok(bson::deserialize_from_document(collation.definition().clone())?)
}

/// A hint as the driver takes it.
pub(super) fn hint_of_driver(hint: &Hint) -> mongodb::options::Hint {
    match hint.to_bson() {
        Bson::String(name) => mongodb::options::Hint::Name(name),
        Bson::Document(keys) => mongodb::options::Hint::Keys(keys),
        _ => mongodb::options::Hint::Keys(Document::new()),
    }
}
