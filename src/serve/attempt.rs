//! Writes of which, where they fail, nothing is kept.

use super::failure::{Answer, Failure, codes};
use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// Does something that, where it fails, has done nothing.
pub(super) fn attempt(memory: &Memory, ns: &Namespace, work: impl FnOnce(&Memory) -> Answer) -> Answer {
    let (mut work, mut answer) = (Some(work), None);
    let kept = memory.as_one(ns, &mut || {
        answer = work.take().map(|work| work(memory));
        match &answer {
            Some(Ok(_)) => Ok(()),
            // It only says that nothing is to be kept.
            _ => Err(StoreError::Failed { address: memory.describe(), reason: "nothing was done".to_owned() }),
        }
    });
    match (kept, answer) {
        (Ok(()), Some(answer)) | (Err(_), Some(answer @ Err(_))) => answer,
        (Err(error), _) => Err(error.into()),
        (Ok(()), None) => Err(Failure::new(codes::INTERNAL, "nothing was done")),
    }
}
