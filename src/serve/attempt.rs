//! Writes of which, where they fail, nothing is kept.

use super::failure::Answer;
use crate::memory::Memory;
use crate::store::{Namespace, Undone, as_step};

/// Does something that, where it fails, has done nothing.
pub(super) fn attempt(memory: &Memory, ns: &Namespace, work: impl FnOnce(&Memory) -> Answer) -> Answer {
    as_step(|step| memory.as_one(ns, step), || work(memory)).map_err(|undone| match undone {
        Undone::Work(failure) => failure,
        Undone::Store(error) => error.into(),
    })
}
