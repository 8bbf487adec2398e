//! Charts: lines, points, maps, bars and intervals, with axes, units and a legend. [`Chart::draw`] draws them.

/// The colours of series, in their order.
pub const COLORS: [&str; 8] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8B8000"];

/// How a chart draws its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Points joined in order of x.
    Line,
    /// Points.
    Scatter,
    /// Positions to scale, with names and headings.
    Map,
    /// A bar for each x, which is text.
    Bars,
    /// Intervals over time.
    Timeline,
}

/// An axis.
#[derive(Debug, Clone, Default)]
pub struct Axis {
    /// What it shows, and in which unit.
    pub label: String,
    /// Whether it is logarithmic.
    pub log: bool,
    /// Whether its values are dates, as seconds since 1970.
    pub dates: bool,
    /// The least and the greatest value that it shows (default: those of what is drawn).
    pub range: Option<(f64, f64)>,
}

/// A point.
#[derive(Debug, Clone, Default)]
pub struct Point {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// What it is called.
    pub label: String,
    /// Where it looks, in radians from x to y.
    pub heading: Option<f64>,
}

/// An interval.
#[derive(Debug, Clone)]
pub struct Interval {
    /// What it is called.
    pub label: String,
    /// When it begins.
    pub from: f64,
    /// When it ends.
    pub to: f64,
    /// Another colour than that of its series.
    pub color: Option<String>,
}

/// Points that belong together.
#[derive(Debug, Clone, Default)]
pub struct Series {
    /// What the legend calls them.
    pub name: String,
    /// Points, of all kinds but bars and timelines.
    pub points: Vec<Point>,
    /// Bars: x as text.
    pub bars: Vec<(String, f64)>,
    /// Intervals of a timeline.
    pub intervals: Vec<Interval>,
    /// Closed outlines of a map, drawn beside the points.
    pub outlines: Vec<Vec<[f64; 2]>>,
}

impl Series {
    /// Whether there is nothing in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty() && self.bars.is_empty() && self.intervals.is_empty() && self.outlines.is_empty()
    }
}

/// A chart.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// To the right.
    pub x: Axis,
    /// Up.
    pub y: Axis,
    /// How points are drawn.
    pub kind: Kind,
    /// What is drawn.
    pub series: Vec<Series>,
    /// Width and height in pixels.
    pub size: (f64, f64),
}

impl Chart {
    /// The chart without what a logarithmic axis cannot show: zero and less.
    #[must_use]
    pub fn positive(mut self) -> Self {
        let (x, y) = (self.x.log, self.y.log);
        for series in &mut self.series {
            series.points.retain(|point| (!x || point.x > 0.0) && (!y || point.y > 0.0));
            series.bars.retain(|(_, value)| !y || *value > 0.0);
            series.intervals.retain(|one| !x || one.from > 0.0);
        }
        self.series.retain(|series| !series.is_empty());
        // An axis without values has no logarithms.
        let is_drawn = !self.series.is_empty();
        (self.x.log, self.y.log) = (x && is_drawn, y && is_drawn);
        self
    }

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

/// How high a timeline of these series has to be for its rows to be read: 200 to 10,000 pixels.
#[must_use]
pub fn timeline_height(series: &[Series]) -> f64 {
    let groups = series.iter().filter(|series| !series.name.is_empty()).count();
    let rows = groups + series.iter().map(|series| series.intervals.len()).sum::<usize>();
    (110.0 + 22.0 * rows as f64).clamp(200.0, 10_000.0)
}

/// The least and the greatest of some numbers.
pub(super) fn span(numbers: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    numbers.fold(None, |span, number| {
        let (least, greatest) = span.unwrap_or((number, number));
        Some((f64::min(least, number), f64::max(greatest, number)))
    })
}
