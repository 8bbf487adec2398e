//! Charts as pictures, drawn by a charting crate: `marks` between the axes, `frame` around them, `extent` where values
//! lie, `calendar` the ticks of dates, `labels` the names on a map.

mod calendar;
mod draw;
mod extent;
mod frame;
mod grid;
mod labels;
mod marks;
mod picture;
mod words;

pub use grid::grid;
pub use picture::Picture;
