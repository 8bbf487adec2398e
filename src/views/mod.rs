//! Views for people: what fields documents have, and charts.
//!
//! [`schema`] describes the fields of documents, [`chart`] says what is drawn: points, bars and intervals, which
//! [`series`] takes out of documents, and [`top`] out of a scene. A [`Picture`] of it is SVG or PNG, by what is
//! asked for.

#[cfg(feature = "views")]
pub mod browser;
pub mod chart;
#[cfg(feature = "pictures")]
mod drawing;
pub mod field;
#[cfg(feature = "views")]
pub mod foxglove;
pub mod pictures;
pub mod schema;
pub mod series;
pub mod top;
#[cfg(not(feature = "pictures"))]
mod undrawn;

pub use chart::{Axis, Chart, Interval, Kind, Point, Series};
pub use pictures::{Picture, grid};
