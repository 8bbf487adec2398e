//! Which histories this process keeps on a server, and how it signs (`history`).

use std::collections::HashSet;

use crate::store::history::next_run;
use crate::store::{HistoryRule, Namespace};

/// The histories that this process keeps, and how it signs.
#[derive(Default)]
pub(super) struct Keeping {
    pub(super) rules: Vec<HistoryRule>,
    pub(super) author: String,
    pub(super) run: i64,
    /// The collections whose recording has begun.
    pub(super) begun: HashSet<Namespace>,
    /// Whether a write is being recorded, of which another is a part.
    pub(super) is_recording: bool,
}

impl Keeping {
    pub(super) fn sign(&mut self, author: &str) {
        author.clone_into(&mut self.author);
        self.run = next_run();
    }
}
