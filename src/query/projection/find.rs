//! Operators only in projections of `find`: `$slice`, `$elemMatch`, the positional `$`.

use bson::{Bson, DateTime, Document};

use crate::query::error::{QueryError, Result};
use crate::query::filter::{Context, Filter, Parser, Test};
use crate::query::number::Number;

/// A change of one field after the projection.
#[derive(Debug)]
pub(super) struct Transform {
    pub(super) path: String,
    pub(super) operator: FindOperator,
    /// Whether the field stays where it was; else it comes last.
    pub(super) in_place: bool,
}

#[derive(Debug)]
pub(super) enum FindOperator {
    /// At most `limit` elements after `skip` (from the end if negative).
    Slice { skip: Option<i64>, limit: i64 },
    /// The first element that passes; the test is of the whole array.
    ElementMatch(Test),
    /// The element by which the filter matched.
    Positional,
}

impl FindOperator {
    /// Reads `$slice`; `None` if it is the expression of that name.
    pub(super) fn slice(value: &Bson) -> Result<Option<Self>> {
        let whole = |value: &Bson| Number::of(value).map(Number::to_long);
        match value {
            Bson::Array(items) => match items.as_slice() {
                [skip, limit] => match (whole(skip), whole(limit)) {
                    (Some(skip), Some(limit)) if limit > 0 => Ok(Some(Self::Slice { skip: Some(skip), limit })),
                    (Some(_), Some(_)) => {
                        Err(QueryError::invalid(28_724, "the second argument to $slice must be positive")
                            .about("$slice"))
                    }
                    (Some(_), None) if !matches!(limit, Bson::Null | Bson::Undefined) => {
                        Err(QueryError::invalid(28_724, "the arguments to $slice must be numbers").about("$slice"))
                    }
                    _ => Ok(None),
                },
                _ => Ok(None),
            },
            value => match whole(value) {
                Some(limit) => Ok(Some(Self::Slice { skip: None, limit })),
                None => Err(QueryError::invalid(28_667, "$slice takes a number, or an array of two").about("$slice")),
            },
        }
    }

    pub(super) fn element_match(value: &Bson) -> Result<Self> {
        let mut operator = Document::new();
        if !matches!(value, Bson::Document(_)) {
            return Err(
                QueryError::invalid(31_274, "elemMatch: invalid argument, an object is required").about("$elemMatch")
            );
        }
        operator.insert("$elemMatch", value.clone());
        Ok(Self::ElementMatch(Parser::default().operators(&operator)?))
    }
}

impl Transform {
    pub(super) fn apply(
        &self,
        mut document: Document,
        whole: &Document,
        filter: &Filter,
        now: DateTime,
    ) -> Result<Document> {
        match &self.operator {
            FindOperator::Slice { skip, limit } => {
                let parts: Vec<&str> = self.path.split('.').collect();
                slice_at(&mut document, &parts, *skip, *limit);
            }
            FindOperator::ElementMatch(test) => {
                let found = first_match(test, whole.get(&self.path))?;
                if !self.in_place || found.is_none() {
                    document.remove(&self.path);
                }
                if let Some(found) = found {
                    document.insert(self.path.clone(), Bson::Array(vec![found]));
                }
            }
            FindOperator::Positional => {
                let parts: Vec<&str> = self.path.split('.').collect();
                if !leads_through_array(&document, &parts) {
                    return Ok(document);
                }
                let Some(index) = filter.position(whole.into(), now)? else {
                    let message = "executor error: the positional operator '.$' could not find a matching element";
                    return Err(QueryError::invalid(51_246, message));
                };
                pick(&mut document, whole, &parts, index)?;
            }
        }
        Ok(document)
    }
}

fn first_match(test: &Test, value: Option<&Bson>) -> Result<Option<Bson>> {
    let Some(value @ Bson::Array(items)) = value else { return Ok(None) };
    let mut context = Context::default();
    let found = test.on_value(value.into(), &mut context)?;
    Ok(context.position.filter(|_| found).and_then(|index| items.get(index).cloned()))
}

fn slice_at(document: &mut Document, parts: &[&str], skip: Option<i64>, limit: i64) {
    let Some((name, rest)) = parts.split_first() else { return };
    match document.get_mut(name) {
        Some(Bson::Array(items)) if rest.is_empty() => *items = sliced(items, skip, limit),
        Some(Bson::Document(inner)) => slice_at(inner, rest, skip, limit),
        Some(Bson::Array(items)) => {
            for item in items {
                if let Bson::Document(inner) = item {
                    slice_at(inner, rest, skip, limit);
                }
            }
        }
        _ => {}
    }
}

/// So many elements from the start, from the end, or after `skip`.
fn sliced(items: &[Bson], skip: Option<i64>, limit: i64) -> Vec<Bson> {
    let length = i64::try_from(items.len()).unwrap_or(i64::MAX);
    let (start, count) = match skip {
        None if limit < 0 => (length.saturating_add(limit).max(0), length),
        None => (0, limit),
        Some(skip) if skip < 0 => (length.saturating_add(skip).max(0), limit),
        Some(skip) => (skip.min(length), limit),
    };
    let start = usize::try_from(start).unwrap_or(0);
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    items.iter().skip(start).take(count).cloned().collect()
}

/// Returns whether there is an array on a path.
fn leads_through_array(document: &Document, parts: &[&str]) -> bool {
    let Some((name, rest)) = parts.split_first() else { return false };
    match document.get(name) {
        Some(Bson::Array(_)) => true,
        Some(Bson::Document(inner)) => leads_through_array(inner, rest),
        _ => false,
    }
}

/// Leaves only one element of the first array on the path. The index is that of the element in the whole document:
/// where the path leads on, elements without fields are no longer there.
fn pick(document: &mut Document, whole: &Document, parts: &[&str], index: usize) -> Result<()> {
    let Some((name, rest)) = parts.split_first() else { return Ok(()) };
    match (document.get_mut(name), whole.get(name)) {
        (Some(Bson::Array(items)), Some(Bson::Array(all))) => {
            let stays = |item: &&Bson| rest.is_empty() || matches!(item, Bson::Document(_) | Bson::Array(_));
            let before = all.iter().take(index).filter(stays).count();
            let picked = all.get(index).filter(stays).and_then(|_| items.get(before).cloned());
            let mismatch = "executor error: the positional operator '.$' element mismatch";
            *items = vec![picked.ok_or_else(|| QueryError::invalid(51_247, mismatch))?];
            Ok(())
        }
        (Some(Bson::Document(inner)), Some(Bson::Document(whole))) => pick(inner, whole, rest, index),
        _ => Ok(()),
    }
}
