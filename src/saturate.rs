//! Numbers that are as large as their type allows where they do not fit.

/// Returns a count, a size or a time as the 64-bit integer that BSON, SQLite and CLIPS have; [`i64::MAX`] where it is larger.
pub(crate) fn to_i64<N: TryInto<i64>>(number: N) -> i64 {
    number.try_into().unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_large_is_the_largest() {
        assert_eq!((to_i64(7_usize), to_i64(u64::MAX), to_i64(u128::MAX)), (7, i64::MAX, i64::MAX));
    }
}
