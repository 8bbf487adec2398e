//! Which documents an operation sees.

use bson::{Bson, DateTime, Document, doc};

use crate::store::{Namespace, metadata};

/// What an operation sees: documents that have not decayed, and of those that
/// computables made, the ones that are for it.
#[derive(Debug, Clone)]
pub(in crate::memory) struct View {
    at: DateTime,
    /// By namespace, the computables whose documents count only …
    limited: Vec<(Namespace, Vec<String>)>,
    /// … where one of these computations made them.
    tokens: Vec<Bson>,
}

impl View {
    /// What is visible at a time.
    pub(in crate::memory) fn at(at: DateTime) -> Self {
        Self { at, limited: Vec::new(), tokens: Vec::new() }
    }

    pub(super) fn limit(&mut self, ns: &Namespace, name: &str) {
        let place = match self.limited.iter().position(|(other, _)| other == ns) {
            Some(place) => place,
            None => {
                self.limited.push((ns.clone(), Vec::new()));
                self.limited.len() - 1
            }
        };
        if let Some((_, names)) = self.limited.get_mut(place)
            && !names.iter().any(|other| other == name)
        {
            names.push(name.to_owned());
        }
    }

    pub(super) fn allow(&mut self, token: impl Into<Bson>) {
        self.tokens.push(token.into());
    }

    /// Whether documents are in sight that may be computed anew meanwhile.
    pub(in crate::memory) fn is_computed(&self) -> bool {
        !self.tokens.is_empty()
    }

    /// What is true of the documents that are seen.
    pub(in crate::memory) fn visible(&self, ns: &Namespace) -> Document {
        let mut visible = metadata::visible(self.at);
        if let Some((_, names)) = self.limited.iter().find(|(other, _)| other == ns) {
            let others = doc! { metadata::computation("by"): { "$in": names }, metadata::computation("token"): { "$nin": &self.tokens } };
            visible.insert("$nor", vec![others]);
        }
        visible
    }

    /// The filter, for the documents that are seen.
    pub(in crate::memory) fn filter(&self, ns: &Namespace, filter: &Document) -> Document {
        let visible = self.visible(ns);
        if filter.is_empty() {
            visible
        } else {
            doc! { "$and": [filter.clone(), visible] }
        }
    }
}
