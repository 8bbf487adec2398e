//! The parts of a filter that hold for a document, or do not.

use bson::{Bson, Document, doc};

use super::keyword::{number, titled};
use super::leaf;
use super::schema;
use crate::query::dollar::is_operators;
use crate::query::error::QueryError;
use crate::query::expression::{Environment, Expression, Variables};
use crate::query::filter::Filter;

/// A part of a filter: an operator at its top, or one test of one path.
struct Clause<'a> {
    /// The operator, or the path.
    name: &'a str,
    value: &'a Bson,
    /// The operators of a path: the name of the one that is meant, and all of them.
    operator: Option<(&'a str, &'a Document)>,
}

/// Returns why a filter does not hold for a document or, with `holds`, why it does.
pub(super) fn explain_filter(filter: &Document, document: &Document, holds: bool) -> Option<Document> {
    joined(&clauses(filter), document, holds)
}

/// The parts of a filter, all of which have to hold.
fn clauses(filter: &Document) -> Vec<Clause<'_>> {
    let of_field = |(name, value)| fields(name, value);
    filter.iter().map(|(name, value)| (name.as_str(), value)).flat_map(of_field).collect()
}

fn fields<'a>(name: &'a str, value: &'a Bson) -> Vec<Clause<'a>> {
    match value {
        _ if name == "$comment" => Vec::new(),
        Bson::Document(operators) if !name.starts_with('$') && is_operators(operators.into()) => {
            let operators =
                operators.iter().filter(|(operator, _)| *operator != "$options").map(|pair| (pair, operators));
            operators
                .map(|((operator, value), all)| Clause { name, value, operator: Some((operator.as_str(), all)) })
                .collect()
        }
        value => vec![Clause { name, value, operator: None }],
    }
}

/// Returns what one part alone says, or all that fail (or hold) of several.
fn joined(clauses: &[Clause<'_>], document: &Document, holds: bool) -> Option<Document> {
    match clauses {
        [clause] => clause.explain(document, holds),
        clauses => {
            let listed = clauses.iter().enumerate().filter(|(_, clause)| clause.holds(document) == holds);
            let listed =
                listed.filter_map(|(index, clause)| Some(clause.numbered(index, clause.explain(document, holds)?)));
            Some(listing("$and", holds, listed.collect()))
        }
    }
}

fn listing(operator: &str, holds: bool, clauses: Vec<Document>) -> Document {
    let name = if holds { "clausesSatisfied" } else { "clausesNotSatisfied" };
    doc! { "operatorName": operator, name: clauses }
}

/// Whether a filter holds for a document.
fn holds(filter: &Document, document: &Document) -> bool {
    // What fails does not hold.
    Filter::parse_validator(filter).and_then(|filter| filter.matches_document(document)).unwrap_or(false)
}

impl Clause<'_> {
    /// The part as a filter.
    fn filter(&self) -> Document {
        match self.operator {
            None => doc! { self.name: self.value.clone() },
            Some(("$regex", all)) => doc! { self.name: all.clone() },
            Some((operator, _)) => doc! { self.name: { operator: self.value.clone() } },
        }
    }

    /// The details of one part of several, with the title of a schema.
    fn numbered(&self, index: usize, details: Document) -> Document {
        let mut numbered = doc! { "index": number(index) };
        if let ("$jsonSchema", Bson::Document(schema)) = (self.name, self.value) {
            titled(schema, &mut numbered);
        }
        numbered.insert("details", details);
        numbered
    }

    fn holds(&self, document: &Document) -> bool {
        holds(&self.filter(), document)
    }

    /// Why the part does not hold or, with `holds`, why it does.
    fn explain(&self, document: &Document, holds: bool) -> Option<Document> {
        match (self.name, self.operator, self.value) {
            ("$and" | "$or" | "$nor", _, Bson::Array(items)) => Some(self.of_several(items, document, holds)),
            ("$expr", ..) => Some(self.of_expression(document, holds)),
            ("$jsonSchema", _, Bson::Document(schema)) => Some(schema::explain(schema, document, holds)),
            (name, ..) if name.starts_with('$') => {
                let answer = if holds { "true" } else { "false" };
                let reason = format!("expression always evaluates to {answer}");
                Some(doc! { "operatorName": name, "specifiedAs": self.filter(), "reason": reason })
            }
            (path, Some(("$not", _)), value) => {
                let inner = fields(path, value);
                Some(doc! { "operatorName": "$not", "details": joined(&inner, document, !holds)? })
            }
            (path, operator, value) => {
                let (operator, operand) = match (operator, value) {
                    (Some((operator, _)), operand) => (operator, operand),
                    (None, Bson::RegularExpression(_)) => ("$regex", value),
                    (None, _) => ("$eq", value),
                };
                leaf::explain(path, (operator, operand), self.filter(), document, holds)
            }
        }
    }

    /// `$and`, `$or`, `$nor`: those of its filters on which it depends.
    fn of_several(&self, items: &[Bson], document: &Document, is_holding: bool) -> Document {
        let are_holding = is_holding != (self.name == "$nor");
        let listed = items.iter().filter_map(Bson::as_document).enumerate();
        let listed = listed.filter(|(_, filter)| holds(filter, document) == are_holding);
        let listed = listed.filter_map(|(index, filter)| {
            let (clauses, details) = (clauses(filter), explain_filter(filter, document, are_holding)?);
            Some(match clauses.as_slice() {
                [clause] => clause.numbered(index, details),
                _ => doc! { "index": number(index), "details": details },
            })
        });
        listing(self.name, are_holding, listed.collect())
    }

    /// `$expr`: what it gives, or its error.
    fn of_expression(&self, document: &Document, holds: bool) -> Document {
        let mut details = doc! { "operatorName": "$expr", "specifiedAs": self.filter() };
        match evaluated(self.value, document) {
            Ok(result) => {
                let reason = if holds { "expression did match" } else { "expression did not match" };
                details.insert("reason", reason);
                if let Some(result) = result {
                    details.insert("expressionResult", result);
                }
            }
            Err(error) => {
                details.insert("reason", "failed to evaluate aggregation expression");
                details.insert("details", doc! { "code": error.code, "errmsg": error.message });
            }
        }
        details
    }
}

fn evaluated(expression: &Bson, document: &Document) -> Result<Option<Bson>, QueryError> {
    let variables = Variables::default();
    let environment = Environment::new(document.into(), &variables, bson::DateTime::now());
    Expression::parse(expression)?.evaluate(&environment)
}
