//! Writes of which, where they fail, nothing is kept, or what they did before, as they say.

use super::failure::{Answer, is_kept};
use crate::memory::Memory;
use crate::store::{Namespace, Undone, as_step};

/// Does something that, where it fails, has done nothing, unless it says so.
pub(super) fn attempt(memory: &Memory, ns: &Namespace, work: impl FnOnce(&Memory) -> Answer) -> Answer {
    let work = || {
        let answer = work(memory);
        if is_kept(&answer) { Ok(answer) } else { Err(answer) }
    };
    match as_step(|step| memory.as_one(ns, step), work) {
        Ok(answer) | Err(Undone::Work(answer)) => answer,
        Err(Undone::Store(error)) => Err(error.into()),
    }
}
