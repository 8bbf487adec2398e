//! Random numbers for `$rand`, `$sampleRate` and `$sample`, and where one of several documents is taken.

use std::cell::Cell;
use std::hash::{BuildHasher as _, RandomState};

thread_local! {
    static STATE: Cell<u64> = Cell::new(RandomState::new().hash_one(0u8));
}

/// Returns a random number from 0 to below 1.
pub(super) fn random() -> f64 {
    f64::from(bits()) / (f64::from(u32::MAX) + 1.0)
}

/// Returns a random number from 0 up to this one.
#[must_use]
pub fn random_up_to(last: usize) -> usize {
    usize::try_from(bits()).unwrap_or(0) % last.saturating_add(1)
}

/// Random bits (xorshift, seeded from the system).
fn bits() -> u32 {
    STATE.with(|state| {
        let mut bits = state.get() | 1;
        bits ^= bits << 13;
        bits ^= bits >> 7;
        bits ^= bits << 17;
        state.set(bits);
        u32::try_from(bits.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32).unwrap_or(0)
    })
}
