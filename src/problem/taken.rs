//! What a template takes from outside.

use std::collections::BTreeSet;

use super::Syntax;
use crate::formats::alike;

/// What a template takes from outside.
#[derive(Debug, Default)]
pub(super) struct Taken {
    /// The names of its parameters.
    pub(super) names: BTreeSet<String>,
    pub(super) takes_goal: bool,
    /// Whether it may take any: it computes their names, or has mistakes of its own.
    pub(super) is_unknown: bool,
}

impl Taken {
    /// Of a template that cannot be read.
    pub(super) fn unknown() -> Self {
        Self { is_unknown: true, takes_goal: true, ..Self::default() }
    }

    /// Whether a parameter is used: under its own name, or by the keys of its value.
    pub(super) fn takes(&self, name: &str, syntax: Syntax) -> bool {
        let is_key = |taken: &str| taken.strip_prefix(name).is_some_and(|rest| rest.starts_with('_'));
        let has_keys = || syntax == Syntax::Marker && self.names.iter().any(|taken| is_key(taken));
        self.is_unknown || alike(name, self.names.iter().map(String::as_str)).is_some() || has_keys()
    }
}
