//! Planners side by side on many tasks: which tasks each solves, how fast, how well, and with how much memory.
//!
//! [`tasks`] finds the tasks of a folder, [`measure`] runs a planner on one of them as `rmem plan` does, and
//! [`scores`] sums up. A [`Measurement`] has a key, by which a comparison that was interrupted goes on.

mod collection;
mod measurement;
mod program;
mod score;

pub use collection::{TaskFiles, tasks};
pub use measurement::{Measurement, Setup, measure};
pub use program::program_files;
pub use score::{Score, refute, scores, unscored};
