//! The type hierarchy.

use std::collections::HashSet;
use std::sync::Arc;

use super::report::Report;
use super::table::{Named, Table, suggestion};
use crate::formats::pddl::ast::{self, Name};

/// The types a thing may have: one, or the alternatives of an `either`.
pub(super) type TypeSet = Arc<[u32]>;

/// `object`, which every type belongs to.
pub(super) const OBJECT: u32 = 0;

impl Named for Name {
    fn name(&self) -> &Name {
        self
    }
}

/// How many types there may be: a hierarchy is walked for every argument.
const LIMIT: usize = 10_000;

/// All types of a domain; the first is `object`.
#[derive(Debug, Clone)]
pub(super) struct Types {
    table: Table<Name>,
    /// The types a type belongs to directly, by its number.
    parents: Vec<Vec<u32>>,
}

impl Types {
    /// The types of a `:types` section. A type that is only named after a dash counts as declared.
    pub(super) fn read(section: &[ast::Typed], report: &mut Report<'_>) -> Self {
        let mut types = Self { table: Table::new(), parents: Vec::new() };
        types.declare(&Name::from("object"));
        for typed in section {
            types.declare(&typed.name);
        }
        for kind in section.iter().filter_map(|typed| typed.kind.as_ref()) {
            kind.iter().for_each(|name| types.declare(name));
        }
        if let Some(typed) = section.last().filter(|_| types.parents.len() > LIMIT) {
            report.error(typed.name.span(), format!("there are more than {LIMIT} types"));
            return types;
        }
        for typed in section {
            let (Some(child), Some(kind)) = (types.table.find(typed.name.as_str()), &typed.kind) else { continue };
            for parent in kind.iter() {
                types.link(child, parent, report);
            }
        }
        types
    }

    fn declare(&mut self, name: &Name) {
        if self.table.add(name.clone()).is_ok() {
            self.parents.push(Vec::new());
        }
    }

    fn link(&mut self, child: u32, parent: &Name, report: &mut Report<'_>) {
        let Some(number) = self.table.find(parent.as_str()) else { return };
        if child == OBJECT {
            if number != OBJECT {
                report.warning(parent.span(), "`object` is above all types; its supertype is ignored");
            }
            return;
        }
        if number == OBJECT {
            return;
        }
        if self.is_subtype(number, child) {
            let name = self.name(child).to_owned();
            report.error(parent.span(), format!("type `{name}` belongs to itself by way of `{parent}`"));
            return;
        }
        if let Some(parents) = self.parents.get_mut(child as usize) {
            parents.push(number);
        }
    }

    pub(super) fn name(&self, number: u32) -> &str {
        self.table.get(number).map_or("object", Name::as_str)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.table.items().iter().map(Name::as_str)
    }

    /// `t`, or `(either t u)`.
    pub(super) fn kind_text(&self, kind: &TypeSet) -> String {
        match kind.as_ref() {
            [only] => self.name(*only).to_owned(),
            all => {
                let names: Vec<&str> = all.iter().map(|number| self.name(*number)).collect();
                format!("(either {})", names.join(" "))
            }
        }
    }

    /// What is written after a dash; `object` where nothing is.
    pub(super) fn resolve(&self, kind: Option<&ast::Type>, report: &mut Report<'_>) -> TypeSet {
        let Some(names) = kind else { return [OBJECT].into() };
        names
            .iter()
            .map(|name| {
                self.table.find(name.as_str()).unwrap_or_else(|| {
                    if !report.is_full() {
                        let hint = suggestion(self.table.nearest(name.as_str()));
                        report.error_with(name.span(), format!("type `{name}` is not declared"), hint);
                    }
                    OBJECT
                })
            })
            .collect()
    }

    /// The number of a type that is declared.
    pub(super) fn find(&self, name: &str) -> Option<u32> {
        self.table.find(name)
    }

    /// Whether everything of type `child` is of type `parent`.
    pub(super) fn is_subtype(&self, child: u32, parent: u32) -> bool {
        if child == parent || parent == OBJECT {
            return true;
        }
        let mut seen = HashSet::from([child]);
        let mut pending = vec![child];
        while let Some(current) = pending.pop() {
            for above in self.parents.get(current as usize).into_iter().flatten() {
                if *above == parent {
                    return true;
                }
                if seen.insert(*above) {
                    pending.push(*above);
                }
            }
        }
        false
    }

    /// Whether everything of kind `given` is of kind `wanted`.
    pub(super) fn fits(&self, given: &TypeSet, wanted: &TypeSet) -> bool {
        given.iter().all(|given| wanted.iter().any(|wanted| self.is_subtype(*given, *wanted)))
    }

    /// Whether one thing could be of both kinds.
    pub(super) fn overlap(&self, one: &TypeSet, other: &TypeSet) -> bool {
        let count = u32::try_from(self.parents.len()).unwrap_or(u32::MAX);
        self.fits(one, other)
            || self.fits(other, one)
            || (0..count).any(|number| {
                let below = |kind: &TypeSet| kind.iter().any(|above| self.is_subtype(number, *above));
                below(one) && below(other)
            })
    }
}
