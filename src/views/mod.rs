//! Views for people: what fields documents have, and charts.
//!
//! [`schema`] describes the fields of documents, [`chart`] draws points, bars and intervals with a charting
//! crate, [`series`] takes them out of documents, and [`top`] draws a scene from above. A [`Picture`] is
//! SVG or PNG, by what is asked for.

pub mod browser;
pub mod chart;
pub mod field;
pub mod foxglove;
pub mod grid;
pub mod picture;
pub mod schema;
pub mod series;
pub mod top;

pub use chart::{Axis, Chart, Interval, Kind, Point, Series};
pub use grid::grid;
pub use picture::Picture;
