//! A mistake of rmem's own in one command costs that command, not the server.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::failure::{Answer, Failure, codes};

/// What a command answers; an internal error where it panicked.
pub(super) fn caught(work: impl FnOnce() -> Answer) -> Answer {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(mistake()))
}

/// Whether work came to its end without a panic.
pub(super) fn passed(work: impl FnOnce()) -> bool {
    catch_unwind(AssertUnwindSafe(work)).is_ok()
}

/// The failure of a command that such a mistake ended.
pub(super) fn mistake() -> Failure {
    Failure::new(codes::INTERNAL, "a mistake in rmem itself ended this command; please report it")
}
