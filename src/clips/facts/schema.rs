//! The deftemplates and global variables that are known.

use std::collections::BTreeMap;

use crate::formats::clips::{Globals, Template};

/// Templates by name, and the global variables of the texts that they are from.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Schema {
    /// The global variables.
    pub globals: Globals,
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

    /// The names, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.templates.keys().map(String::as_str)
    }
}

/// The one ordered fact that every CLIPS up to 6.30 asserts by itself.
pub const INITIAL: &str = "initial-fact";
