//! A mistake of rmem's own in one command costs that command, not the server.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::failure::{Answer, Failure, codes};

/// What a command answers; an internal error where it panicked.
pub(super) fn caught(work: impl FnOnce() -> Answer) -> Answer {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        let message = "a mistake in rmem itself ended this command; please report it";
        Err(Failure::new(codes::INTERNAL, message))
    })
}
