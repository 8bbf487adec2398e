//! `$setWindowFields`: fields computed over the documents around each one.

mod bounds;
mod function;
mod series;

use bson::{Bson, Document, RawDocumentBuf};

use super::documents::{Documents, encode};
use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::key;
use crate::query::number::Number;
use crate::query::path::Path;
use crate::query::sort::Sort;
use crate::query::view::Fields;
use bounds::Bounds;
use function::Function;

/// A compiled `$setWindowFields`.
#[derive(Debug)]
pub(super) struct Window {
    partition: Option<Expression>,
    sort: Option<Sort>,
    /// The only path that is sorted by, with its direction (descending or not).
    by: Option<(Path, bool)>,
    output: Vec<(Vec<String>, Function, Bounds)>,
}

/// A document of a partition.
pub(super) struct Member {
    pub(super) document: RawDocumentBuf,
    partition: Vec<u8>,
    /// Its place in the order of the partition.
    pub(super) place: Vec<u8>,
    /// The value of the only field that is sorted by.
    pub(super) at: Option<Bson>,
}

fn wrong(message: impl Into<String>) -> QueryError {
    QueryError::failed_to_parse(message)
}

impl Window {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        if let Some(name) = spec.keys().find(|name| !matches!(name.as_str(), "partitionBy" | "sortBy" | "output")) {
            return Err(QueryError::invalid(40_415, format!("'$setWindowFields.{name}' is an unknown field")));
        }
        let partition = spec.get("partitionBy").map(|value| Expression::parse_in(value, scope)).transpose()?;
        let (sort, by) = match spec.get("sortBy") {
            None | Some(Bson::Null) => (None, None),
            Some(Bson::Document(pattern)) => order(pattern)?,
            Some(_) => return Err(QueryError::type_mismatch("the 'sortBy' of $setWindowFields must be an object")),
        };
        let Some(Bson::Document(fields)) = spec.get("output") else {
            return Err(match spec.get("output") {
                None => QueryError::invalid(40_414, "$setWindowFields needs 'output'"),
                Some(_) => QueryError::type_mismatch("the 'output' of $setWindowFields must be an object"),
            });
        };
        let mut window = Self { partition, sort, by, output: Vec::new() };
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
        let (sort, by) = sort.map_or(Ok((None, None)), order)?;
        let mut window = Self { partition, sort, by, output: Vec::new() };
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
        let bounds = spec.get("window").map(|value| Bounds::parse(value, self)).transpose()?;
        let function = Function::parse(name, argument, self, bounds.as_ref(), scope)?;
        Ok((function, bounds.unwrap_or(Bounds::ALL)))
    }

    pub(super) fn is_sorted(&self) -> bool {
        self.sort.is_some()
    }

    pub(super) fn by(&self) -> Option<&(Path, bool)> {
        self.by.as_ref()
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
                Bson::Undefined => key::encode_value(&Bson::Null),
                value => key::encode_value(&value),
            },
        };
        let place = self.sort.as_ref().map_or(Ok(Vec::new()), |sort| sort.key(&document))?;
        let at = self.by.as_ref().and_then(|(path, _)| {
            let parts: Vec<String> = path.text().split('.').map(str::to_owned).collect();
            crate::query::expression::field_value(fields, &parts)
        });
        Ok(Member { partition, place, at, document })
    }

    fn compute<E>(&self, partition: &[Member], run: &Run<'_, E>, results: &mut Vec<RawDocumentBuf>) -> Result<()> {
        let mut columns = Vec::with_capacity(self.output.len());
        for (_, function, bounds) in &self.output {
            let windows = bounds.windows(partition, self.by.as_ref().is_some_and(|(_, descending)| *descending))?;
            columns.push(function.values(partition, &windows, run)?.into_iter());
        }
        for member in partition {
            let mut document = Document::try_from(&*member.document)?;
            for ((path, ..), column) in self.output.iter().zip(&mut columns) {
                if let Some(value) = column.next().flatten() {
                    super::unwind::put(&mut document, path, value);
                }
            }
            results.push(encode(&document)?);
        }
        Ok(())
    }
}

type Order = (Option<Sort>, Option<(Path, bool)>);

/// Reads what is sorted by, and the field, where there is only one.
fn order(pattern: &Document) -> Result<Order> {
    let sort = Sort::parse(pattern)?;
    let by = match sort.fields().collect::<Vec<_>>().as_slice() {
        [(path, descending)] => Some((Path::parse(path)?, *descending)),
        _ => None,
    };
    Ok((Some(sort), by))
}

fn output_path(path: &str) -> Result<Vec<String>> {
    if path.is_empty() || path.split('.').any(|part| part.is_empty() || part.starts_with('$')) {
        return Err(QueryError::invalid(16_410, format!("the field path '{path}' is not valid")));
    }
    Ok(path.split('.').map(str::to_owned).collect())
}

/// Returns the number that a value is, if it is one.
pub(super) fn number(value: Option<&Bson>) -> Option<Number> {
    value.and_then(Number::of)
}
