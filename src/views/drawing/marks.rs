//! What a chart draws between its axes: lines, points, arrows, bars and intervals.

use kuva::plot::scatter::{MarkerShape, ScatterPlot};
use kuva::plot::{BarPlot, GanttPlot, GanttTask, LinePlot, QuiverPlot};
use kuva::render::plots::Plot;

use super::words::clipped;
use crate::views::chart::{COLORS, Chart, Interval, Kind, Series};

/// The markers of series, in their order.
const MARKERS: [MarkerShape; 4] =
    [MarkerShape::Circle, MarkerShape::Square, MarkerShape::Triangle, MarkerShape::Diamond];
/// The most characters of a series' name in the legend.
const NAME: usize = 60;
/// The most characters of the name of a bar, or of a row.
const CATEGORY: usize = 32;

/// The marks of a chart, those in front last.
pub(super) fn marks(chart: &Chart) -> Vec<Plot> {
    match chart.kind {
        Kind::Line => lines(chart),
        Kind::Scatter => points(chart),
        Kind::Map => map(chart),
        Kind::Bars => bars(chart),
        Kind::Timeline => timeline(chart),
    }
}

fn color(nth: usize) -> &'static str {
    COLORS[nth % COLORS.len()]
}

/// The legend's word for a series; a single one needs none.
fn legend(chart: &Chart, series: &Series) -> Option<String> {
    (chart.series.len() > 1 && !series.name.is_empty()).then(|| clipped(&series.name, NAME))
}

fn lines(chart: &Chart) -> Vec<Plot> {
    let mut plots = Vec::new();
    for (nth, series) in chart.series.iter().enumerate() {
        let mut points: Vec<(f64, f64)> = series.points.iter().map(|point| (point.x, point.y)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        plots.push(Plot::from(LinePlot::new().with_data(points).with_color(color(nth)).with_stroke_width(2.0)));
    }
    plots.extend(points(chart));
    plots
}

fn points(chart: &Chart) -> Vec<Plot> {
    let mut plots = Vec::new();
    for (nth, series) in chart.series.iter().enumerate() {
        // A line without points is in the legend.
        if series.points.is_empty() && (chart.kind != Kind::Line || series.name.is_empty()) {
            continue;
        }
        let mut plot = ScatterPlot::new()
            .with_data(series.points.iter().map(|point| (point.x, point.y)).collect::<Vec<_>>())
            .with_color(color(nth))
            .with_marker(MARKERS[(nth + nth / COLORS.len()) % MARKERS.len()])
            .with_size(4.0);
        if let Some(name) = legend(chart, series) {
            plot = plot.with_legend(name);
        }
        plots.push(Plot::from(plot));
    }
    plots
}

fn map(chart: &Chart) -> Vec<Plot> {
    let arrow = chart.arrow();
    let mut plots = Vec::new();
    for (nth, series) in chart.series.iter().enumerate() {
        for outline in &series.outlines {
            let closed = outline.iter().chain(outline.first()).map(|[x, y]| (*x, *y));
            let line = LinePlot::new().with_data(closed.collect::<Vec<_>>()).with_color(color(nth));
            plots.push(Plot::from(line.with_stroke_width(1.5)));
        }
        let headings = series.points.iter().filter_map(|point| Some((point, point.tip(arrow)?)));
        let arrows: Vec<(f64, f64, f64, f64)> =
            headings.map(|(point, [x, y])| (point.x, point.y, x - point.x, y - point.y)).collect();
        if !arrows.is_empty() {
            plots.push(Plot::from(QuiverPlot::new().with_arrows(arrows).with_color(color(nth)).with_scale(1.0)));
        }
    }
    plots.extend(points(chart));
    plots
}

/// The names of bars, in the order in which they were found.
pub(super) fn categories(chart: &Chart) -> Vec<&str> {
    let (mut names, mut known) = (Vec::new(), std::collections::HashSet::new());
    for (name, _) in chart.series.iter().flat_map(|series| &series.bars) {
        if known.insert(name.as_str()) {
            names.push(name.as_str());
        }
    }
    names
}

/// Bars side by side for each name; of several values of one, the sum.
fn bars(chart: &Chart) -> Vec<Plot> {
    let sums = chart.series.iter().map(|series| {
        let mut sums = std::collections::HashMap::new();
        series.bars.iter().for_each(|(name, value)| *sums.entry(name.as_str()).or_insert(0.0) += value);
        sums
    });
    let sums: Vec<std::collections::HashMap<&str, f64>> = sums.collect();
    let mut plot = BarPlot::new();
    for name in categories(chart) {
        let bars = sums.iter().enumerate().map(|(nth, sums)| (sums.get(name).copied().unwrap_or(0.0), color(nth)));
        plot = plot.with_group(clipped(name, CATEGORY), bars.collect::<Vec<_>>());
    }
    if chart.series.len() > 1 {
        let names: Vec<String> = chart.series.iter().map(|series| clipped(&series.name, NAME)).collect();
        plot = plot.with_legend(names.iter().map(String::as_str).collect());
    }
    vec![Plot::from(plot)]
}

fn timeline(chart: &Chart) -> Vec<Plot> {
    // Rows have their names beside them.
    let mut plot = GanttPlot::new().with_show_labels(false);
    for (nth, series) in chart.series.iter().enumerate() {
        plot.tasks.extend(series.intervals.iter().map(|one| task(one, series, color(nth))));
    }
    vec![Plot::from(plot)]
}

fn task(one: &Interval, series: &Series, color: &str) -> GanttTask {
    GanttTask {
        label: clipped(&one.label, CATEGORY),
        start: one.from,
        end: one.to,
        group: Some(clipped(&series.name, CATEGORY)).filter(|name| !name.is_empty()),
        progress: None,
        color: Some(one.color.clone().unwrap_or_else(|| color.to_owned())),
        is_milestone: one.to <= one.from,
    }
}
