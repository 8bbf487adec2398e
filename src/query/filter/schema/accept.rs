//! Validates a value against a schema.

use bson::Bson;

use super::{Items, Others, Properties, Rule, Schema};
use crate::query::compare::{compare_values, equal, equal_values, has_equal, settled, views};
use crate::query::decimal::Decimal;
use crate::query::number::Number;
use crate::query::view::{Fields, View};

impl Schema {
    /// Returns whether the schema accepts a value.
    pub(in crate::query) fn accepts(&self, value: View<'_>) -> bool {
        self.rules.iter().all(|rule| rule.accepts(value))
    }
}

impl Rule {
    fn accepts(&self, value: View<'_>) -> bool {
        match (self, value) {
            (Self::Type(types), value) => types.contains(value),
            (Self::Enum(values), View::Document(_) | View::Array(_)) => {
                let value = settled(value.to_bson());
                values.iter().any(|known| equal_values(known, &value))
            }
            (Self::Enum(values), value) => values.iter().any(|known| equal(known.into(), value)),
            (Self::AllOf(schemas), value) => schemas.iter().all(|schema| schema.accepts(value)),
            (Self::AnyOf(schemas), value) => schemas.iter().any(|schema| schema.accepts(value)),
            (Self::OneOf(schemas), value) => schemas.iter().filter(|schema| schema.accepts(value)).count() == 1,
            (Self::Not(schema), value) => !schema.accepts(value),
            (Self::Minimum(bound, exclusive), View::Number(number)) => {
                let order = number.compare(*bound);
                !number.is_nan() && !bound.is_nan() && (order.is_gt() || order.is_eq() && !exclusive)
                    || number.is_nan() && bound.is_nan() && !exclusive
            }
            (Self::Maximum(bound, exclusive), View::Number(number)) => {
                let order = number.compare(*bound);
                !number.is_nan() && !bound.is_nan() && (order.is_lt() || order.is_eq() && !exclusive)
                    || number.is_nan() && bound.is_nan() && !exclusive
            }
            (Self::MultipleOf(divisor), View::Number(number)) => is_multiple(number, *divisor),
            (Self::MinLength(least), View::String(text)) => text.chars().count() >= *least,
            (Self::MaxLength(most), View::String(text)) => text.chars().count() <= *most,
            (Self::Pattern(pattern), View::String(text)) => pattern.is_match(text),
            (Self::Required(names), View::Document(fields)) => names.iter().all(|name| fields.get(name).is_some()),
            (Self::Properties(properties), View::Document(fields)) => properties.accepts(fields),
            (Self::MinProperties(least), View::Document(fields)) => fields.iter().count() >= *least,
            (Self::MaxProperties(most), View::Document(fields)) => fields.iter().count() <= *most,
            (Self::FieldsNeeded(name, names), View::Document(fields)) => {
                fields.get(name).is_none() || names.iter().all(|name| fields.get(name).is_some())
            }
            (Self::SchemaNeeded(name, schema), View::Document(fields)) => {
                fields.get(name).is_none() || schema.accepts(value)
            }
            (Self::Items(Items::All(schema)), View::Array(items)) => items.iter().all(|item| schema.accepts(item)),
            (Self::Items(Items::Each(schemas, others)), View::Array(items)) => {
                items.iter().enumerate().all(|(index, item)| match schemas.get(index) {
                    Some(schema) => schema.accepts(item),
                    None => others.accepts(item),
                })
            }
            (Self::MinItems(least), View::Array(items)) => items.len() >= *least,
            (Self::MaxItems(most), View::Array(items)) => items.len() <= *most,
            (Self::UniqueItems, View::Array(items)) => {
                let items: Vec<View<'_>> = items.iter().collect();
                match items.iter().any(|item| matches!(item, View::Document(_) | View::Array(_))) {
                    true => {
                        let items: Vec<Bson> = items.iter().map(|item| settled(item.to_bson())).collect();
                        !has_equal(items.iter().collect(), compare_values)
                    }
                    false => !has_equal(items, views),
                }
            }
            _ => true,
        }
    }
}

impl Others {
    fn accepts(&self, value: View<'_>) -> bool {
        match self {
            Self::Allowed => true,
            Self::Forbidden => false,
            Self::Checked(schema) => schema.accepts(value),
        }
    }
}

impl Properties {
    fn accepts(&self, fields: Fields<'_>) -> bool {
        fields.iter().all(|(name, value)| {
            let mut known = false;
            for (_, schema) in self.named.iter().filter(|(other, _)| other == name) {
                known = true;
                if !schema.accepts(value) {
                    return false;
                }
            }
            for (_, schema) in self.patterns.iter().filter(|(pattern, _)| pattern.is_match(name)) {
                known = true;
                if !schema.accepts(value) {
                    return false;
                }
            }
            known || self.others.accepts(value)
        })
    }
}

fn is_multiple(number: Number, divisor: Number) -> bool {
    match (number.integral(), divisor.integral()) {
        (Some(number), Some(divisor)) => number.checked_rem(divisor).unwrap_or(0) == 0,
        _ => {
            let rest: Decimal = number.to_decimal().modulo(divisor.to_decimal());
            rest.is_zero()
        }
    }
}
