//! The benchmark of the memory: the same work on several subjects, side by side.
//!
//! The documents are those of a robot that tidies up: an object's unique name,
//! where it is, and where it belongs; about one in a hundred is elsewhere. For
//! each size, every kind of work is repeated, taking turns between the
//! subjects, so that whatever else the machine does happens to all of them. A
//! turn is a short series, as a program works with one memory and not with
//! three; what is told is the median.

mod plot;
mod subject;
mod work;

pub use plot::plot;
pub use subject::{OfMemory, Subject};
pub use work::Work;

#[cfg(feature = "mongodb")]
pub use crate::store::mongodb::Raw;

use std::time::{Duration, Instant};

use bson::{Document, doc};

use crate::store::StoreError;

/// How many documents are stored at once where that is not measured.
const BATCH: usize = 10_000;
/// A kind of work is not repeated any more after so long, but at least [`LEAST`] times.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(4);
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

/// How long one kind of work takes.
#[derive(Debug, Clone)]
pub struct Figure {
    /// With how many documents.
    pub documents: usize,
    /// Which.
    pub work: Work,
    /// The median by subject.
    pub medians: Vec<(&'static str, Duration)>,
}

impl Figure {
    /// The figure as a document: durations in microseconds; against the second
    /// subject, how many times faster the first is and, of a third, by how many
    /// percent it is slower.
    #[must_use]
    pub fn document(&self) -> Document {
        let microseconds = |duration: Duration| (duration.as_secs_f64() * 1e7).round() / 10.0;
        let count = i64::try_from(self.documents).unwrap_or(i64::MAX);
        let mut document = doc! { "documents": count, "work": self.work.name() };
        for (subject, median) in &self.medians {
            document.insert(format!("{subject}_us"), microseconds(*median));
        }
        if let [(_, ours), (_, theirs), more @ ..] = self.medians.as_slice() {
            let times = theirs.as_secs_f64() / ours.as_secs_f64().max(1e-9);
            document.insert("times_faster", (times * 10.0).round() / 10.0);
            if let [(_, over), ..] = more {
                let added = over.as_secs_f64() / theirs.as_secs_f64().max(1e-9) - 1.0;
                document.insert("added_percent", (added * 1000.0).round() / 10.0);
            }
        }
        document
    }
}

/// Measures all work at all sizes on empty subjects; tells each figure as it is known.
///
/// # Errors
/// The first failure of a subject, or of `tell`.
pub fn run<E: From<StoreError>>(
    subjects: &[&dyn Subject],
    extent: &Extent,
    mut tell: impl FnMut(&Figure) -> Result<(), E>,
) -> Result<Vec<Figure>, E> {
    let (mut figures, mut objects) = (Vec::new(), Objects::default());
    for size in &extent.documents {
        while objects.count < *size {
            let batch = objects.more(BATCH.min(size - objects.count));
            subjects.iter().try_for_each(|subject| subject.insert(batch.clone()))?;
        }
        for work in Work::ALL {
            if work.begins_indexed() {
                subjects.iter().try_for_each(|subject| subject.index())?;
            }
            let medians = repeat(subjects, work, extent.rounds, &mut objects)?;
            let figure = Figure { documents: *size, work, medians };
            tell(&figure)?;
            figures.push(figure);
        }
        subjects.iter().try_for_each(|subject| subject.drop_index())?;
    }
    Ok(figures)
}

/// Repeats a kind of work, subject by subject in turn.
fn repeat(
    subjects: &[&dyn Subject],
    work: Work,
    rounds: usize,
    objects: &mut Objects,
) -> Result<Vec<(&'static str, Duration)>, StoreError> {
    let mut times: Vec<Vec<Duration>> = vec![Vec::new(); subjects.len()];
    // The first round is for caches, of all subjects; it tells how long a turn may be as well.
    let (task, start) = (work.task(objects), Instant::now());
    for subject in subjects {
        subject.time(&task)?;
    }
    let one = start.elapsed().max(Duration::from_micros(1));
    let turn = usize::try_from(CONNECT_TIMEOUT.as_micros() / one.as_micros()).unwrap_or(SERIES).clamp(1, SERIES);
    let (mut done, start) = (0, Instant::now());
    while done < rounds && (done < LEAST || start.elapsed() < CONNECT_TIMEOUT) {
        let series: Vec<_> = (0..turn.min(rounds - done)).map(|_| work.task(objects)).collect();
        for (subject, times) in subjects.iter().zip(&mut times) {
            for task in &series {
                times.push(subject.time(task)?);
            }
        }
        done += series.len();
    }
    Ok(subjects.iter().zip(times).map(|(subject, times)| (subject.name(), median(times))).collect())
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// The objects of the robot's world so far.
#[derive(Debug, Default)]
pub(crate) struct Objects {
    count: usize,
    noise: u64,
}

/// How many places there are.
const PLACES: u64 = 1_000;

impl Objects {
    /// The next ones.
    fn more(&mut self, count: usize) -> Vec<Document> {
        (0..count).map(|_| self.next()).collect()
    }

    /// One more.
    pub(crate) fn next(&mut self) -> Document {
        let name = name(self.count);
        self.count += 1;
        let tidied = self.random(PLACES);
        let position = if self.random(100) == 0 { self.random(PLACES) } else { tidied };
        doc! { "name": name, "position": place(position), "tidied": place(tidied) }
    }

    /// The name of one of them.
    pub(crate) fn any(&mut self) -> String {
        let count = self.count.max(1) as u64;
        name(usize::try_from(self.random(count)).unwrap_or_default())
    }

    /// Some place.
    pub(crate) fn place(&mut self) -> String {
        place(self.random(PLACES))
    }

    /// A number below `end`, the same ones in every run (a linear congruential generator).
    fn random(&mut self, end: u64) -> u64 {
        self.noise = self.noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.noise >> 33) % end
    }
}

fn name(number: usize) -> String {
    format!("object-{number}")
}

fn place(number: u64) -> String {
    format!("place-{number}")
}
