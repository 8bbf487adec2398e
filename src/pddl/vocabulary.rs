//! What a domain declares: types, constants, predicates, functions.

use super::model::Variable;
use super::report::Report;
use super::table::{Named, Table};
use super::types::{OBJECT, TypeSet, Types};
use crate::formats::Span;
use crate::formats::pddl::ast::{self, Name};

/// A constant or an object, in its original spelling.
#[derive(Debug, Clone)]
pub(super) struct ObjectEntry {
    pub(super) name: Name,
    pub(super) kind: TypeSet,
}

impl Named for ObjectEntry {
    fn name(&self) -> &Name {
        &self.name
    }
}

/// A predicate.
#[derive(Debug, Clone)]
pub(super) struct PredicateEntry {
    pub(super) name: Name,
    pub(super) parameters: Vec<Variable>,
}

impl Named for PredicateEntry {
    fn name(&self) -> &Name {
        &self.name
    }
}

/// A function; its values are numbers unless they have a kind.
#[derive(Debug, Clone)]
pub(super) struct FunctionEntry {
    pub(super) name: Name,
    pub(super) parameters: Vec<Variable>,
    pub(super) values: Option<TypeSet>,
}

impl Named for FunctionEntry {
    fn name(&self) -> &Name {
        &self.name
    }
}

/// Everything that names in conditions and effects may refer to.
#[derive(Debug, Clone)]
pub(super) struct Vocabulary {
    pub(super) types: Types,
    pub(super) predicates: Table<PredicateEntry>,
    pub(super) functions: Table<FunctionEntry>,
}

impl Vocabulary {
    pub(super) fn read(tree: &ast::Domain, report: &mut Report<'_>) -> Self {
        let types = Types::read(&tree.types, report);
        let mut predicates = Table::new();
        for signature in &tree.predicates {
            let parameters = variables(&types, &signature.parameters, report);
            let entry = PredicateEntry { name: signature.name.clone(), parameters };
            if let Err(first) = predicates.add(entry) {
                twice("predicate", &signature.name, &first.name, report);
            }
        }
        let mut functions = Table::new();
        for function in &tree.functions {
            let ast::Signature { name, parameters } = &function.signature;
            let numeric = function.kind.as_ref().is_none_or(|kind| kind.len() == 1 && kind[0].is("number"));
            let values = (!numeric).then(|| types.resolve(function.kind.as_ref(), report));
            let parameters = variables(&types, parameters, report);
            if let Err(first) = functions.add(FunctionEntry { name: name.clone(), parameters, values }) {
                twice("function", name, &first.name, report);
            }
        }
        Self { types, predicates, functions }
    }
}

/// `?x - t …` with the types resolved.
pub(super) fn variables(types: &Types, list: &[ast::Typed], report: &mut Report<'_>) -> Vec<Variable> {
    list.iter()
        .map(|typed| Variable { name: typed.name.clone(), kind: types.resolve(typed.kind.as_ref(), report) })
        .collect()
}

/// Complains about parameters of an action that are there twice. Real predicates have such; they mean nothing there.
pub(super) fn check_doubles(variables: &[Variable], report: &mut Report<'_>) {
    let mut seen = std::collections::HashSet::new();
    for variable in variables {
        if !seen.insert(super::table::lower(variable.name.as_str())) {
            report.error(variable.name.span(), format!("parameter `{}` is there twice", variable.name));
        }
    }
}

/// Complains about a second declaration.
pub(super) fn twice(what: &str, second: &Name, first: &Name, report: &mut Report<'_>) {
    if report.is_full() {
        return;
    }
    let case = if second.as_str() == first.as_str() { "" } else { "; PDDL does not tell upper and lower case apart" };
    let place = report.position(first.span());
    report.error_with(
        second.span(),
        format!("{what} `{second}` is declared twice"),
        format!("the first one is `{first}` at {place}{case}"),
    );
}

/// Adds constants or objects to those there are. Returns the places of those that repeat a constant with its type, which are
/// left out.
pub(super) fn add_objects(
    objects: &mut Table<ObjectEntry>,
    what: &str,
    list: &[ast::Typed],
    types: &Types,
    report: &mut Report<'_>,
) -> Vec<Span> {
    let mut repeated = Vec::new();
    let constants = objects.items().len();
    let mut last: Option<(&ast::Type, TypeSet)> = None;
    let untyped: TypeSet = [OBJECT].into();
    for typed in list {
        let kind = match (&typed.kind, &last) {
            (None, _) => untyped.clone(),
            (Some(kind), Some((same, resolved))) if std::sync::Arc::ptr_eq(kind, same) => resolved.clone(),
            (Some(kind), _) => {
                let resolved = types.resolve(Some(kind), report);
                last = Some((kind, resolved.clone()));
                resolved
            }
        };
        let entry = ObjectEntry { name: typed.name.clone(), kind };
        let kind = entry.kind.clone();
        if let Err(first) = objects.add(entry) {
            let (first, is_same) = (first.name.clone(), first.kind == kind);
            let is_constant = objects.find(first.as_str()).is_some_and(|number| (number as usize) < constants);
            let span = typed.name.span();
            if is_constant && is_same {
                report.warning(
                    span,
                    format!("object `{}` is a constant of the domain already; leave it out here", typed.name),
                );
                repeated.push(span);
            } else if is_constant {
                report.error_with(
                    span,
                    format!("object `{}` is already a constant of the domain, of another type", typed.name),
                    format!("the domain calls it `{first}`; leave it out of `:objects`"),
                );
            } else {
                twice(what, &typed.name, &first, report);
            }
        }
    }
    repeated
}
