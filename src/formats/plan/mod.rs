//! What planners print and write, and plan files.
//!
//! Three dialects, one file and one grammar each: [`ff`] (FF 2.3, Metric-FF 2.1
//! and the present-day `ff`), [`downward`] (Fast Downward and the plan files of
//! the planning competitions) and [`temporal`] (LPG, POPF, OPTIC). Each reads a
//! planner's output into a [`Transcript`]. A plan file, whichever of the three
//! spellings it is in, is read by [`read_plan`].
//!
//! All of it works line by line, so that neither time nor memory depends on
//! anything but the length of the text.

pub mod auto;
pub mod downward;
pub mod ff;
pub mod temporal;

mod behind;
mod file;
mod lines;
mod printed;
mod read;
mod transcript;

pub use file::{PlanFile, Spelling};
pub use read::read_plan;
pub use transcript::{Action, Complaint, Transcript, Verdict};
