//! A problem's tree as documents.

use std::collections::{HashMap, HashSet};

use bson::{Bson, Document, doc};

use crate::formats::pddl::ast::{Atom, Condition, ConditionKind, Expression, Init, Name, Problem, Term, Type, Typed};
use crate::formats::{Diagnostic, Source};
use crate::problem::names;

type Fallible<T> = Result<T, Diagnostic>;

/// Numbers up to here are whole numbers in a memory, too.
const WHOLE: f64 = 9_007_199_254_740_992.0;

pub(super) fn of(source: &Source, tree: &Problem) -> Fallible<Vec<Document>> {
    let mut scribe = Scribe { source, spellings: HashMap::new(), objects: HashSet::new() };
    for object in &tree.objects {
        let name = scribe.spelling(&object.name);
        scribe.objects.insert(name.to_lowercase());
    }
    let mut documents = Vec::with_capacity(tree.objects.len() + tree.init.len() + 8);
    for object in &tree.objects {
        let mut document = doc! { "relation": "domain-object", "name": scribe.name(&object.name)? };
        if let Some(kind) = &object.kind {
            document.insert("type", scribe.kind(kind)?);
        }
        documents.push(document);
    }
    for element in &tree.init {
        documents.push(scribe.init(element)?);
    }
    let parts = match tree.goal.as_ref() {
        None => &[],
        Some(Condition { kind: ConditionKind::And(parts), .. }) => parts.as_slice(),
        Some(goal) => std::slice::from_ref(goal),
    };
    for part in parts {
        documents.push(doc! { "relation": "domain-goal", "condition": scribe.condition(part)? });
    }
    if let Some(constraints) = &tree.constraints {
        documents.push(doc! { "relation": "domain-constraints", "condition": scribe.condition(constraints)? });
    }
    if let Some(metric) = &tree.metric {
        let direction = if metric.minimize { "minimize" } else { "maximize" };
        let expression = scribe.expression(&metric.expression)?;
        documents.push(doc! { "relation": "domain-metric", "direction": direction, "expression": expression });
    }
    Ok(documents)
}

struct Scribe<'a> {
    source: &'a Source,
    /// Names by their folded case, as they were first written.
    spellings: HashMap<String, String>,
    /// The names of the problem's own objects, which may be spelled in any way.
    objects: HashSet<String>,
}

impl Scribe<'_> {
    fn spelling(&mut self, name: &Name) -> String {
        let spelling = self.spellings.entry(name.as_str().to_lowercase());
        spelling.or_insert_with(|| name.as_str().to_owned()).clone()
    }

    /// A name as text of the memory.
    fn name(&mut self, name: &Name) -> Fallible<String> {
        let spelling = self.spelling(name);
        if self.objects.contains(&spelling.to_lowercase()) {
            return Ok(names::restore(&spelling));
        }
        if is_plain(&spelling) || is_plain(&names::restore(&spelling)) {
            return Ok(spelling);
        }
        let message = format!("`{name}` belongs to the domain, and a template cannot write it as it is");
        Err(Diagnostic::new(self.source, name.span(), message)
            .hint("call it something of letters, digits, - and _ that begins with a letter"))
    }

    fn kind(&mut self, kind: &Type) -> Fallible<Bson> {
        match kind.as_ref() {
            [only] => self.name(only).map(Bson::String),
            all => all.iter().map(|name| self.name(name).map(Bson::String)).collect::<Fallible<_>>().map(Bson::Array),
        }
    }

    fn init(&mut self, element: &Init) -> Fallible<Document> {
        let fact = |scribe: &mut Self, relation: &str, atom: &Atom, holds: bool| {
            let mut document = doc! { "relation": relation, "name": scribe.name(&atom.name)? };
            document.insert("param_values", scribe.terms(&atom.arguments)?);
            if !holds {
                document.insert("negated", true);
            }
            Ok(document)
        };
        match element {
            Init::Atom(atom) => fact(self, "domain-fact", atom, true),
            Init::Not(atom) => fact(self, "domain-fact", atom, false),
            Init::At(time, holds, atom) => {
                let mut document = fact(self, "domain-timed-fact", atom, *holds)?;
                document.insert("time", number(*time));
                Ok(document)
            }
            Init::Value(target, value) => {
                let mut document = match target {
                    Term::Call(atom) => fact(self, "domain-function", atom, true)?,
                    Term::Name(name) | Term::Variable(name) => {
                        doc! { "relation": "domain-function", "name": self.name(name)? }
                    }
                };
                document.insert("value", self.expression(value)?);
                Ok(document)
            }
        }
    }

    fn terms(&mut self, terms: &[Term]) -> Fallible<Vec<Bson>> {
        terms.iter().map(|term| self.term(term)).collect()
    }

    fn term(&mut self, term: &Term) -> Fallible<Bson> {
        match term {
            Term::Name(name) => self.name(name).map(Bson::String),
            Term::Variable(name) => Ok(doc! { "variable": self.variable(name)? }.into()),
            Term::Call(atom) => self.atom(atom).map(Bson::Document),
        }
    }

    /// A variable's name without its `?`.
    fn variable(&mut self, name: &Name) -> Fallible<String> {
        let bare = Name::new(name.as_str().trim_start_matches('?'), name.span());
        self.name(&bare)
    }

    fn atom(&mut self, atom: &Atom) -> Fallible<Document> {
        Ok(doc! { "name": self.name(&atom.name)?, "args": self.terms(&atom.arguments)? })
    }

    fn operator<'a>(&mut self, word: &str, parts: impl IntoIterator<Item = &'a Condition>) -> Fallible<Document> {
        let parts = parts.into_iter().map(|part| self.condition(part)).collect::<Fallible<Vec<_>>>()?;
        Ok(doc! { "op": word, "parts": parts })
    }

    fn condition(&mut self, condition: &Condition) -> Fallible<Document> {
        match &condition.kind {
            ConditionKind::Atom(atom) => self.atom(atom),
            ConditionKind::Comparison(comparator, left, right) => {
                let (left, right) = (self.expression(left)?, self.expression(right)?);
                Ok(doc! { "op": comparator.word(), "left": left, "right": right })
            }
            ConditionKind::Not(inner) => self.operator("not", [&**inner]),
            ConditionKind::And(parts) => self.operator("and", parts),
            ConditionKind::Or(parts) => self.operator("or", parts),
            ConditionKind::Imply(left, right) => self.operator("imply", [&**left, right]),
            ConditionKind::Timed(moment, inner) => self.operator(moment.word(), [&**inner]),
            ConditionKind::Forall(variables, inner) => {
                let mut document = self.operator("forall", [&**inner])?;
                document.insert("variables", self.variables(variables)?);
                Ok(document)
            }
            ConditionKind::Exists(variables, inner) => {
                let mut document = self.operator("exists", [&**inner])?;
                document.insert("variables", self.variables(variables)?);
                Ok(document)
            }
            ConditionKind::Preference(name, inner) => {
                let mut document = self.operator("preference", [&**inner])?;
                if let Some(name) = name {
                    document.insert("name", self.name(name)?);
                }
                Ok(document)
            }
            ConditionKind::Modal(modal, numbers, parts) => {
                let mut document = self.operator(modal.word(), parts)?;
                document.insert("numbers", numbers.iter().copied().map(number).collect::<Vec<_>>());
                Ok(document)
            }
        }
    }

    fn variables(&mut self, variables: &[Typed]) -> Fallible<Vec<Document>> {
        let document = |variable: &Typed| {
            let mut document = doc! { "name": self.variable(&variable.name)? };
            if let Some(kind) = &variable.kind {
                document.insert("type", self.kind(kind)?);
            }
            Ok(document)
        };
        variables.iter().map(document).collect()
    }

    fn expression(&mut self, expression: &Expression) -> Fallible<Bson> {
        match expression {
            Expression::Number(value, _) => Ok(number(*value)),
            Expression::Term(term) => self.term(term),
            Expression::Elapsed(_) => Ok(doc! { "elapsed": true }.into()),
            Expression::Operation(operator, operands, _) => {
                let parts = operands.iter().map(|operand| self.expression(operand)).collect::<Fallible<Vec<_>>>()?;
                Ok(doc! { "op": operator.word(), "parts": parts }.into())
            }
        }
    }
}

fn number(value: f64) -> Bson {
    if value.fract() == 0.0 && value.abs() < WHOLE { Bson::Int64(value as i64) } else { Bson::Double(value) }
}

/// A name that templates write as it is.
fn is_plain(name: &str) -> bool {
    names::mangle(name) == name
}
