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
    /// Whether its values are whole numbers, such as counts.
    pub whole: bool,
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
}

/// How high a timeline of these series has to be for its rows to be read: 200 to 10,000 pixels.
#[must_use]
pub fn timeline_height(series: &[Series]) -> f64 {
    let groups = series.iter().filter(|series| !series.name.is_empty()).count();
    let rows = groups + series.iter().map(|series| series.intervals.len()).sum::<usize>();
    (110.0 + 22.0 * rows as f64).clamp(200.0, 10_000.0)
}
