//! A measured duration.

use std::time::Duration;

use bson::{Document, doc};

use super::work::Work;
use crate::saturate::to_i64;

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
        let count = to_i64(self.documents);
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
