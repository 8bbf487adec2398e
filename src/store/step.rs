//! Work that is one step of a store, with a result of its own.

use super::StoreError;

/// Work as a store takes it, which may call it once.
pub type Step<'w> = &'w mut dyn FnMut() -> Result<(), StoreError>;

/// Why nothing of a step is kept.
#[derive(Debug)]
pub enum Undone<E> {
    /// Its work failed.
    Work(E),
    /// The store failed, before the work or at its end.
    Store(StoreError),
}

/// Does `work` as a step that `begin` begins, as [`super::Store::atomically`] does; gives what the work gives.
///
/// # Errors
/// Where the work or the store fails: nothing is kept then.
pub fn as_step<T, E>(
    begin: impl FnOnce(Step<'_>) -> Result<(), StoreError>,
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, Undone<E>> {
    let (mut work, mut outcome) = (Some(work), None);
    // Where the work fails, this error only keeps the store from keeping it.
    let nothing_done = || StoreError::Failed { address: "a step".to_owned(), reason: "nothing was done".to_owned() };
    let kept = begin(&mut || {
        outcome = work.take().map(|work| work());
        if let Some(Ok(_)) = &outcome { Ok(()) } else { Err(nothing_done()) }
    });
    match (kept, outcome) {
        (Ok(()), Some(Ok(value))) => Ok(value),
        (_, Some(Err(error))) => Err(Undone::Work(error)),
        (Err(error), _) => Err(Undone::Store(error)),
        (Ok(()), None) => Err(Undone::Store(nothing_done())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failure() -> StoreError {
        StoreError::Failed { address: "here".to_owned(), reason: "the disk is full".to_owned() }
    }

    #[test]
    fn a_step_gives_what_its_work_gives_or_the_error_that_undid_it() {
        let done = as_step(|work| work(), || Ok::<_, u8>(7));
        assert!(matches!(done, Ok(7)));
        let mut kept = None;
        let undone = as_step(
            |work| {
                kept = Some(work());
                kept.take().unwrap()
            },
            || Err::<(), _>(3),
        );
        assert!(matches!(undone, Err(Undone::Work(3))));
        let at_the_end = as_step(|work| work().and_then(|()| Err(failure())), || Ok::<_, u8>(7));
        assert!(matches!(at_the_end, Err(Undone::Store(error)) if error.to_string() == failure().to_string()));
        let before = as_step(|_| Err(failure()), || Ok::<_, u8>(7));
        assert!(matches!(before, Err(Undone::Store(_))));
        assert!(matches!(as_step(|_| Ok(()), || Ok::<_, u8>(7)), Err(Undone::Store(_))));
    }
}
