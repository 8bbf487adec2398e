//! Circular and hyperbolic functions of decimals and their inverses, computed by series.
//!
//! They are computed with the 34 digits of a decimal, of which the last few may be wrong.

use ethnum::U256;

use super::decimal::Decimal;

/// A quarter of a turn, and the power of ten that it is multiplied by.
const QUARTER: &str = "157079632679489661923132169163975144209858469968755291048747229615390820314";
const SCALE: i32 = 74;
/// The number of terms that are enough for arguments below one.
const TERMS: i32 = 20;

impl Decimal {
    pub(super) fn sine(self) -> Self {
        if self.is_zero() {
            return self;
        }
        let Some((quarters, rest)) = self.turned() else { return Self::NaN };
        let sine = match quarters {
            0 => rest.small_sine(),
            1 => rest.small_cosine(),
            2 => rest.small_sine().negated(),
            _ => rest.small_cosine().negated(),
        };
        if self.is_negative() { sine.negated() } else { sine }
    }

    pub(super) fn cosine(self) -> Self {
        let Some((quarters, rest)) = self.turned() else { return Self::NaN };
        match quarters {
            0 => rest.small_cosine(),
            1 => rest.small_sine().negated(),
            2 => rest.small_cosine().negated(),
            _ => rest.small_sine(),
        }
    }

    pub(super) fn tangent(self) -> Self {
        if self.is_zero() { self } else { self.sine().over(self.cosine()) }
    }

    /// Returns the magnitude as quarters of a turn (whole turns left out) and the rest, at most an eighth of a turn to
    /// either side; `None` if it is not finite. Numbers above 10^40 lose digits.
    fn turned(self) -> Option<(u8, Self)> {
        let Self::Finite { coefficient, exponent, .. } = self else { return None };
        let quarter = QUARTER.bytes().fold(U256::ZERO, |sum, digit| sum * 10 + U256::from(digit - b'0'));
        let turn = quarter * 4;
        if exponent < -SCALE {
            return Some((0, self.absolute()));
        }
        let shifts = 0..exponent + SCALE;
        let angle = shifts.fold(U256::from(coefficient) % turn, |angle, _| angle * 10 % turn);
        let (quarters, rest) = (u8::try_from(angle / quarter).unwrap_or(0), angle % quarter);
        let past = quarter - rest;
        let decimal = |negative, value| Self::rounded(negative, value, -SCALE, false);
        Some(if past < rest { ((quarters + 1) % 4, decimal(true, past)) } else { (quarters, decimal(false, rest)) })
    }

    /// `x - x³/3! + x⁵/5! …`, near zero; with `hyperbolic`, all terms are added.
    fn odd_powers(self, hyperbolic: bool) -> Self {
        self.powers(self, 2, hyperbolic)
    }

    fn small_sine(self) -> Self {
        self.odd_powers(false)
    }

    fn small_cosine(self) -> Self {
        self.powers(Self::ONE, 1, false)
    }

    /// Returns the sum of `term`, and of each term before times `∓x² / (n(n+1))`.
    fn powers(self, mut term: Self, first: i32, hyperbolic: bool) -> Self {
        let square = if hyperbolic { self.times(self) } else { self.times(self).negated() };
        let mut sum = term;
        for index in 0..TERMS {
            let divisor = i128::from(first + 2 * index) * i128::from(first + 2 * index + 1);
            term = term.times(square).over(Self::from_integer(divisor));
            sum = sum.plus(term);
        }
        sum.reduced()
    }

    pub(super) fn hyperbolic_sine(self) -> Self {
        if !self.is_finite() || self.is_zero() {
            return self;
        }
        if self.is_small() {
            return self.odd_powers(true);
        }
        let power = self.exponential();
        power.minus(Self::ONE.over(power)).halved()
    }

    pub(super) fn hyperbolic_cosine(self) -> Self {
        if !self.is_finite() {
            return self.absolute();
        }
        let power = self.exponential();
        power.plus(Self::ONE.over(power)).halved()
    }

    pub(super) fn hyperbolic_tangent(self) -> Self {
        if self.to_double().abs() > 50.0 {
            return if self.is_negative() { Self::ONE.negated() } else { Self::ONE };
        }
        if self.is_zero() { self } else { self.hyperbolic_sine().over(self.hyperbolic_cosine()) }
    }

    /// Returns the angle whose tangent it is.
    pub(super) fn arc_tangent(self) -> Self {
        match self {
            Self::NaN => self,
            _ if self.is_zero() => self,
            _ if self.is_negative() => self.negated().arc_tangent().negated(),
            Self::Infinite { .. } => quarter(),
            _ if self.compare(Self::ONE).is_gt() => quarter().minus(Self::ONE.over(self).arc_tangent()),
            _ => {
                // Thrice half the angle, and the series of what is left.
                let half = |tangent: Self| tangent.over(Self::ONE.plus(Self::ONE.plus(tangent.times(tangent)).root()));
                let tangent = half(half(half(self)));
                let square = tangent.times(tangent).negated();
                let (mut sum, mut power) = (tangent, tangent);
                for index in 1..=TERMS {
                    power = power.times(square);
                    sum = sum.plus(power.over(Self::from_integer((2 * index + 1).into())));
                }
                sum.times(Self::from_integer(8)).reduced()
            }
        }
    }

    /// Returns the angle at which `(x, self)` is seen.
    pub(super) fn arc_tangent_of(self, x: Self) -> Self {
        let half = quarter().times(Self::from_integer(2));
        let signed = |angle: Self| if self.is_negative() { angle.negated() } else { angle };
        match (self, x) {
            (Self::NaN, _) | (_, Self::NaN) => Self::NaN,
            (Self::Infinite { .. }, Self::Infinite { negative }) => {
                let eighth = quarter().halved();
                signed(if negative { half.minus(eighth) } else { eighth })
            }
            (Self::Infinite { .. }, _) => signed(quarter()),
            _ if self.is_zero() => signed(if x.is_negative() { half } else { Self::ZERO.padded() }),
            _ if x.is_zero() => signed(quarter()),
            _ => {
                let angle = self.absolute().over(x.absolute()).arc_tangent();
                signed(if x.is_negative() { half.minus(angle) } else { angle })
            }
        }
    }

    pub(super) fn arc_sine(self) -> Self {
        if self.is_zero() { self } else { self.arc_tangent_of(self.leg()) }
    }

    pub(super) fn arc_cosine(self) -> Self {
        self.leg().arc_tangent_of(self)
    }

    /// Returns the other leg of a right triangle whose hypotenuse is one.
    fn leg(self) -> Self {
        Self::ONE.minus(self).times(Self::ONE.plus(self)).root()
    }

    pub(super) fn area_sine(self) -> Self {
        if !self.is_finite() || self.is_zero() {
            return self;
        }
        if self.is_negative() {
            return self.negated().area_sine().negated();
        }
        if self.is_small() {
            return self.improved(f64::asinh, |guess| (guess.hyperbolic_sine(), guess.hyperbolic_cosine()));
        }
        self.plus(self.times(self).plus(Self::ONE).root()).logarithm()
    }

    pub(super) fn area_cosine(self) -> Self {
        if !self.is_finite() {
            return self;
        }
        self.plus(self.minus(Self::ONE).times(self.plus(Self::ONE)).root()).logarithm()
    }

    pub(super) fn area_tangent(self) -> Self {
        if self.is_zero() {
            return self;
        }
        if self.is_small() {
            return self.improved(f64::atanh, |guess| {
                let tangent = guess.hyperbolic_tangent();
                (tangent, Self::ONE.minus(tangent.times(tangent)))
            });
        }
        let quotient = Self::ONE.plus(self).over(Self::ONE.minus(self));
        match quotient {
            Self::Infinite { .. } => Self::Infinite { negative: self.is_negative() },
            _ if quotient.is_zero() => Self::Infinite { negative: true },
            _ => quotient.logarithm().halved(),
        }
    }

    /// What a function gives this for, by Newton's method from what doubles say; `at` gives the function
    /// and its slope.
    fn improved(self, inverse: fn(f64) -> f64, at: impl Fn(Self) -> (Self, Self)) -> Self {
        let mut guess = Self::from_double(inverse(self.to_double()));
        for _ in 0..2 {
            let (value, slope) = at(guess);
            guess = guess.minus(value.minus(self).over(slope));
        }
        guess
    }

    fn halved(self) -> Self {
        self.times(Self::Finite { negative: false, coefficient: 5, exponent: -1 })
    }

    fn is_finite(self) -> bool {
        matches!(self, Self::Finite { .. })
    }

    /// Returns whether differences of powers would lose digits.
    fn is_small(self) -> bool {
        self.to_double().abs() < 0.5
    }
}

/// Returns a quarter of a turn.
fn quarter() -> Decimal {
    Decimal::parse(QUARTER).map_or(Decimal::NaN, |digits| {
        digits.times(Decimal::Finite { negative: false, coefficient: 1, exponent: -SCALE })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::Decimal128;

    /// Returns the first 30 digits, which are right in any case.
    fn digits(value: Decimal) -> String {
        Decimal128::from(value).to_string().chars().take(31).collect()
    }

    fn decimal(text: &str) -> Decimal {
        Decimal::parse(text).unwrap()
    }

    #[test]
    fn circular_functions_have_more_digits_than_doubles() {
        assert_eq!(digits(decimal("1").sine()), "0.84147098480789650665250232163");
        assert_eq!(digits(decimal("-3").cosine()), "-0.9899924966004454572715727947");
        assert_eq!(digits(decimal("1E+30").sine()), "-0.0901169019121380580303864289");
        assert_eq!(digits(decimal("2.5").tangent()), "-0.7470222972386602793553526878");
        assert_eq!(digits(decimal("0.5").arc_sine()), "0.52359877559829887307710723054");
        assert_eq!(digits(decimal("-1").arc_cosine()), "3.14159265358979323846264338327");
        assert_eq!(digits(decimal("1").arc_tangent_of(decimal("2.5"))), "0.38050637711236488630358791681");
    }

    #[test]
    fn hyperbolic_functions_have_more_digits_than_doubles() {
        assert_eq!(digits(decimal("-3").area_sine()), "-1.8184464592320668234836989635");
        assert_eq!(digits(decimal("0.1").hyperbolic_sine()), "0.10016675001984402582372938352");
        assert_eq!(digits(decimal("0.1").area_tangent()), "0.10033534773107558063572655206");
        assert_eq!(digits(decimal("2").area_cosine()), "1.31695789692481670862504634730");
    }
}
