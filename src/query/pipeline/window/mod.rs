//! `$setWindowFields`: fields computed over the documents around each one.

mod bounds;
mod column;
mod covariance;
mod function;
mod gaps;
mod member;
mod order;
mod partition;
mod real;
mod rolling;
mod series;

use std::iter::Peekable;

use bson::{Bson, Document, RawDocumentBuf};

use super::documents::{Documents, encode};
use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::key;
use crate::query::spill::{Sorter, Spill};
use crate::query::view::Fields;
use bounds::Bounds;
use column::Column;
use function::Function;
use member::{Member, wrong};
use order::Order;
use partition::{Builder, Partition};

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

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: Run<'a, E>,
    ) -> std::result::Result<Documents<'a, E>, E> {
        let mut sorter = Sorter::new(run.spill());
        for document in input {
            let document = document?;
            let (key, length) = self.key(&document, &run)?;
            sorter.add(&key, &[&length.to_le_bytes(), document.as_bytes()].concat())?;
        }
        let mut sorted = sorter.records()?.peekable();
        let mut rows: Option<Rows<'a, E>> = None;
        Ok(Box::new(std::iter::from_fn(move || {
            loop {
                if let Some(row) = rows.as_mut().and_then(|rows| rows.next(&run).transpose()) {
                    return Some(row.map_err(E::from));
                }
                rows = None;
                sorted.peek()?;
                match self.partition(&mut sorted, run.spill()) {
                    Ok(partition) => rows = Some(self.rows(partition)),
                    Err(error) => return Some(Err(error.into())),
                }
            }
        })))
    }

    /// Returns the key that documents are sorted by, and how many bytes of it tell the partition.
    fn key<E>(&self, document: &RawDocumentBuf, run: &Run<'_, E>) -> Result<(Vec<u8>, u64)> {
        let fields = Fields::from(&**document);
        let mut key = match &self.partition {
            None => Vec::new(),
            Some(expression) => match expression.evaluate(&run.environment(fields))?.unwrap_or(Bson::Null) {
                Bson::Array(_) => {
                    return Err(QueryError::type_mismatch("an expression to partition by may not give an array"));
                }
                Bson::Undefined => key::collated(&Bson::Null),
                value => key::collated(&value),
            },
        };
        let length = key.len() as u64;
        key.extend(self.order.place(document)?);
        Ok((key, length))
    }

    /// Takes the documents of the next partition.
    fn partition(
        &self,
        sorted: &mut Peekable<impl Iterator<Item = Result<(Vec<u8>, Vec<u8>)>>>,
        spill: &Spill,
    ) -> Result<Partition<'_>> {
        let mut partition: Option<Vec<u8>> = None;
        let mut builder = Builder::new(&self.order, spill);
        let is_next = |record: &Result<(Vec<u8>, Vec<u8>)>, partition: Option<&Vec<u8>>| match (record, partition) {
            (Ok((key, body)), Some(partition)) => apart(key, body).0 == partition,
            _ => true,
        };
        while let Some(record) = sorted.next_if(|record| is_next(record, partition.as_ref())) {
            let (key, body) = record?;
            let (name, place, document) = apart(&key, &body);
            partition.get_or_insert_with(|| name.to_vec());
            let document = RawDocumentBuf::from_bytes(document.to_vec())?;
            builder.push(Member::new(document, place.to_vec(), &self.order))?;
        }
        builder.finish()
    }

    fn rows<'a, E: 'a>(&'a self, partition: Partition<'a>) -> Rows<'a, E> {
        let column = |(path, function, bounds): &'a (Vec<String>, Function, Bounds)| {
            (&**path, function.column(bounds.moving(self.order.is_descending())))
        };
        Rows { partition, columns: self.output.iter().map(column).collect(), next: 0 }
    }
}

/// Returns the partition, the place and the document of a record.
fn apart<'a>(key: &'a [u8], body: &'a [u8]) -> (&'a [u8], &'a [u8], &'a [u8]) {
    let (length, document) = body.split_first_chunk().map_or((0, body), |(length, document)| {
        (usize::try_from(u64::from_le_bytes(*length)).unwrap_or_default(), document)
    });
    let (partition, place) = key.split_at(length.min(key.len()));
    (partition, place, document)
}

/// The results of a partition.
struct Rows<'a, E> {
    partition: Partition<'a>,
    columns: Vec<(&'a [String], Column<'a, E>)>,
    next: usize,
}

impl<E> Rows<'_, E> {
    fn next(&mut self, run: &Run<'_, E>) -> Result<Option<RawDocumentBuf>> {
        let Some(member) = self.partition.get(self.next)? else { return Ok(None) };
        let mut document = Document::try_from(&*member.document)?;
        for (path, value) in &mut self.columns {
            match value(&self.partition, self.next, run)? {
                Some(value) => super::unwind::put(&mut document, path, value),
                None => take(&mut document, path),
            }
        }
        self.next += 1;
        encode(&document).map(Some)
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
