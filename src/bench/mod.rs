//! The benchmark of the memory: the same work on several stores, side by side.
//!
//! The documents are those of a robot that tidies up: an object's unique name,
//! where it is, and where it belongs; about one in a hundred is elsewhere, as in
//! the evaluation of the robot memory that rmem follows. For
//! each size, every kind of work is repeated, taking turns between the
//! subjects, so that whatever else the machine does happens to all of them. A
//! turn is a short series, as a program works with one memory and not with
//! three; the result is the median.

mod figure;
mod objects;
mod plot;
mod run;
mod subject;
mod work;

pub use figure::Figure;
pub use plot::{Drawn, plots};
pub use run::{Extent, run};
pub use subject::{OfMemory, Subject, computable};
pub use work::{Operation, Work};

#[cfg(feature = "mongodb")]
pub use crate::store::mongodb::Raw;
