//! Random numbers for `$rand`, `$sampleRate` and `$sample`.

use std::cell::Cell;
use std::hash::{BuildHasher as _, RandomState};

thread_local! {
    static STATE: Cell<u64> = Cell::new(RandomState::new().hash_one(0u8));
}

/// Returns a random number from 0 to below 1 (xorshift, seeded from the system).
pub(super) fn random() -> f64 {
    STATE.with(|state| {
        let mut bits = state.get() | 1;
        bits ^= bits << 13;
        bits ^= bits >> 7;
        bits ^= bits << 17;
        state.set(bits);
        let mantissa = u32::try_from(bits.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32).unwrap_or(0);
        f64::from(mantissa) / (f64::from(u32::MAX) + 1.0)
    })
}
