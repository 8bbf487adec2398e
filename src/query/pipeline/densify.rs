//! `$densify`: documents in the gaps of a series of numbers or dates.

use bson::{Bson, DateTime, Document, RawDocumentBuf};

use super::documents::{Documents, encode};
use super::unwind::put;
use crate::query::arithmetic::{Overflow, add};
use crate::query::compare::compare_values;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Unit, date_step, field_value};
use crate::query::key;
use crate::query::number::Number;
use crate::query::view::Fields;
use crate::query::zone::Zone;

/// The most documents that are made, as in mongod.
const MOST: usize = 500_000;

/// A compiled `$densify`.
#[derive(Debug)]
pub(super) struct Densify {
    field: Vec<String>,
    partition: Vec<Vec<String>>,
    step: Number,
    unit: Option<Unit>,
    bounds: Bounds,
}

/// The range of values that must not have gaps.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a stage has one of them")]
enum Bounds {
    /// From the least to the greatest value of all documents.
    Full,
    /// From the least to the greatest value of the partition.
    Partition,
    /// From a value up to and without another one.
    Explicit(Bson, Bson),
}

fn wrong(code: i32, message: &str) -> QueryError {
    QueryError::invalid(code, message)
}

fn parts(path: &str) -> Result<Vec<String>> {
    if path.is_empty() || path.split('.').any(|part| part.is_empty() || part.starts_with('$')) {
        return Err(QueryError::invalid(16_410, format!("the field path '{path}' is not valid")));
    }
    Ok(path.split('.').map(str::to_owned).collect())
}

impl Densify {
    pub(super) fn parse(spec: &Document) -> Result<Self> {
        if let Some(name) = spec.keys().find(|name| !matches!(name.as_str(), "field" | "partitionByFields" | "range")) {
            return Err(QueryError::invalid(40_415, format!("'$densify.{name}' is an unknown field")));
        }
        let field = match spec.get("field") {
            Some(Bson::String(path)) => parts(path)?,
            Some(_) => return Err(QueryError::type_mismatch("the 'field' of $densify must be a string")),
            None => return Err(wrong(40_414, "$densify needs 'field'")),
        };
        let partition = match spec.get("partitionByFields") {
            None => Vec::new(),
            Some(Bson::Array(paths)) => {
                let read = |path: &Bson| match path {
                    Bson::String(path) => parts(path),
                    _ => Err(QueryError::type_mismatch("'partitionByFields' must be an array of strings")),
                };
                paths.iter().map(read).collect::<Result<_>>()?
            }
            Some(_) => return Err(QueryError::type_mismatch("'partitionByFields' must be an array of strings")),
        };
        if partition.iter().any(|path: &Vec<String>| path.starts_with(&field) || field.starts_with(path)) {
            return Err(wrong(8_993_000, "$densify cannot partition by its field"));
        }
        let range = match spec.get("range") {
            Some(Bson::Document(range)) => range,
            Some(_) => return Err(QueryError::type_mismatch("the 'range' of $densify must be an object")),
            None => return Err(wrong(40_414, "$densify needs 'range'")),
        };
        let step = range.get("step").and_then(Number::of).filter(|step| step.to_double() > 0.0);
        let step = step.ok_or_else(|| wrong(5_733_401, "the 'step' of $densify must be a positive number"))?;
        let unit = match range.get("unit") {
            None => None,
            Some(Bson::String(name)) => Some(
                Unit::parse(name)
                    .ok_or_else(|| QueryError::failed_to_parse(format!("unknown time unit value: {name}")))?,
            ),
            Some(_) => return Err(QueryError::type_mismatch("the 'unit' of $densify must be a string")),
        };
        if unit.is_some() && step.integral().is_none() {
            return Err(wrong(6_586_400, "the 'step' of $densify must be a whole number where there is a 'unit'"));
        }
        let bounds = Bounds::parse(range.get("bounds"), unit.is_some(), !partition.is_empty())?;
        if let (Bounds::Explicit(low, high), Some(given), None) = (&bounds, range.get("step"), unit) {
            let types = [low, high].map(Bson::element_type);
            if types.into_iter().any(|found| found != given.element_type()) {
                return Err(wrong(5_876_900, "the bounds and the step of $densify must have the same type"));
            }
        }
        Ok(Self { field, partition, step, unit, bounds })
    }

    pub(super) fn run<E: From<QueryError>>(
        &self,
        input: Documents<'_, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let (mut results, mut members) = (Vec::new(), Vec::new());
        for document in input {
            let document = document?;
            match self.value(&document)? {
                Some(value) => members.push((self.partition_of(&document), value, document)),
                None => results.push(document),
            }
        }
        members.sort_by(|a, b| a.0.0.cmp(&b.0.0).then_with(|| compare_values(&a.1, &b.1)));
        let all = members.iter().map(|(_, value, _)| value);
        let whole = all.clone().min_by(|a, b| compare_values(a, b)).zip(all.max_by(|a, b| compare_values(a, b)));
        let mut made = 0;
        for partition in members.chunk_by(|a, b| a.0.0 == b.0.0) {
            let Some(((_, names), first, _)) = partition.first() else { continue };
            let last = partition.last().map_or(first, |(_, value, _)| value);
            let (low, high, inclusive) = match (&self.bounds, whole) {
                (Bounds::Full, Some((low, high))) => (low, high, true),
                (Bounds::Explicit(low, high), _) => (low, high, false),
                _ => (first, last, true),
            };
            let mut next = Some(low.clone());
            for (_, value, document) in partition {
                while let Some(gap) = next.take_if(|next| compare_values(next, value).is_lt()) {
                    next = self.fill(gap, (high, inclusive), names, &mut results, &mut made)?;
                }
                if let Some(same) = next.take_if(|next| compare_values(next, value).is_eq()) {
                    next = self.after(&same)?;
                }
                results.push(document.clone());
            }
            while let Some(gap) = next.take() {
                next = self.fill(gap, (high, inclusive), names, &mut results, &mut made)?;
            }
        }
        Ok(results)
    }

    /// Makes a document where a value is missing, and returns the next value.
    fn fill(
        &self,
        value: Bson,
        (high, inclusive): (&Bson, bool),
        names: &Document,
        results: &mut Vec<RawDocumentBuf>,
        made: &mut usize,
    ) -> Result<Option<Bson>> {
        let order = compare_values(&value, high);
        if order.is_gt() || order.is_eq() && !inclusive {
            return Ok(None);
        }
        *made += 1;
        if *made > MOST {
            return Err(wrong(5_897_900, "$densify would make more than 500000 documents"));
        }
        let next = self.after(&value)?;
        let mut document = names.clone();
        put(&mut document, &self.field, value);
        results.push(encode(&document)?);
        Ok(next)
    }

    fn after(&self, value: &Bson) -> Result<Option<Bson>> {
        match (value, self.unit) {
            (Bson::DateTime(date), Some(unit)) => {
                let millis = date_step(date.timestamp_millis(), unit, self.step.to_long(), &Zone::UTC);
                Ok(millis.map(|millis| Bson::DateTime(DateTime::from_millis(millis))))
            }
            _ => match Number::of(value) {
                Some(number) => Ok(Some(add(number, self.step, Overflow::Double)?.into())),
                None => Ok(None),
            },
        }
    }

    /// The value of a document; `None` if it is missing or null.
    fn value(&self, document: &RawDocumentBuf) -> Result<Option<Bson>> {
        match field_value(Fields::from(&**document), &self.field) {
            None | Some(Bson::Null | Bson::Undefined) => Ok(None),
            Some(value @ Bson::DateTime(_)) => match self.unit {
                Some(_) => Ok(Some(value)),
                None => Err(wrong(6_053_600, "$densify found a date, but its range has no 'unit'")),
            },
            Some(value) if Number::of(&value).is_some() => match self.unit {
                None => Ok(Some(value)),
                Some(_) => Err(wrong(6_053_601, "$densify found a number, but its range has a 'unit'")),
            },
            Some(_) => Err(wrong(5_733_201, "the field of $densify must be a number or a date")),
        }
    }

    /// The key of a document's partition, and the fields that its members share.
    fn partition_of(&self, document: &RawDocumentBuf) -> (Vec<u8>, Document) {
        let (mut bytes, mut names) = (Vec::new(), Document::new());
        for path in &self.partition {
            let value = field_value(Fields::from(&**document), path);
            bytes.extend(key::encode_value(value.as_ref().unwrap_or(&Bson::Null)));
            if let Some(value) = value {
                put(&mut names, path, value);
            }
        }
        (bytes, names)
    }
}

impl Bounds {
    fn parse(value: Option<&Bson>, dates: bool, partitioned: bool) -> Result<Self> {
        match value {
            Some(Bson::String(name)) => match name.as_str() {
                "full" => Ok(Self::Full),
                "partition" if partitioned => Ok(Self::Partition),
                "partition" => Err(wrong(5_733_408, "the bounds 'partition' need 'partitionByFields'")),
                _ => Err(wrong(5_946_802, "the 'bounds' of $densify are 'full', 'partition' or an array")),
            },
            Some(Bson::Array(items)) => {
                let [low, high] = items.as_slice() else {
                    return Err(wrong(5_733_403, "the 'bounds' of $densify must be an array of two"));
                };
                let fits = |value: &Bson| match dates {
                    true => matches!(value, Bson::DateTime(_)),
                    false => Number::of(value).is_some(),
                };
                if !fits(low) || !fits(high) || compare_values(low, high).is_gt() {
                    return Err(wrong(
                        5_733_402,
                        "the 'bounds' must be two numbers or, with a 'unit', dates that ascend",
                    ));
                }
                Ok(Self::Explicit(low.clone(), high.clone()))
            }
            Some(_) => Err(wrong(5_733_409, "the 'bounds' of $densify are a string or an array")),
            None => Err(wrong(40_414, "$densify needs 'bounds'")),
        }
    }
}
