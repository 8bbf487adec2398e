//! The deftemplates and global variables that are known.

use std::collections::BTreeMap;

use crate::formats::clips::{Globals, Slot, Template};
use crate::formats::{Respelled, alike};

/// Templates by name, and the global variables of the texts that they are from.
#[derive(Debug, Default)]
pub struct Schema {
    /// The global variables.
    pub globals: Globals,
    /// The slots that were found by another spelling.
    pub respelled: Respelled,
    templates: BTreeMap<String, Template>,
}

impl Schema {
    /// Adds a template, in place of an earlier one of the same name.
    pub fn add(&mut self, template: Template) {
        self.templates.insert(template.name.clone(), template);
    }

    /// The template of a fact; a module in front of its name does not matter.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Template> {
        let local = name.rsplit_once("::").map_or(name, |(_, local)| local);
        self.templates.get(name).or_else(|| self.templates.get(local))
    }

    /// The slot of this name, or one whose name differs from it only in hyphens and underscores and is not among those
    /// that are `given`.
    pub(super) fn slot<'t>(
        &self,
        template: &'t Template,
        name: &str,
        given: impl Fn(&str) -> bool,
    ) -> Option<&'t Slot> {
        template.slot(name).or_else(|| {
            let others = template.slots.iter().map(|slot| slot.name.as_str()).filter(|other| !given(other));
            let found = alike(name, others)?;
            self.respelled.add(name, found);
            template.slot(found)
        })
    }

    /// The names, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.templates.keys().map(String::as_str)
    }
}

/// The one ordered fact that every CLIPS up to 6.30 asserts by itself.
pub const INITIAL: &str = "initial-fact";
