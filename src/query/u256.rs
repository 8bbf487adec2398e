//! What decimals need of 256-bit integers beside the arithmetic of [`ethnum::U256`]: digits, powers of ten, square
//! roots.

use std::sync::LazyLock;

use ethnum::U256;

/// The powers of ten that fit.
static POWERS: LazyLock<[U256; 78]> = LazyLock::new(|| {
    let mut powers = [U256::ONE; 78];
    for nth in 1..powers.len() {
        powers[nth] = powers[nth - 1] * 10;
    }
    powers
});

/// 10 to a power of at most 77, the greatest that fits.
pub(super) fn ten_to(exponent: u32) -> U256 {
    POWERS[exponent.min(77) as usize]
}

/// Returns the number of decimal digits; 0 has none.
pub(super) fn digits(value: U256) -> u32 {
    if let Ok(small) = u128::try_from(value) {
        return small.checked_ilog10().map_or(0, |log| log + 1);
    }
    // The logarithm of 2 is a little more than 1233 / 4096: it says which of two numbers of digits there are.
    let least = ((256 - value.leading_zeros()) * 1233) >> 12;
    least + u32::from(value >= ten_to(least))
}

/// Returns the greatest integer whose square is at most the value.
pub(super) fn square_root(value: U256) -> u128 {
    let bits = 256 - value.leading_zeros();
    let mut root: u128 = 0;
    for index in (0..bits.div_ceil(2)).rev() {
        let candidate = root | 1 << index;
        if U256::from(candidate) * U256::from(candidate) <= value {
            root = candidate;
        }
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_of_a_square_is_what_was_squared() {
        for root in [0, 1, 9_999_999_999_999_999_999_999_999_999_999_999, u128::MAX] {
            let square = U256::from(root) * U256::from(root);
            assert_eq!(square_root(square), root);
            assert_eq!(square_root(square + U256::from(root)), root);
        }
    }

    #[test]
    fn a_power_of_ten_has_one_digit_more_than_its_exponent() {
        for exponent in 0..=77 {
            assert_eq!(digits(ten_to(exponent)), exponent + 1, "10^{exponent}");
            assert_eq!(digits(ten_to(exponent) - 1), exponent, "10^{exponent} - 1");
        }
        assert_eq!(digits(U256::MAX), 78);
    }
}
