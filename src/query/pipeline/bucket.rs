//! `$bucket` and `$bucketAuto`.

use bson::{Bson, Document, RawDocument, RawDocumentBuf, doc};

use super::documents::{Documents, encode};
use super::granularity::Granularity;
use super::groups::{Accumulators, Groups};
use super::run::Run;
use crate::query::compare::{canonical_type, compare_values};
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, constant_of};
use crate::query::key::collated;
use crate::query::number::Number;
use crate::query::spill::Sorter;

/// A compiled `$bucket`.
#[derive(Debug)]
pub(super) struct Bucket {
    by: Expression,
    boundaries: Vec<Bson>,
    default: Option<Bson>,
    output: Accumulators,
}

/// The code of a stage for a mistake: `$bucketAuto` has codes of its own.
fn code(stage: &str, bucket: i32, auto: i32) -> i32 {
    if stage == "$bucketAuto" { auto } else { bucket }
}

fn output(spec: &Document, scope: &Scope) -> Result<Accumulators> {
    match spec.get("output") {
        None => Ok(Accumulators::counting()),
        Some(Bson::Document(fields)) => Accumulators::parse(fields.iter(), scope),
        Some(_) => Err(QueryError::invalid(40_196, "the output of a bucket must be an object")),
    }
}

/// What documents are put in buckets by: a path or an expression.
fn by(stage: &str, spec: &Document, scope: &Scope) -> Result<Expression> {
    match spec.get("groupBy") {
        Some(value @ Bson::String(path)) if path.starts_with('$') => Expression::parse_in(value, scope),
        Some(value @ Bson::Document(inner)) if inner.keys().next().is_some_and(|name| name.starts_with('$')) => {
            Expression::parse_in(value, scope)
        }
        Some(_) => Err(QueryError::invalid(code(stage, 40_202, 40_239), "groupBy must be a $-path or an expression")),
        None => Err(QueryError::invalid(code(stage, 40_198, 40_246), "a bucket stage needs groupBy")),
    }
}

fn known(stage: &str, spec: &Document, names: &[&str]) -> Result<()> {
    match spec.keys().find(|name| !names.contains(&name.as_str())) {
        Some(name) => {
            Err(QueryError::invalid(code(stage, 40_197, 40_245), format!("unrecognized option to {stage}: {name}")))
        }
        None => Ok(()),
    }
}

impl Bucket {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        known("$bucket", spec, &["groupBy", "boundaries", "default", "output"])?;
        let by = by("$bucket", spec, scope)?;
        let Some(Bson::Array(items)) = spec.get("boundaries") else {
            return Err(QueryError::invalid(40_200, "the boundaries of $bucket must be an array"));
        };
        let boundaries: Vec<Bson> = items.iter().map(|item| constant_of(item, scope)).collect::<Result<_>>()?;
        if boundaries.len() < 2 {
            return Err(QueryError::invalid(40_192, "$bucket needs at least two boundaries"));
        }
        for pair in boundaries.windows(2) {
            if let [low, high] = pair {
                if canonical_type(low.into()) != canonical_type(high.into()) {
                    return Err(QueryError::invalid(40_193, "all boundaries of $bucket must have the same type"));
                }
                if compare_values(low, high).is_ge() {
                    return Err(QueryError::invalid(40_194, "the boundaries of $bucket must be sorted and distinct"));
                }
            }
        }
        let default = spec.get("default").map(|default| constant_of(default, scope)).transpose()?;
        if let (Some(default), Some(low), Some(high)) = (&default, boundaries.first(), boundaries.last())
            && compare_values(default, low).is_ge()
            && compare_values(default, high).is_lt()
        {
            return Err(QueryError::invalid(40_199, "the default of $bucket must lie outside of the boundaries"));
        }
        Ok(Self { by, boundaries, default, output: output(spec, scope)? })
    }

    pub(super) fn run<E: From<QueryError>>(
        &self,
        input: Documents<'_, E>,
        run: &Run<'_, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut groups = Groups::new(&self.output);
        for document in input {
            let document = document?;
            let value = self.by.evaluate(&run.environment((&*document).into()))?.unwrap_or(Bson::Null);
            let id = self.bucket_of(&value)?;
            groups.add(id, (&*document).into(), run)?;
        }
        let mut documents = groups.finish()?;
        documents
            .sort_by(|a, b| compare_values(a.get("_id").unwrap_or(&Bson::Null), b.get("_id").unwrap_or(&Bson::Null)));
        Ok(documents.iter().map(encode).collect::<Result<_>>()?)
    }

    fn bucket_of(&self, value: &Bson) -> Result<Bson> {
        let after = self.boundaries.partition_point(|boundary| compare_values(boundary, value).is_le());
        let inside = after > 0 && after < self.boundaries.len();
        match (after.checked_sub(1).and_then(|index| self.boundaries.get(index)).filter(|_| inside), &self.default) {
            (Some(boundary), _) => Ok(boundary.clone()),
            (None, Some(default)) => Ok(default.clone()),
            (None, None) => {
                Err(QueryError::invalid(40_066, "$bucket found a value outside of the boundaries, and has no default")
                    .about("$bucket"))
            }
        }
    }
}

/// A compiled `$bucketAuto`.
#[derive(Debug)]
pub(super) struct AutoBucket {
    by: Expression,
    buckets: usize,
    granularity: Option<Granularity>,
    output: Accumulators,
}

impl AutoBucket {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        known("$bucketAuto", spec, &["groupBy", "buckets", "output", "granularity"])?;
        let by = by("$bucketAuto", spec, scope)?;
        let wrong = |code| QueryError::invalid(code, "the buckets of $bucketAuto must be a positive integer");
        let buckets = spec.get("buckets").ok_or_else(|| wrong(40_246))?;
        let buckets = Number::of(buckets).ok_or_else(|| wrong(40_241))?;
        let buckets = buckets.integral_32().ok_or_else(|| wrong(40_242))?;
        let buckets = usize::try_from(buckets).ok().filter(|buckets| *buckets > 0).ok_or_else(|| wrong(40_243))?;
        let granularity = match spec.get("granularity") {
            None => None,
            Some(Bson::String(name)) => Some(Granularity::parse(name)?),
            Some(_) => return Err(QueryError::invalid(40_261, "the granularity of $bucketAuto must be a string")),
        };
        let output = match spec.get("output") {
            Some(Bson::Document(fields)) if fields.is_empty() => Accumulators::counting(),
            _ => output(spec, scope)?,
        };
        Ok(Self { by, buckets, granularity, output })
    }

    pub(super) fn run<E: From<QueryError>>(
        &self,
        input: Documents<'_, E>,
        run: &Run<'_, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let (mut sorter, mut count) = (Sorter::new(run.spill()), 0_usize);
        for document in input {
            let document = document?;
            let value = self.by.evaluate(&run.environment((&*document).into()))?.unwrap_or(Bson::Null);
            if self.granularity.is_some() {
                Granularity::check(&value)?;
            }
            sorter.add(&collated(&value), &together(&value, &document)?)?;
            count += 1;
        }
        // Equal parts, rounded.
        let part = ((count + self.buckets / 2) / self.buckets).max(1);
        let mut sorted = Sorted { rest: Box::new(sorter.finish()?.map(|part| apart(&part?))), next: None };
        sorted.advance()?;
        let (mut documents, mut low) = (Vec::new(), None);
        for bucket in 1..=self.buckets {
            if sorted.next.is_none() {
                break;
            }
            let size = if bucket == self.buckets { usize::MAX } else { part };
            let (document, high) = self.bucket(&mut sorted, size, low, run)?;
            documents.push(document);
            low = Some(high);
        }
        Ok(documents.iter().map(encode).collect::<Result<_>>()?)
    }

    /// Makes the next bucket, of so many of the sorted values and of those that belong to them. Returns it with its upper bound.
    fn bucket<E>(
        &self,
        sorted: &mut Sorted<'_>,
        size: usize,
        low: Option<Bson>,
        run: &Run<'_, E>,
    ) -> Result<(Document, Bson)> {
        let mut groups = Groups::new(&self.output);
        let (mut least, mut last) = (None, Bson::Null);
        let mut taken = 0;
        while taken < size
            && let Some((value, document)) = sorted.advance()?
        {
            groups.add(Bson::Null, (&*document).into(), run)?;
            least = least.or_else(|| Some(value.clone()));
            (last, taken) = (value, taken + 1);
        }
        let least = least.unwrap_or(Bson::Null);
        let above = self.granularity.as_ref().map(|granularity| granularity.above(&last));
        let belongs = |value: &Bson| match &above {
            Some(high) => compare_values(value, high).is_lt(),
            None => compare_values(value, &last).is_eq(),
        };
        let mut end = None;
        while sorted.next.as_ref().is_some_and(|(value, _)| belongs(value)) {
            let Some((value, document)) = sorted.advance()? else { break };
            groups.add(Bson::Null, (&*document).into(), run)?;
            end = Some(value);
        }
        let next = sorted.next.as_ref().map(|(value, _)| value.clone());
        let (least, high) = match (&self.granularity, above) {
            (Some(granularity), Some(high)) => {
                let least = low.unwrap_or_else(|| granularity.below(&least));
                // Nothing is below a bound of 0: where it is all that is in the bucket, the bound is below the next value.
                let is_zero = Number::of(&high).is_some_and(Number::is_zero);
                (least, next.filter(|_| is_zero).map_or(high, |next| granularity.below(&next)))
            }
            // Of equal values, the last.
            _ => (least, next.or(end).unwrap_or(last)),
        };
        let mut id = Document::new();
        id.insert("min", least);
        id.insert("max", high.clone());
        let mut document = groups.finish()?.pop().unwrap_or_default();
        document.insert("_id", id);
        Ok((document, high))
    }
}

/// Values in their order, each with its document.
struct Sorted<'a> {
    rest: Box<dyn Iterator<Item = Result<(Bson, RawDocumentBuf)>> + 'a>,
    /// The one that comes next.
    next: Option<(Bson, RawDocumentBuf)>,
}

impl Sorted<'_> {
    /// Takes the next one.
    fn advance(&mut self) -> Result<Option<(Bson, RawDocumentBuf)>> {
        let next = self.rest.next().transpose()?;
        Ok(std::mem::replace(&mut self.next, next))
    }
}

/// A value and its document, as bytes.
fn together(value: &Bson, document: &RawDocument) -> Result<Vec<u8>> {
    let mut bytes = RawDocumentBuf::try_from(&doc! { "": value.clone() })?.into_bytes();
    bytes.extend_from_slice(document.as_bytes());
    Ok(bytes)
}

fn apart(bytes: &[u8]) -> Result<(Bson, RawDocumentBuf)> {
    let length = bytes.first_chunk().map_or(0, |length| u32::from_le_bytes(*length) as usize);
    let (value, document) = bytes.split_at_checked(length).unwrap_or_default();
    let value = RawDocument::from_bytes(value)?.get("")?.map_or(Ok(Bson::Null), Bson::try_from)?;
    Ok((value, RawDocumentBuf::from_bytes(document.to_vec())?))
}
