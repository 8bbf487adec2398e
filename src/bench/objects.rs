//! The documents: objects of a robot that tidies up, and what finds the nearest of them.

use bson::{Document, doc};

/// The objects of the robot's world so far.
#[derive(Debug, Default)]
pub(super) struct Objects {
    pub(super) count: usize,
    noise: u64,
}

/// How many places there are.
const PLACES: u64 = 1_000;

impl Objects {
    /// The next ones.
    pub(super) fn more(&mut self, count: usize) -> Vec<Document> {
        (0..count).map(|_| self.next()).collect()
    }

    /// One more.
    pub(super) fn next(&mut self) -> Document {
        let name = name(self.count);
        self.count += 1;
        let tidied = self.random(PLACES);
        let position = if self.random(100) == 0 { self.random(PLACES) } else { tidied };
        doc! { "name": name, "position": place(position), "tidied": place(tidied) }
    }

    /// The name of one of them.
    pub(super) fn any(&mut self) -> String {
        let count = self.count.max(1) as u64;
        name(usize::try_from(self.random(count)).unwrap_or_default())
    }

    /// Some place.
    pub(super) fn place(&mut self) -> String {
        place(self.random(PLACES))
    }

    /// A number below `end`, the same ones in every run (a linear congruential generator).
    fn random(&mut self, end: u64) -> u64 {
        self.noise = self.noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.noise >> 33) % end
    }
}

fn name(number: usize) -> String {
    number.to_string()
}

fn place(number: u64) -> String {
    number.to_string()
}

/// The stages that give the object nearest to a place in the middle: its name, position and distance. Places are
/// numbers in a row, written as text.
pub(super) fn nearest() -> Vec<Document> {
    let distance = doc! { "$abs": { "$subtract": [{ "$toInt": "$position" }, (PLACES / 2) as i64] } };
    vec![
        doc! { "$match": { "tidied": { "$exists": true } } },
        doc! { "$project": { "_id": 0, "name": 1, "position": 1, "distance": distance } },
        doc! { "$sort": { "distance": 1, "name": 1 } },
        doc! { "$limit": 1 },
        doc! { "$addFields": { "compute": NEAREST } },
    ]
}

/// What a memory is asked for, for its computable to run.
pub(super) const NEAREST: &str = "nearest";
