//! The comparison of two values, as nearly every expression of a filter is one.
//!
//! Where both are fields of the document itself, one walk over its bytes finds both.

use std::cmp::Ordering;

use super::scope::Environment;
use super::tree::{Expression, Source};
use crate::query::compare::optional;
use crate::query::element::{Element, Elements};
use crate::query::error::Result;
use crate::query::view::Fields;

/// Returns the order of the values of two expressions.
///
/// # Errors
/// If one cannot be evaluated.
pub(super) fn order(pair: &[Expression; 2], environment: &Environment<'_>) -> Result<Ordering> {
    if let (Some(names), Fields::Raw(document)) = (fields(pair), environment.root) {
        let [a, b] = Elements::new(document).find_both(names.map(str::as_bytes));
        return Ok(match (a, b) {
            (Some(a), Some(b)) if a.has_same_bytes(&b) => Ordering::Equal,
            (a, b) => optional(a.and_then(Element::view), b.and_then(Element::view)),
        });
    }
    let [a, b] = pair;
    a.show(environment, |a| b.show(environment, |b| optional(a, b)))?
}

/// The names of two fields of the document itself, if the expressions are that.
pub(super) fn fields(pair: &[Expression; 2]) -> Option<[&str; 2]> {
    let [a, b] = pair;
    Some([field(a)?, field(b)?])
}

/// The name of a field of the document itself, if an expression is one.
fn field(expression: &Expression) -> Option<&str> {
    match expression {
        Expression::Path(Source::Root, path) => match path.as_slice() {
            [name] => Some(name),
            _ => None,
        },
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::expression::Variables;
    use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

    #[test]
    fn two_fields_have_the_same_order_in_raw_bytes_as_in_a_document() {
        let values = [
            None,
            Some(Bson::MinKey),
            Some(Bson::Null),
            Some(Bson::Int32(1)),
            Some(Bson::Double(1.0)),
            Some(Bson::Double(f64::NAN)),
            Some("a".into()),
            Some("ab".into()),
            Some(Bson::Symbol("a".into())),
            Some(doc! { "x": 1 }.into()),
            Some(vec![1, 2].into()),
            Some(true.into()),
            Some(Bson::Decimal128("NaN".parse().unwrap())),
            Some(doc! { "x": [f64::NAN, Bson::Null] }.into()),
            Some(DateTime::from_millis(1).into()),
        ];
        let none = Variables::default();
        let pairs = values.iter().flat_map(|a| values.iter().map(move |b| (a, b)));
        for (a, b) in pairs {
            let fields = [("aa", Some(&Bson::Null)), ("b", b.as_ref()), ("ab", Some(&Bson::Null)), ("a", a.as_ref())];
            let fields = fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?.clone())));
            let document: Document = fields.collect();
            let raw = RawDocumentBuf::try_from(&document).unwrap();
            for names in [["$a", "$b"], ["$b", "$a"], ["$a", "$a"], ["$a", "$c"]] {
                let pair = names.map(|name| Expression::parse(&name.into()).unwrap());
                let of = |fields| order(&pair, &Environment::new(fields, &none, DateTime::now())).unwrap();
                assert_eq!(of((&*raw).into()), of((&document).into()), "{names:?} of {document}");
            }
        }
    }
}
