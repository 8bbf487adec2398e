//! Views for people: what fields documents have, and charts.
//!
//! [`schema`] describes the fields of documents, [`chart`] says what is drawn: points, bars and intervals, which
//! [`series`] takes out of documents, and [`top`] out of a scene. A charting crate draws it: `marks` between the axes,
//! `frame` around them, `calendar` the ticks of dates, `labels` the names on a map. A [`Picture`] is SVG or PNG, by
//! what is asked for.

#[cfg(feature = "views")]
pub mod browser;
mod calendar;
pub mod chart;
mod draw;
pub mod field;
#[cfg(feature = "views")]
pub mod foxglove;
mod frame;
pub mod grid;
mod labels;
mod marks;
pub mod picture;
pub mod schema;
pub mod series;
pub mod top;
mod words;

pub use chart::{Axis, Chart, Interval, Kind, Point, Series};
pub use grid::grid;
pub use picture::Picture;
