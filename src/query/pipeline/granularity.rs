//! The granularity of `$bucketAuto`: boundaries that are preferred numbers.

use bson::Bson;

use crate::query::decimal::Decimal;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;

/// Boundaries are a power of ten times one of these numbers (Renard series, 1-2-5, and the E series), or powers of two.
#[derive(Debug)]
pub(super) enum Granularity {
    Series(Vec<f64>),
    PowersOfTwo,
}

const SERIES: [(&str, &[u16]); 9] = [
    ("R5", &[10, 16, 25, 40, 63]),
    ("R10", &[100, 125, 160, 200, 250, 315, 400, 500, 630, 800]),
    ("R20", &[100, 112, 125, 140, 160, 180, 200, 224, 250, 280, 315, 355, 400, 450, 500, 560, 630, 710, 800, 900]),
    (
        "R40",
        &[
            100, 106, 112, 118, 125, 132, 140, 150, 160, 170, 180, 190, 200, 212, 224, 236, 250, 265, 280, 300, 315,
            335, 355, 375, 400, 425, 450, 475, 500, 530, 560, 600, 630, 670, 710, 750, 800, 850, 900, 950,
        ],
    ),
    (
        "R80",
        &[
            103, 109, 115, 122, 128, 136, 145, 155, 165, 175, 185, 195, 206, 218, 230, 243, 258, 272, 290, 307, 325,
            345, 365, 387, 412, 437, 462, 487, 515, 545, 575, 615, 650, 690, 730, 775, 825, 875, 925, 975,
        ],
    ),
    ("1-2-5", &[10, 20, 50]),
    ("E6", &[10, 15, 22, 33, 47, 68]),
    ("E12", &[10, 12, 15, 18, 22, 27, 33, 39, 47, 56, 68, 82]),
    ("E24", &[10, 11, 12, 13, 15, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 43, 47, 51, 56, 62, 68, 75, 82, 91]),
];

/// The finer series of three digits divide a power of ten evenly.
const EVEN: [(&str, u16); 3] = [("E48", 48), ("E96", 96), ("E192", 192)];

impl Granularity {
    pub(super) fn parse(name: &str) -> Result<Self> {
        if name == "POWERSOF2" {
            return Ok(Self::PowersOfTwo);
        }
        if let Some((_, numbers)) = SERIES.iter().find(|(known, _)| *known == name) {
            return Ok(Self::Series(numbers.iter().copied().map(f64::from).collect()));
        }
        if let Some((_, count)) = EVEN.iter().find(|(known, _)| *known == name) {
            let number = |index: u16| match (100.0 * 10f64.powf(f64::from(index) / f64::from(*count))).round() {
                // The one number of the standard that is not the nearest.
                919.0 => 920.0,
                number => number,
            };
            return Ok(Self::Series((0..*count).map(number).collect()));
        }
        Err(QueryError::invalid(40_257, format!("unknown rounding granularity '{name}'")))
    }

    /// Refuses values that no boundary can be put around.
    pub(super) fn check(value: &Bson) -> Result<()> {
        match Number::of(value) {
            None => {
                Err(QueryError::invalid(40_258, "$bucketAuto with 'granularity' takes numbers only")
                    .about("$bucketAuto"))
            }
            Some(number) if number.is_nan() => {
                Err(QueryError::invalid(40_259, "$bucketAuto cannot round NaN").about("$bucketAuto"))
            }
            Some(number) if number.to_double() < 0.0 => {
                Err(QueryError::invalid(40_260, "$bucketAuto with 'granularity' takes no negative numbers")
                    .about("$bucketAuto"))
            }
            Some(_) => Ok(()),
        }
    }

    /// Returns the next boundary above a value; 0 is one itself.
    pub(super) fn above(&self, value: &Bson) -> Bson {
        self.rounded(value, |double| match self {
            Self::PowersOfTwo => (double.log2().floor() + 1.0).exp2(),
            Self::Series(series) => next_above(series, double),
        })
    }

    /// Returns the next boundary below a value; 0 is one itself.
    pub(super) fn below(&self, value: &Bson) -> Bson {
        self.rounded(value, |double| match self {
            Self::PowersOfTwo => (double.log2().ceil() - 1.0).exp2(),
            Self::Series(series) => next_below(series, double),
        })
    }

    fn rounded(&self, value: &Bson, round: impl Fn(f64) -> f64) -> Bson {
        match Number::of(value) {
            Some(number) if number.is_zero() || !number.is_finite() => value.clone(),
            Some(Number::Decimal(decimal)) => {
                Bson::Decimal128(Decimal::from_double_15(round(decimal.to_double())).reduced().into())
            }
            // Whole powers are integers.
            Some(number) => match (self, Number::Double(round(number.to_double()))) {
                (Self::PowersOfTwo, bound) => match (bound.integral_32(), bound.integral()) {
                    (Some(bound), _) => Bson::Int32(bound),
                    (None, Some(bound)) => Bson::Int64(bound),
                    (None, None) => bound.into(),
                },
                (Self::Series(_), bound) => bound.into(),
            },
            None => value.clone(),
        }
    }
}

fn ends(series: &[f64]) -> (f64, f64) {
    (series.first().copied().unwrap_or(1.0), series.last().copied().unwrap_or(1.0))
}

/// Returns the least number of the series, times a power of ten, that is greater.
fn next_above(series: &[f64], value: f64) -> f64 {
    let ((first, last), mut factor) = (ends(series), 1.0);
    while value >= last * factor {
        factor *= 10.0;
    }
    while value < first * factor {
        let least = first * factor;
        factor /= 10.0;
        if value >= last * factor {
            return least;
        }
    }
    let place = series.partition_point(|number| number * factor <= value);
    series.get(place).map_or(value, |number| number * factor)
}

/// Returns the greatest number of the series, times a power of ten, that is less.
fn next_below(series: &[f64], value: f64) -> f64 {
    let ((first, last), mut factor) = (ends(series), 1.0);
    while value <= first * factor {
        factor /= 10.0;
    }
    while value > last * factor {
        let greatest = last * factor;
        factor *= 10.0;
        if value <= first * factor {
            return greatest;
        }
    }
    let place = series.partition_point(|number| number * factor < value);
    place.checked_sub(1).and_then(|place| series.get(place)).map_or(value, |number| number * factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boundaries_are_the_next_preferred_numbers() {
        let between = |name: &str, value: f64| {
            let granularity = Granularity::parse(name).unwrap();
            (granularity.below(&Bson::Double(value)), granularity.above(&Bson::Double(value)))
        };
        let pair = |low: f64, high: f64| (Bson::Double(low), Bson::Double(high));
        assert_eq!(between("R5", 12.0), pair(10.0, 16.0));
        assert_eq!(between("1-2-5", 50.0), pair(20.0, 100.0));
        assert_eq!(between("E6", 0.8), pair(0.68, 1.0));
        assert_eq!(between("POWERSOF2", 8.0), (Bson::Int32(4), Bson::Int32(16)));
        assert_eq!(between("POWERSOF2", 1.0), (Bson::Double(0.5), Bson::Int32(2)));
        assert_eq!(between("E192", 919.0).1, Bson::Double(920.0));
        assert_eq!(between("R20", 0.0), pair(0.0, 0.0));
        assert!(Granularity::parse("R7").is_err());
    }
}
