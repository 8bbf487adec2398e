//! Charts: lines, points, maps, bars and intervals, with axes, ticks, units and a legend.
//!
//! Colours are those of Okabe and Ito (2008), which people who see colours differently can tell apart;
//! series have different markers, too.

use kuva::plot::scatter::{MarkerShape, ScatterPlot};
use kuva::plot::volcano::LabelStyle;
use kuva::plot::{BarPlot, GanttPlot, GanttTask, LegendPosition, LinePlot, QuiverPlot};
use kuva::render::datetime::DateTimeAxis;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use kuva::render::render::render_multiple;

use super::picture::Picture;

/// The colours of series, in their order.
pub const COLORS: [&str; 8] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8B8000"];

/// The markers of series, in their order.
const MARKERS: [MarkerShape; 4] =
    [MarkerShape::Circle, MarkerShape::Square, MarkerShape::Triangle, MarkerShape::Diamond];

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
    /// Draws the chart.
    #[must_use]
    pub fn draw(&self) -> Picture {
        let (plots, layout) = self.parts();
        Picture::new(render_multiple(plots, layout))
    }

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

    /// What the chart is made of, to be drawn alone or among others.
    pub(super) fn parts(&self) -> (Vec<Plot>, Layout) {
        let plots = match self.kind {
            Kind::Line => self.lines(),
            Kind::Scatter => self.points(false),
            Kind::Map => self.map(),
            Kind::Bars => self.bars(),
            Kind::Timeline => self.timeline(),
        };
        let layout = self.layout(&plots);
        (plots, layout)
    }

    fn layout(&self, plots: &[Plot]) -> Layout {
        let (width, height) = self.size;
        let mut layout = Layout::auto_from_plots(plots)
            .with_width(width)
            .with_height(height)
            .with_title(self.title.as_str())
            .with_x_label(self.x.label.as_str())
            .with_y_label(self.y.label.as_str())
            .with_legend_position(LegendPosition::OutsideRightTop);
        if self.x.log {
            layout = layout.with_log_x();
        }
        if self.y.log {
            layout = layout.with_log_y();
        }
        if let Some((least, greatest)) = self.span().filter(|_| self.x.dates) {
            layout = layout.with_x_datetime(DateTimeAxis::auto(least, greatest));
        }
        if self.kind == Kind::Map { self.framed(layout).with_equal_aspect() } else { layout }
    }

    /// A layout with room around all that a map shows.
    fn framed(&self, layout: Layout) -> Layout {
        let points = self.series.iter().flat_map(|series| series.points.iter().map(|point| [point.x, point.y]));
        let corners = self.series.iter().flat_map(|series| series.outlines.iter().flatten().copied());
        let mut places: Vec<[f64; 2]> = points.chain(corners).collect();
        places.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let (Some(left), Some(right)) = (places.first().map(|[x, _]| *x), places.last().map(|[x, _]| *x)) else {
            return layout;
        };
        places.sort_by(|a, b| a[1].total_cmp(&b[1]));
        let (Some(low), Some(high)) = (places.first().map(|[_, y]| *y), places.last().map(|[_, y]| *y)) else {
            return layout;
        };
        let room = (right - left).max(high - low).max(0.1) * 0.08;
        layout
            .with_x_axis_min(left - room)
            .with_x_axis_max(right + room)
            .with_y_axis_min(low - room)
            .with_y_axis_max(high + room)
    }

    /// From the least to the greatest x.
    fn span(&self) -> Option<(f64, f64)> {
        let points = self.series.iter().flat_map(|series| series.points.iter().map(|point| point.x));
        let ends = self.series.iter().flat_map(|series| series.intervals.iter().flat_map(|one| [one.from, one.to]));
        points.chain(ends).fold(None, |span, x| {
            let (least, greatest) = span.unwrap_or((x, x));
            Some((f64::min(least, x), f64::max(greatest, x)))
        })
    }

    /// The legend's word for a series; a single one needs none.
    fn legend<'a>(&self, series: &'a Series) -> Option<&'a str> {
        (self.series.len() > 1 && !series.name.is_empty()).then_some(series.name.as_str())
    }

    fn lines(&self) -> Vec<Plot> {
        let mut plots = Vec::new();
        for (nth, series) in self.series.iter().enumerate() {
            let color = COLORS[nth % COLORS.len()];
            let mut points: Vec<(f64, f64)> = series.points.iter().map(|point| (point.x, point.y)).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            plots.push(Plot::from(LinePlot::new().with_data(points).with_color(color).with_stroke_width(2.0)));
        }
        plots.extend(self.points(false));
        plots
    }

    fn points(&self, with_labels: bool) -> Vec<Plot> {
        let mut plots = Vec::new();
        for (nth, series) in self.series.iter().enumerate().filter(|(_, series)| !series.points.is_empty()) {
            let mut plot = ScatterPlot::new()
                .with_data(series.points.iter().map(|point| (point.x, point.y)).collect::<Vec<_>>())
                .with_color(COLORS[nth % COLORS.len()])
                .with_marker(MARKERS[nth / COLORS.len() % MARKERS.len()])
                .with_size(4.0);
            if let Some(name) = self.legend(series) {
                plot = plot.with_legend(name);
            }
            if with_labels {
                let labels: Vec<&str> = series.points.iter().map(|point| point.label.as_str()).collect();
                plot = plot.with_labels(labels).with_label_style(LabelStyle::Nudge);
            }
            plots.push(Plot::from(plot));
        }
        plots
    }

    fn map(&self) -> Vec<Plot> {
        let reach = self.reach();
        let mut plots = Vec::new();
        for (nth, series) in self.series.iter().enumerate() {
            let color = COLORS[nth % COLORS.len()];
            for outline in &series.outlines {
                let closed = outline.iter().chain(outline.first()).map(|[x, y]| (*x, *y));
                let line = LinePlot::new().with_data(closed.collect::<Vec<_>>()).with_color(color);
                plots.push(Plot::from(line.with_stroke_width(1.5)));
            }
            let headings = series.points.iter().filter_map(|point| Some((point, point.heading?)));
            let arrows = headings.map(|(point, angle)| {
                let (sin, cos) = angle.sin_cos();
                (point.x, point.y, reach * cos, reach * sin)
            });
            let arrows: Vec<(f64, f64, f64, f64)> = arrows.collect();
            if !arrows.is_empty() {
                plots.push(Plot::from(QuiverPlot::new().with_arrows(arrows).with_color(color).with_scale(1.0)));
            }
        }
        plots.extend(self.points(true));
        plots
    }

    /// How long the arrow of a heading is: a small part of the map.
    fn reach(&self) -> f64 {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let span = |of: &dyn Fn(&Point) -> f64| {
            let (least, greatest) =
                points().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), x| {
                    (f64::min(least, x), f64::max(greatest, x))
                });
            if greatest > least { greatest - least } else { 0.0 }
        };
        let span = span(&|point| point.x).max(span(&|point| point.y));
        if span > 0.0 { span * 0.06 } else { 0.1 }
    }

    fn bars(&self) -> Vec<Plot> {
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.series.iter().flat_map(|series| &series.bars) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        let value = |series: &Series, name: &str| {
            series.bars.iter().filter(|(other, _)| other == name).map(|(_, value)| value).sum::<f64>()
        };
        let mut plot = BarPlot::new();
        for name in names {
            let bars = self.series.iter().enumerate();
            let bars = bars.map(|(nth, series)| (value(series, name), COLORS[nth % COLORS.len()]));
            plot = plot.with_group(name, bars.collect::<Vec<_>>());
        }
        if self.series.len() > 1 {
            plot = plot.with_legend(self.series.iter().map(|series| series.name.as_str()).collect());
        }
        vec![Plot::from(plot)]
    }

    fn timeline(&self) -> Vec<Plot> {
        // Rows have their names beside them.
        let mut plot = GanttPlot::new().with_show_labels(false);
        for (nth, series) in self.series.iter().enumerate() {
            let own = COLORS[nth % COLORS.len()];
            for one in &series.intervals {
                plot.tasks.push(GanttTask {
                    label: one.label.clone(),
                    start: one.from,
                    end: one.to,
                    group: Some(series.name.clone()).filter(|name| !name.is_empty()),
                    progress: None,
                    color: Some(one.color.clone().unwrap_or_else(|| own.to_owned())),
                    is_milestone: one.to <= one.from,
                });
            }
        }
        vec![Plot::from(plot)]
    }
}
