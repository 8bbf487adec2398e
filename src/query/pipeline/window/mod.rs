//! `$setWindowFields`: fields computed over the documents around each one.

mod bounds;
mod covariance;
mod function;
mod member;
mod order;
mod rolling;
mod series;

use bson::{Bson, Document, RawDocumentBuf};

use super::documents::{Documents, encode};
use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::key;
use crate::query::view::Fields;
use bounds::Bounds;
use function::Function;
use member::{Member, wrong};
use order::Order;

/// A compiled `$setWindowFields`.
#[derive(Debug)]
pub(super) struct Window {
    partition: Option<Expression>,
    order: Order,
    output: Vec<(Vec<String>, Function, Bounds)>,
}

impl Window {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        if let Some(name) = spec.keys().find(|name| !matches!(name.as_str(), "partitionBy" | "sortBy" | "output")) {
            return Err(QueryError::invalid(40_415, format!("'$setWindowFields.{name}' is an unknown field")));
        }
        let partition = spec.get("partitionBy").map(|value| Expression::parse_in(value, scope)).transpose()?;
        let order = match spec.get("sortBy") {
            None | Some(Bson::Null) => Order::default(),
            Some(Bson::Document(pattern)) => Order::parse(pattern)?,
            Some(_) => return Err(QueryError::type_mismatch("the 'sortBy' of $setWindowFields must be an object")),
        };
        let Some(Bson::Document(fields)) = spec.get("output") else {
            return Err(match spec.get("output") {
                None => QueryError::invalid(40_414, "$setWindowFields needs 'output'"),
                Some(_) => QueryError::type_mismatch("the 'output' of $setWindowFields must be an object"),
            });
        };
        let mut window = Self { partition, order, output: Vec::new() };
        for (path, value) in fields {
            let Bson::Document(value) = value else {
                return Err(wrong(format!("the field '{path}' of $setWindowFields must be an object")));
            };
            let target = output_path(path)?;
            if window.output.iter().any(|(other, ..)| other.starts_with(&target) || target.starts_with(other)) {
                return Err(QueryError::invalid(40_176, format!("the fields of the output collide at '{path}'")));
            }
            let (function, bounds) = window.function(value, scope)?;
            window.output.push((target, function, bounds));
        }
        Ok(window)
    }

    /// Makes a stage of what `$fill` needs: functions with default bounds.
    pub(super) fn filling(
        partition: Option<Expression>,
        sort: Option<&Document>,
        methods: &[(String, bool)],
    ) -> Result<Self> {
        let order = sort.map_or(Ok(Order::default()), Order::parse)?;
        let mut window = Self { partition, order, output: Vec::new() };
        for (path, linear) in methods {
            let name = if *linear { "$linearFill" } else { "$locf" };
            let spec = Document::from_iter([(name.to_owned(), Bson::from(format!("${path}")))]);
            let (function, bounds) = window.function(&spec, &Scope::default())?;
            window.output.push((output_path(path)?, function, bounds));
        }
        Ok(window)
    }

    /// Reads one field of the output: a function, perhaps with a window.
    fn function(&self, spec: &Document, scope: &Scope) -> Result<(Function, Bounds)> {
        let mut function = None;
        for (name, argument) in spec {
            match name.as_str() {
                "window" => {}
                _ if !name.starts_with('$') => {
                    return Err(wrong(format!("a window function has the unknown argument: {name}")));
                }
                _ if function.is_some() => return Err(wrong("a field of the output has two window functions")),
                _ => function = Some((name, argument)),
            }
        }
        let Some((name, argument)) = function else { return Err(wrong("expected a window function")) };
        let bounds = spec.get("window").map(|value| Bounds::parse(value, &self.order)).transpose()?;
        let function = Function::parse(name, argument, &self.order, bounds.as_ref(), scope)?;
        Ok((function, bounds.unwrap_or(Bounds::ALL)))
    }

    pub(super) fn run<E: From<QueryError>>(
        &self,
        input: Documents<'_, E>,
        run: &Run<'_, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut members = Vec::new();
        for document in input {
            members.push(self.member(document?, run)?);
        }
        members.sort_by(|a, b| a.partition.cmp(&b.partition).then_with(|| a.place.cmp(&b.place)));
        let mut results = Vec::with_capacity(members.len());
        for partition in members.chunk_by(|a, b| a.partition == b.partition) {
            self.compute(partition, run, &mut results)?;
        }
        Ok(results)
    }

    fn member<E>(&self, document: RawDocumentBuf, run: &Run<'_, E>) -> Result<Member> {
        let fields = Fields::from(&*document);
        let partition = match &self.partition {
            None => Vec::new(),
            Some(expression) => match expression.evaluate(&run.environment(fields))?.unwrap_or(Bson::Null) {
                Bson::Array(_) => {
                    return Err(QueryError::type_mismatch("an expression to partition by may not give an array"));
                }
                Bson::Undefined => key::collated(&Bson::Null),
                value => key::collated(&value),
            },
        };
        let place = self.order.place(&document)?;
        let at = self.order.value(fields);
        Ok(Member { partition, place, at, document })
    }

    fn compute<E>(&self, partition: &[Member], run: &Run<'_, E>, results: &mut Vec<RawDocumentBuf>) -> Result<()> {
        let mut columns = Vec::with_capacity(self.output.len());
        for (_, function, bounds) in &self.output {
            let windows = bounds.windows(partition, self.order.is_descending())?;
            columns.push(function.values(partition, &windows, run)?.into_iter());
        }
        for member in partition {
            let mut document = Document::try_from(&*member.document)?;
            for ((path, ..), column) in self.output.iter().zip(&mut columns) {
                match column.next().flatten() {
                    Some(value) => super::unwind::put(&mut document, path, value),
                    None => take(&mut document, path),
                }
            }
            results.push(encode(&document)?);
        }
        Ok(())
    }
}

/// Removes the field at a path: a missing value takes its place.
fn take(document: &mut Document, path: &[String]) {
    match path {
        [name] => drop(document.remove(name)),
        [name, rest @ ..] => {
            if let Some(Bson::Document(inner)) = document.get_mut(name) {
                take(inner, rest);
            }
        }
        [] => {}
    }
}

fn output_path(path: &str) -> Result<Vec<String>> {
    if path.is_empty() || path.split('.').any(|part| part.is_empty() || part.starts_with('$')) {
        return Err(QueryError::invalid(16_410, format!("the field path '{path}' is not valid")));
    }
    Ok(path.split('.').map(str::to_owned).collect())
}
