//! The measurement: every kind of work, on every subject in turn.

use std::time::{Duration, Instant};

use super::figure::Figure;
use super::objects::Objects;
use super::subject::Subject;
use super::work::Work;
use crate::store::StoreError;

/// How many documents are stored at once where that is not measured.
const BATCH: usize = 10_000;
/// A kind of work is not repeated any more after so long, but at least [`LEAST`] times; what takes longer once is
/// measured once.
const WORK_TIMEOUT: Duration = Duration::from_secs(4);
/// The fewest repetitions.
const LEAST: usize = 5;
/// How many repetitions make a turn.
const SERIES: usize = 20;

/// What is measured.
#[derive(Debug, Clone)]
pub struct Extent {
    /// How many documents there are, growing.
    pub documents: Vec<usize>,
    /// How often each kind of work is repeated.
    pub rounds: usize,
}

/// Measures all work at all sizes on empty subjects; reports each figure as it is measured.
///
/// # Errors
/// The first failure of a subject, or of `report`.
pub fn run<E: From<StoreError>>(
    subjects: &[&dyn Subject],
    extent: &Extent,
    mut report: impl FnMut(&Figure) -> Result<(), E>,
) -> Result<Vec<Figure>, E> {
    let (mut figures, mut objects) = (Vec::new(), Objects::default());
    for size in &extent.documents {
        while objects.count < *size {
            let batch = objects.more(BATCH.min(size - objects.count));
            subjects.iter().try_for_each(|subject| subject.insert(batch.clone()))?;
        }
        let mut is_indexed = false;
        for work in Work::all() {
            if work.is_indexed && !is_indexed {
                subjects.iter().try_for_each(|subject| subject.index())?;
                is_indexed = true;
            }
            let medians = repeat(subjects, work, extent.rounds, &mut objects)?;
            let figure = Figure { documents: *size, work, medians };
            report(&figure)?;
            figures.push(figure);
        }
        subjects.iter().try_for_each(|subject| subject.drop_index())?;
    }
    Ok(figures)
}

/// Repeats a kind of work, subject by subject in turn. Each is the first as often as the others: what runs behind another
/// one has its leftovers in the caches of the processor.
fn repeat(
    subjects: &[&dyn Subject],
    work: Work,
    rounds: usize,
    objects: &mut Objects,
) -> Result<Vec<(&'static str, Duration)>, StoreError> {
    // The first round is for caches, of all subjects; it also shows how long a turn may be.
    let task = work.task(objects);
    let first = subjects.iter().map(|subject| subject.time(&task)).collect::<Result<Vec<Duration>, _>>()?;
    let one = first.iter().sum::<Duration>().max(Duration::from_micros(1));
    let names = subjects.iter().map(|subject| subject.name());
    if one > WORK_TIMEOUT {
        return Ok(names.zip(first).collect());
    }
    let mut times: Vec<Vec<Duration>> = vec![Vec::new(); subjects.len()];
    let turn = usize::try_from(WORK_TIMEOUT.as_micros() / one.as_micros()).unwrap_or(SERIES).clamp(1, SERIES);
    let (mut done, start) = (0, Instant::now());
    while done < rounds && (done < LEAST || start.elapsed() < WORK_TIMEOUT) {
        let series: Vec<_> = (0..turn.min(rounds - done)).map(|_| work.task(objects)).collect();
        let mut all: Vec<_> = subjects.iter().zip(&mut times).collect();
        let first = done / turn % all.len().max(1);
        all.rotate_left(first);
        for (subject, times) in all {
            for task in &series {
                times.push(subject.time(task)?);
            }
        }
        done += series.len();
    }
    Ok(names.zip(times).map(|(name, times)| (name, median(times))).collect())
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times.get(times.len() / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use bson::Document;

    use super::*;
    use crate::bench::work::Operation;

    /// Notes its name for each insert.
    struct Noting<'l>(&'static str, &'l RefCell<Vec<&'static str>>);

    impl Subject for Noting<'_> {
        fn name(&self) -> &'static str {
            self.0
        }

        fn insert(&self, _: Vec<Document>) -> Result<(), StoreError> {
            self.1.borrow_mut().push(self.0);
            Ok(())
        }

        fn find(&self, _: Document) -> Result<u64, StoreError> {
            Ok(0)
        }

        fn update(&self, _: Document, _: Document) -> Result<(), StoreError> {
            Ok(())
        }

        fn nearest(&self) -> Result<u64, StoreError> {
            Ok(0)
        }

        fn index(&self) -> Result<(), StoreError> {
            Ok(())
        }

        fn drop_index(&self) -> Result<(), StoreError> {
            Ok(())
        }
    }

    #[test]
    fn each_subject_is_the_first_in_turn() {
        let log = RefCell::new(Vec::new());
        let (a, b, c) = (Noting("a", &log), Noting("b", &log), Noting("c", &log));
        let work = Work { operation: Operation::Insert, is_indexed: false };
        let medians = repeat(&[&a, &b, &c], work, 4 * SERIES, &mut Objects::default()).unwrap();
        assert_eq!(medians.iter().map(|(name, _)| *name).collect::<String>(), "abc");
        let log = log.into_inner();
        let order: String = log.chunk_by(|one, other| one == other).map(|same| same[0]).collect();
        // The first round, and then as many turns as there is work for.
        assert!("abcabcbcacababc".starts_with(&order), "{order}");
        assert!(order.len() >= 6, "{order}");
        assert!(["a", "b", "c"].iter().all(|name| log.iter().filter(|one| *one == name).count() > SERIES), "{log:?}");
    }
}
