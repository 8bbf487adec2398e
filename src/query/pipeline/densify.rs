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

/// A document with its value, and the key and the fields of its partition.
type Member = ((Vec<u8>, Document), Bson, RawDocumentBuf);

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
        let mut members = Vec::new();
        for document in input {
            let document = document?;
            let value = field_value(Fields::from(&*document), &self.field).unwrap_or(Bson::Null);
            members.push((self.partition_of(&document), value, document));
        }
        members.sort_by(|a, b| a.0.0.cmp(&b.0.0).then_with(|| compare_values(&a.1, &b.1)));
        let whole = match self.bounds {
            Bounds::Full => self.range(&members)?,
            _ => None,
        };
        let (mut results, mut made) = (Vec::new(), 0);
        for partition in members.chunk_by(|a, b| a.0.0 == b.0.0) {
            let bounds = match (&self.bounds, &whole) {
                (Bounds::Explicit(low, high), _) => Some((low.clone(), high.clone())),
                (_, Some(whole)) => Some(whole.clone()),
                _ => self.range(partition)?,
            };
            self.fill_partition(partition, bounds, &mut results, &mut made)?;
        }
        if members.is_empty()
            && self.partition.is_empty()
            && let Bounds::Explicit(low, high) = &self.bounds
        {
            self.fill_partition(&[], Some((low.clone(), high.clone())), &mut results, &mut made)?;
        }
        Ok(results)
    }

    /// The least and the greatest value.
    fn range(&self, members: &[Member]) -> Result<Option<(Bson, Bson)>> {
        let mut range: Option<(Bson, Bson)> = None;
        for (_, value, _) in members {
            if !self.has_value(value)? {
                continue;
            }
            range = Some(match range {
                None => (value.clone(), value.clone()),
                Some((low, high)) if compare_values(value, &low).is_lt() => (value.clone(), high),
                Some((low, high)) if compare_values(value, &high).is_gt() => (low, value.clone()),
                Some(range) => range,
            });
        }
        Ok(range)
    }

    /// Gives the documents of a partition, which are in order, with those that are made between them. A document
    /// behind an explicit range is not looked at, whatever its value is.
    fn fill_partition(
        &self,
        partition: &[Member],
        bounds: Option<(Bson, Bson)>,
        results: &mut Vec<RawDocumentBuf>,
        made: &mut usize,
    ) -> Result<()> {
        let is_explicit = matches!(self.bounds, Bounds::Explicit(..));
        let Some((low, high)) = bounds else {
            results.extend(partition.iter().map(|(_, _, document)| document.clone()));
            return Ok(());
        };
        // The first value of a range is in it, even where it is the end of it, too.
        let mut next = Some(low.clone());
        let is_in = |value: &Bson| {
            let order = compare_values(value, &high);
            order.is_lt() || order.is_eq() && !is_explicit || compare_values(value, &low).is_eq()
        };
        let mut is_behind = false;
        for ((_, names), value, document) in partition {
            if !is_behind && self.has_value(value)? {
                is_behind = is_explicit && compare_values(value, &high).is_ge();
                while let Some(gap) = next.take_if(|next| compare_values(next, value).is_lt()) {
                    next = self.fill(gap, names, results, made)?.filter(is_in);
                }
                // What follows is counted from the document.
                if next.take_if(|next| compare_values(next, value).is_eq()).is_some() {
                    next = self.after(value)?.filter(is_in);
                }
            }
            results.push(document.clone());
        }
        let none = Document::new();
        let names = partition.last().map_or(&none, |((_, names), ..)| names);
        while let Some(gap) = next.take() {
            next = self.fill(gap, names, results, made)?.filter(is_in);
        }
        Ok(())
    }

    /// Makes a document where a value is missing, and returns the next value.
    fn fill(
        &self,
        value: Bson,
        names: &Document,
        results: &mut Vec<RawDocumentBuf>,
        made: &mut usize,
    ) -> Result<Option<Bson>> {
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

    /// Returns whether there is a value, which has to be a number or, with a unit, a date.
    fn has_value(&self, value: &Bson) -> Result<bool> {
        match (value, self.unit) {
            (Bson::Null | Bson::Undefined, _) => Ok(false),
            (Bson::DateTime(_), Some(_)) => Ok(true),
            (Bson::DateTime(_), None) => Err(wrong(6_053_600, "$densify found a date, but its range has no 'unit'")),
            (value, unit) if Number::of(value).is_some() => match unit {
                None => Ok(true),
                Some(_) => Err(wrong(6_053_601, "$densify found a number, but its range has a 'unit'")),
            },
            _ => Err(wrong(5_733_201, "the field of $densify must be a number or a date")),
        }
    }

    /// The key of a document's partition, and the fields that its members share.
    fn partition_of(&self, document: &RawDocumentBuf) -> (Vec<u8>, Document) {
        let (mut bytes, mut names) = (Vec::new(), Document::new());
        for path in &self.partition {
            let value = field_value(Fields::from(&**document), path);
            bytes.extend(key::collated(value.as_ref().unwrap_or(&Bson::Null)));
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
