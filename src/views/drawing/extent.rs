//! Where the values of a chart lie.

use crate::views::chart::{Chart, Point};

impl Chart {
    /// From the least to the greatest x of points and intervals.
    pub(super) fn span_x(&self) -> Option<(f64, f64)> {
        let ends = self.series.iter().flat_map(|series| series.intervals.iter().flat_map(|one| [one.from, one.to]));
        span(self.points().map(|point| point.x).chain(ends))
    }

    /// From the least to the greatest y of points and bars.
    pub(super) fn span_y(&self) -> Option<(f64, f64)> {
        let bars = self.series.iter().flat_map(|series| series.bars.iter().map(|(_, y)| *y));
        span(self.points().map(|point| point.y).chain(bars))
    }

    /// The points of all series.
    pub(super) fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }

    /// How long the arrow of a heading is in metres: a small part of the map.
    pub(super) fn arrow(&self) -> f64 {
        let length = |span: Option<(f64, f64)>| span.map_or(0.0, |(least, greatest)| greatest - least);
        let longest = length(self.span_x()).max(length(self.span_y()));
        if longest > 0.0 { longest * 0.06 } else { 0.1 }
    }
}

impl Point {
    /// The tip of the arrow of its heading.
    pub(super) fn tip(&self, arrow: f64) -> Option<[f64; 2]> {
        let (sin, cos) = self.heading?.sin_cos();
        Some([self.x + arrow * cos, self.y + arrow * sin])
    }
}

/// The least and the greatest of some numbers.
pub(super) fn span(numbers: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    numbers.fold(None, |span, number| {
        let (least, greatest) = span.unwrap_or((number, number));
        Some((f64::min(least, number), f64::max(greatest, number)))
    })
}
