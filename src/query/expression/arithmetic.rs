//! Arithmetic, and the accumulators' forms as expressions over one or more arguments.

use bson::{Bson, DateTime};

use super::operator::{ANY, Operator, at, is_null, is_nullish, type_name, wrong_type};
use super::value::Value;
use crate::query::arithmetic::{Overflow, add, multiply, subtract};
use crate::query::compare::compare_values;
use crate::query::decimal::{Decimal, Rounding};
use crate::query::error::{QueryError, Result, TYPE_MISMATCH};
use crate::query::number::{Number, double_to_long};
use crate::query::statistics::{deviation, mean, total};

pub(super) const OPERATORS: [Operator; 24] = [
    Operator { name: "$add", arity: (0, ANY), call: sum_all },
    Operator { name: "$subtract", arity: (2, 2), call: difference },
    Operator { name: "$multiply", arity: (0, ANY), call: product },
    Operator { name: "$divide", arity: (2, 2), call: divide },
    Operator { name: "$mod", arity: (2, 2), call: modulo },
    Operator { name: "$abs", arity: (1, 1), call: absolute },
    Operator { name: "$ceil", arity: (1, 1), call: |v| whole("$ceil", v, f64::ceil, Rounding::Ceiling) },
    Operator { name: "$floor", arity: (1, 1), call: |v| whole("$floor", v, f64::floor, Rounding::Floor) },
    Operator { name: "$round", arity: (1, 2), call: |v| to_place("$round", v, Rounding::HalfEven) },
    Operator { name: "$trunc", arity: (1, 2), call: |v| to_place("$trunc", v, Rounding::Truncate) },
    Operator { name: "$sqrt", arity: (1, 1), call: root },
    Operator { name: "$pow", arity: (2, 2), call: power },
    Operator { name: "$exp", arity: (1, 1), call: exponential },
    Operator { name: "$ln", arity: (1, 1), call: |v| logarithm("$ln", 28_766, v, f64::ln) },
    Operator { name: "$log10", arity: (1, 1), call: |v| logarithm("$log10", 28_761, v, f64::log10) },
    Operator { name: "$log", arity: (2, 2), call: log },
    Operator { name: "$rand", arity: (0, 0), call: |_| Ok(Some(Bson::Double(crate::query::random::random()))) },
    Operator { name: "$sum", arity: (0, ANY), call: |v| Ok(Some(total(numbers(v)).into())) },
    Operator { name: "$avg", arity: (0, ANY), call: |v| Ok(Some(mean(numbers(v)).map_or(Bson::Null, Bson::from))) },
    Operator { name: "$stdDevPop", arity: (0, ANY), call: |v| Ok(Some(deviation(numbers(v), false))) },
    Operator { name: "$stdDevSamp", arity: (0, ANY), call: |v| Ok(Some(deviation(numbers(v), true))) },
    Operator { name: "$min", arity: (0, ANY), call: |v| Ok(Some(extreme(v, false))) },
    Operator { name: "$max", arity: (0, ANY), call: |v| Ok(Some(extreme(v, true))) },
    Operator { name: "$bsonSize", arity: (1, 1), call: size },
];

/// Returns the values of an accumulator in an expression: those of an only argument that is an array, or the arguments.
fn spread(values: &[Value]) -> Vec<&Bson> {
    match values {
        [Some(Bson::Array(items))] => items.iter().collect(),
        values => values.iter().flatten().collect(),
    }
}

fn numbers(values: &[Value]) -> impl Iterator<Item = Number> {
    spread(values).into_iter().filter_map(Number::of)
}

fn extreme(values: &[Value], greatest: bool) -> Bson {
    let present = spread(values).into_iter().filter(|value| !is_null(value));
    let found = if greatest {
        present.reduce(|a, b| if compare_values(b, a).is_gt() { b } else { a })
    } else {
        present.reduce(|a, b| if compare_values(b, a).is_lt() { b } else { a })
    };
    found.cloned().unwrap_or(Bson::Null)
}

fn size(values: &[Value]) -> Result<Value> {
    match at(values, 0) {
        value if is_null(value) => Ok(Some(Bson::Null)),
        Bson::Document(document) => {
            let length = document.to_vec()?.len();
            Ok(Some(i32::try_from(length).map_or(Bson::Null, Bson::Int32)))
        }
        other => Err(wrong_type(31_393, "$bsonSize", "a document", other)),
    }
}

fn numeric(operator: &str, value: &Bson) -> Result<Number> {
    let code = match operator {
        "$add" => 16_554,
        "$mod" => 16_611,
        _ => TYPE_MISMATCH,
    };
    Number::of(value).ok_or_else(|| {
        QueryError::invalid(code, format!("{operator} only supports numeric types, not {}", type_name(value)))
    })
}

fn sum_all(values: &[Value]) -> Result<Value> {
    let (mut numbers, mut date, mut null) = (Vec::new(), None, false);
    for value in values {
        match value {
            None => null = true,
            Some(value) if is_null(value) => null = true,
            Some(Bson::DateTime(moment)) => {
                if date.replace(*moment).is_some() {
                    return Err(QueryError::invalid(16_612, "only one date allowed in an $add expression"));
                }
            }
            Some(value) => numbers.push(numeric("$add", value)?),
        }
        if null {
            return Ok(Some(Bson::Null));
        }
    }
    let Some(date) = date else {
        // As in mongod 6.0.27, decimals take doubles by their first 15 digits here, and exactly in `$sum`.
        if numbers.iter().any(|number| matches!(number, Number::Decimal(_))) {
            let sum = numbers.into_iter().try_fold(Number::Int(0), |sum, number| add(sum, number, Overflow::Double))?;
            return Ok(Some(sum.into()));
        }
        return Ok(Some(total(numbers.into_iter()).into()));
    };
    let mut millis = date.timestamp_millis();
    for number in numbers {
        millis = shift(millis, number, 1)?;
    }
    Ok(Some(Bson::DateTime(DateTime::from_millis(millis))))
}

/// Moves a moment by milliseconds, forward or back.
fn shift(millis: i64, by: Number, sign: i64) -> Result<i64> {
    let overflow = || QueryError::bad_value("date overflow");
    let by = match by {
        Number::Double(value) => double_to_long(value.round()).ok_or_else(overflow)?,
        Number::Decimal(value) => value
            .round_to(0, Rounding::HalfEven)
            .to_i128()
            .and_then(|value| i64::try_from(value).ok())
            .ok_or_else(overflow)?,
        other => other.to_long(),
    };
    by.checked_mul(sign).and_then(|by| millis.checked_add(by)).ok_or_else(overflow)
}

fn difference(values: &[Value]) -> Result<Value> {
    let (a, b) = (at(values, 0), at(values, 1));
    if is_null(a) || is_null(b) {
        return Ok(Some(Bson::Null));
    }
    match (a, b) {
        (Bson::DateTime(a), Bson::DateTime(b)) => {
            let gap = a.timestamp_millis().checked_sub(b.timestamp_millis());
            gap.map(|gap| Some(Bson::Int64(gap))).ok_or_else(|| QueryError::bad_value("date overflow"))
        }
        (Bson::DateTime(a), b) => {
            let by = Number::of(b).ok_or_else(|| wrong_type(TYPE_MISMATCH, "$subtract", "a number or a date", b))?;
            Ok(Some(Bson::DateTime(DateTime::from_millis(shift(a.timestamp_millis(), by, -1)?))))
        }
        (a, b) => match (Number::of(a), Number::of(b)) {
            (Some(a), Some(b)) => Ok(Some(subtract(a, b, Overflow::Double)?.into())),
            _ => Err(QueryError::type_mismatch(format!("can't $subtract {} from {}", type_name(b), type_name(a)))),
        },
    }
}

fn product(values: &[Value]) -> Result<Value> {
    // What overflows is the product of all of them as doubles.
    let (mut result, mut double) = (Number::Int(1), 1.0);
    for value in values {
        match value {
            None => return Ok(Some(Bson::Null)),
            Some(value) if is_null(value) => return Ok(Some(Bson::Null)),
            Some(value) => {
                let factor = numeric("$multiply", value)?;
                double *= factor.to_double();
                result = match multiply(result, factor, Overflow::Double)? {
                    Number::Double(_) => Number::Double(double),
                    product => product,
                };
            }
        }
    }
    Ok(Some(result.into()))
}

/// Both arguments as numbers; `None` if one is null.
fn pair(operator: &str, values: &[Value]) -> Result<Option<(Number, Number)>> {
    let (a, b) = (at(values, 0), at(values, 1));
    if is_null(a) || is_null(b) {
        for value in [a, b] {
            if !is_null(value) {
                numeric(operator, value)?;
            }
        }
        return Ok(None);
    }
    Ok(Some((numeric(operator, a)?, numeric(operator, b)?)))
}

fn is_nullish_pair(values: &[Value]) -> bool {
    values.iter().any(is_nullish)
}

fn divide(values: &[Value]) -> Result<Value> {
    if is_nullish_pair(values) {
        return Ok(Some(Bson::Null));
    }
    let Some((a, b)) = pair("$divide", values)? else { return Ok(Some(Bson::Null)) };
    if b.is_zero() {
        return Err(QueryError::bad_value("can't $divide by zero"));
    }
    Ok(Some(match (a, b) {
        (Number::Decimal(_), _) | (_, Number::Decimal(_)) => {
            Bson::Decimal128(a.to_decimal().over(b.to_decimal()).into())
        }
        _ => Bson::Double(a.to_double() / b.to_double()),
    }))
}

fn modulo(values: &[Value]) -> Result<Value> {
    if is_nullish_pair(values) {
        return Ok(Some(Bson::Null));
    }
    let Some((a, b)) = pair("$mod", values)? else { return Ok(Some(Bson::Null)) };
    if b.is_zero() {
        return Err(QueryError::invalid(16_610, "can't $mod by zero"));
    }
    Ok(Some(match (a, b) {
        (Number::Decimal(_), _) | (_, Number::Decimal(_)) => {
            Bson::Decimal128(a.to_decimal().modulo(b.to_decimal()).into())
        }
        // An integer by a double that is one, too, stays an integer.
        (Number::Double(_), _) => Bson::Double(a.to_double() % b.to_double()),
        (_, Number::Double(_)) if b.integral_32().is_none() => Bson::Double(a.to_double() % b.to_double()),
        (Number::Long(_), _) | (_, Number::Long(_)) => Bson::Int64(a.to_long().checked_rem(b.to_long()).unwrap_or(0)),
        (a, b) => {
            let rest = a.to_long().checked_rem(b.to_long()).unwrap_or(0);
            i32::try_from(rest).map_or(Bson::Int64(rest), Bson::Int32)
        }
    }))
}

/// Returns the argument as a number; `None` if it is null.
fn single(operator: &str, values: &[Value]) -> Result<Option<Number>> {
    match at(values, 0) {
        value if is_null(value) => Ok(None),
        value => Number::of(value).map(Some).ok_or_else(|| wrong_type(28_765, operator, "a number", value)),
    }
}

fn absolute(values: &[Value]) -> Result<Value> {
    let Some(number) = single("$abs", values)? else { return Ok(Some(Bson::Null)) };
    Ok(Some(match number {
        Number::Int(value) => value.checked_abs().map_or(Bson::Int64(i64::from(value).abs()), Bson::Int32),
        Number::Long(value) => match value.checked_abs() {
            Some(value) => Bson::Int64(value),
            None => return Err(QueryError::invalid(28_680, "can't take $abs of long long min")),
        },
        Number::Double(value) => Bson::Double(value.abs()),
        Number::Decimal(value) => Bson::Decimal128(value.absolute().into()),
    }))
}

fn whole(operator: &str, values: &[Value], double: fn(f64) -> f64, mode: Rounding) -> Result<Value> {
    let Some(number) = single(operator, values)? else { return Ok(Some(Bson::Null)) };
    Ok(Some(match number {
        Number::Double(value) => Bson::Double(double(value)),
        // A decimal too large to have a digit for units is refused by the decimal library that MongoDB uses.
        Number::Decimal(value) if !value.has_unit_digit() => Bson::Decimal128(Decimal::NaN.into()),
        Number::Decimal(value) => Bson::Decimal128(value.round_to(0, mode).into()),
        other => other.into(),
    }))
}

/// The place that a number is rounded to.
fn precision(operator: &str, value: &Bson) -> Result<i32> {
    let number = Number::of(value).ok_or_else(|| wrong_type(16_004, operator, "a numeric precision", value))?;
    let refuse = |code: i32| QueryError::invalid(code, format!("cannot apply {operator} with such a precision"));
    match number.integral_32() {
        Some(place) if (-20..=100).contains(&place) => Ok(place),
        Some(_) => Err(refuse(51_083)),
        None if matches!(number, Number::Double(value) if !value.is_finite()) => Err(refuse(31_109)),
        None => Err(refuse(51_082)),
    }
}

fn to_place(operator: &str, values: &[Value], mode: Rounding) -> Result<Value> {
    let value = at(values, 0);
    if is_null(value) {
        return Ok(Some(Bson::Null));
    }
    let number = Number::of(value).ok_or_else(|| wrong_type(51_081, operator, "a number", value))?;
    let place = match values.get(1) {
        None => 0,
        Some(value) if is_nullish(value) => return Ok(Some(Bson::Null)),
        Some(_) => precision(operator, at(values, 1))?,
    };
    Ok(Some(match number {
        Number::Double(value) if place == 0 => {
            Bson::Double(if mode == Rounding::Truncate { value.trunc() } else { value.round_ties_even() })
        }
        Number::Double(value) if !value.is_finite() => Bson::Double(value),
        Number::Double(value) => {
            let rounded = Decimal::from_double(value).round_to(place, mode).to_double();
            Bson::Double(if rounded == 0.0 { 0f64.copysign(value) } else { rounded })
        }
        Number::Decimal(value) => Bson::Decimal128(value.round_to(place, mode).into()),
        Number::Int(_) | Number::Long(_) if place >= 0 => number.into(),
        integer => {
            let rounded = Decimal::from_integer(integer.to_long().into()).round_to(place, mode).to_i128();
            let rounded = rounded.and_then(|value| i64::try_from(value).ok());
            let Some(rounded) = rounded else {
                return Err(QueryError::invalid(51_080, format!("invalid conversion to long during {operator}")));
            };
            match (integer, i32::try_from(rounded)) {
                (Number::Int(_), Ok(value)) => Bson::Int32(value),
                _ => Bson::Int64(rounded),
            }
        }
    }))
}

fn root(values: &[Value]) -> Result<Value> {
    let Some(number) = single("$sqrt", values)? else { return Ok(Some(Bson::Null)) };
    let negative = || QueryError::invalid(28_714, "$sqrt's argument must be greater than or equal to 0");
    match number {
        Number::Decimal(value) if value.is_negative() && !value.is_zero() => Err(negative()),
        Number::Decimal(value) => Ok(Some(Bson::Decimal128(value.root().into()))),
        number if number.to_double() < 0.0 => Err(negative()),
        number => Ok(Some(Bson::Double(number.to_double().sqrt()))),
    }
}

fn power(values: &[Value]) -> Result<Value> {
    if is_nullish_pair(values) {
        return Ok(Some(Bson::Null));
    }
    let (base, exponent) = (at(values, 0), at(values, 1));
    let base = Number::of(base).ok_or_else(|| wrong_type(28_762, "$pow", "a numeric base", base))?;
    let exponent = Number::of(exponent).ok_or_else(|| wrong_type(28_763, "$pow", "a numeric exponent", exponent))?;
    let negative_exponent = !exponent.is_nan() && Number::compare(exponent, Number::Int(0)).is_lt();
    if base.is_zero() && negative_exponent {
        return Err(QueryError::invalid(28_764, "$pow cannot take a base of 0 and a negative exponent"));
    }
    Ok(Some(match (base, exponent) {
        (Number::Decimal(_), _) | (_, Number::Decimal(_)) => decimal_power(base.to_decimal(), exponent.to_decimal()),
        (Number::Double(_), _) | (_, Number::Double(_)) => Bson::Double(base.to_double().powf(exponent.to_double())),
        (a, b) => integer_power(a, b),
    }))
}

fn integer_power(base: Number, exponent: Number) -> Bson {
    let (a, b) = (base.to_long(), exponent.to_long());
    let exact = match (a, u32::try_from(b)) {
        (_, Ok(exponent)) => a.checked_pow(exponent),
        (0 | 1, Err(_)) => Some(a),
        (-1, Err(_)) => Some(if b % 2 == 0 { 1 } else { -1 }),
        _ => None,
    };
    let ints = matches!((base, exponent), (Number::Int(_), Number::Int(_)));
    match exact {
        Some(value) => match i32::try_from(value) {
            Ok(value) if ints => Bson::Int32(value),
            _ => Bson::Int64(value),
        },
        None => Bson::Double(base.to_double().powf(exponent.to_double())),
    }
}

/// Exact products for integral exponents; else through doubles.
fn decimal_power(base: Decimal, exponent: Decimal) -> Bson {
    let whole = exponent.to_i128().filter(|_| exponent.is_integral()).filter(|value| value.unsigned_abs() < 100_000);
    let result = match whole {
        Some(exponent) => {
            let (mut result, mut factor, mut left) = (Decimal::ONE, base, exponent.unsigned_abs());
            while left > 0 {
                if left & 1 == 1 {
                    result = result.times(factor);
                }
                factor = factor.times(factor);
                left >>= 1;
            }
            if exponent < 0 { Decimal::ONE.over(result) } else { result }
        }
        None if base.compare(Decimal::ONE).is_eq() => Decimal::ONE,
        None if base.is_zero() && !exponent.is_nan() => Decimal::ZERO,
        None if base.is_infinite() && !exponent.is_nan() && !exponent.is_integral() => {
            if exponent.is_negative() {
                Decimal::ZERO
            } else {
                Decimal::Infinite { negative: false }
            }
        }
        None if base.is_negative() && !exponent.is_infinite() && !exponent.is_integral() => Decimal::NaN,
        None if base.is_negative() || base.is_infinite() => {
            Decimal::from_double_15(base.to_double().powf(exponent.to_double()))
        }
        None => base.logarithm().times(exponent).exponential(),
    };
    Bson::Decimal128(result.padded().into())
}

fn exponential(values: &[Value]) -> Result<Value> {
    let Some(number) = single("$exp", values)? else { return Ok(Some(Bson::Null)) };
    Ok(Some(match number {
        Number::Decimal(value) => Bson::Decimal128(value.exponential().into()),
        number => Bson::Double(number.to_double().exp()),
    }))
}

fn logarithm(operator: &str, code: i32, values: &[Value], double: fn(f64) -> f64) -> Result<Value> {
    let Some(number) = single(operator, values)? else { return Ok(Some(Bson::Null)) };
    if !number.is_nan() && Number::compare(number, Number::Int(0)).is_le() {
        return Err(QueryError::invalid(code, format!("{operator}'s argument must be a positive number")));
    }
    Ok(Some(match number {
        // MongoDB has a double for what is no number, also of a decimal.
        number if number.is_nan() => Bson::Double(f64::NAN),
        Number::Decimal(value) if operator == "$ln" => Bson::Decimal128(value.logarithm().into()),
        Number::Decimal(value) => Bson::Decimal128(value.logarithm_10().into()),
        number => Bson::Double(double(number.to_double())),
    }))
}

fn log(values: &[Value]) -> Result<Value> {
    if is_nullish_pair(values) {
        return Ok(Some(Bson::Null));
    }
    let (value, base) = (at(values, 0), at(values, 1));
    let value = Number::of(value).ok_or_else(|| wrong_type(28_756, "$log", "a number", value))?;
    let base = Number::of(base).ok_or_else(|| wrong_type(28_757, "$log", "a numeric base", base))?;
    if !value.is_nan() && Number::compare(value, Number::Int(0)).is_le() {
        return Err(QueryError::invalid(28_758, "$log's argument must be a positive number"));
    }
    if !base.is_nan()
        && (Number::compare(base, Number::Int(0)).is_le() || Number::compare(base, Number::Int(1)).is_eq())
    {
        return Err(QueryError::invalid(28_759, "$log's base must be a positive number not equal to 1"));
    }
    Ok(Some(match (value, base) {
        (value, base) if value.is_nan() || base.is_nan() => Bson::Double(f64::NAN),
        (Number::Decimal(_), _) | (_, Number::Decimal(_)) => {
            let quotient = value.to_decimal().logarithm().over(base.to_decimal().logarithm());
            Bson::Decimal128(quotient.into())
        }
        _ => Bson::Double(value.to_double().ln() / base.to_double().ln()),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widens_and_rounds_as_mongodb_does() {
        let call = |run: fn(&[Value]) -> Result<Value>, values: &[Bson]| {
            run(&values.iter().cloned().map(Some).collect::<Vec<_>>()).unwrap().unwrap()
        };
        assert_eq!(call(product, &[Bson::Int32(i32::MAX), Bson::Int32(2)]), Bson::Int64(4_294_967_294));
        assert_eq!(call(power, &[Bson::Int32(2), Bson::Int32(31)]), Bson::Int64(1 << 31));
        assert_eq!(call(|v| to_place("$round", v, Rounding::HalfEven), &[Bson::Double(2.5)]), Bson::Double(2.0));
        assert_eq!(
            call(|v| to_place("$round", v, Rounding::HalfEven), &[Bson::Int32(1250), Bson::Int32(-2)]),
            Bson::Int32(1200)
        );
        let decimal = |text: &str| Bson::Decimal128(text.parse().unwrap());
        assert_eq!(call(power, &[1.into(), decimal("-Infinity")]), decimal("1.000000000000000000000000000000000"));
        assert_eq!(call(power, &[0.into(), decimal("NaN")]), decimal("NaN"));
        assert_eq!(call(power, &[decimal("-Infinity"), 2.5.into()]), decimal("Infinity"));
        let truncated = call(|v| to_place("$trunc", v, Rounding::Truncate), &[decimal("1E+30"), 5.into()]);
        assert_eq!(truncated, decimal("1000000000000000000000000000000.000"));
        // The rest is taken along, and rounded with the next number.
        assert_eq!(call(sum_all, &[2.into(), (1.0 / 3.0).into(), 1.into()]), Bson::Double(3.333_333_333_333_333));
        assert_eq!(call(sum_all, &[2.into(), 1.into(), (1.0 / 3.0).into()]), Bson::Double(3.333_333_333_333_333_5));
        assert_eq!(call(sum_all, &[1e16.into(), 3.into(), (-1e16).into()]), Bson::Double(4.0));
        for much in [1e300, -1e300, f64::INFINITY, f64::NAN] {
            let moved = [Some(DateTime::from_millis(1).into()), Some(Bson::Double(much))];
            assert!(sum_all(&moved).is_err(), "{much}");
        }
        assert_eq!(call(sum_all, &[f64::INFINITY.into(), 1.0.into(), 1.into()]), Bson::Double(f64::INFINITY));
    }
}
