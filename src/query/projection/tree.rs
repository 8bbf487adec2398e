//! The compiled projection: a tree of names.

use crate::query::error::{QueryError, Result};
use crate::query::expression::Expression;

/// The place of a projection, which decides what it may contain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::query) enum Policy {
    /// In `find`.
    Find,
    /// In a pipeline.
    Stage,
}

/// How a projection treats fields that it does not name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::query) enum Mode {
    /// Removes them.
    Include,
    /// Keeps them, and elements of arrays that are not documents.
    Exclude,
    /// They stay; a scalar on the path of a computed field is replaced by a document.
    Add,
}

/// A level of the tree.
#[derive(Debug)]
pub(in crate::query) struct Branch {
    pub(super) mode: Mode,
    pub(super) children: Vec<(String, Treatment)>,
}

/// How a projection treats a field.
#[derive(Debug)]
pub(in crate::query) enum Treatment {
    /// It is given, or it is left out, by the mode.
    Named,
    Branch(Branch),
    Computed(Expression),
}

impl Branch {
    pub(super) fn new(mode: Mode) -> Self {
        Self { mode, children: Vec::new() }
    }

    pub(super) fn child(&self, name: &[u8]) -> Option<&Treatment> {
        self.children.iter().find(|(known, _)| known.as_bytes() == name).map(|(_, item)| item)
    }

    /// Returns whether anything under this branch is computed.
    pub(super) fn computes(&self) -> bool {
        self.children.iter().any(|(_, item)| match item {
            Treatment::Computed(_) => true,
            Treatment::Branch(branch) => branch.computes(),
            Treatment::Named => false,
        })
    }

    /// Puts an item at a dotted path.
    ///
    /// # Errors
    /// If another item is there, or on the way.
    pub(super) fn insert(&mut self, path: &str, item: Treatment) -> Result<()> {
        check_path(path)?;
        let parts: Vec<&str> = path.split('.').collect();
        self.insert_at(&parts, item, path)
    }

    fn insert_at(&mut self, parts: &[&str], item: Treatment, path: &str) -> Result<()> {
        let Some((name, rest)) = parts.split_first() else { return Ok(()) };
        let mode = self.mode;
        let place = self.children.iter().position(|(known, _)| known == name);
        if rest.is_empty() {
            if place.is_some() {
                return Err(QueryError::invalid(31_250, format!("path collision at {path}")));
            }
            self.children.push(((*name).to_owned(), item));
            return Ok(());
        }
        let place = place.unwrap_or_else(|| {
            self.children.push(((*name).to_owned(), Treatment::Branch(Self::new(mode))));
            self.children.len() - 1
        });
        match self.children.get_mut(place) {
            Some((_, Treatment::Branch(branch))) => branch.insert_at(rest, item, path),
            _ => Err(QueryError::invalid(31_249, format!("path collision at {path}"))),
        }
    }
}

/// Refuses paths with empty parts, parts with a `$`, and very long ones.
pub(super) fn check_path(path: &str) -> Result<()> {
    crate::query::path::check_plain(path)?;
    if path.contains('\0') {
        return Err(QueryError::invalid(16_411, "a field path may not contain a NUL"));
    }
    if path.split('.').count() > 200 {
        return Err(QueryError::invalid(5_729_101, "a field path has more than 200 parts"));
    }
    Ok(())
}
