//! What is around a chart: axes, ticks, title and legend.

use std::sync::Arc;

use kuva::plot::LegendPosition;
use kuva::render::layout::{AxisLabelOverlap, Layout, TickFormat};
use kuva::render::plots::Plot;

use super::calendar;
use super::extent::span;
use super::marks::categories;
use super::words;
use crate::views::chart::{Axis, Chart, Kind};

/// The part of a chart's width, and of its height, that its axes take.
const INSIDE: f64 = 0.75;
/// The sizes of fonts, in pixels, of title and axes.
const TITLE: f64 = 18.0;
const LABEL: f64 = 14.0;
const TICK: f64 = 12.0;
/// The most ticks of an axis of whole numbers, about.
const TICKS: f64 = 8.0;
/// The longest line of a legend, in characters.
const LEGEND: usize = 24;
/// How names of bars are turned where they do not fit beside each other, in degrees.
const TURNED: f64 = -40.0;

/// The layout of a chart.
pub(super) fn layout(chart: &Chart, plots: &[Plot]) -> Layout {
    let (width, height) = chart.size;
    let mut layout = Layout::auto_from_plots(plots)
        .with_width(width)
        .with_height(height)
        .with_title(chart.title.as_str())
        .with_title_wrap(words::fitting(width * 0.9, TITLE))
        .with_x_label_overlap(AxisLabelOverlap::Thin)
        .with_x_label_wrap(words::fitting(width * INSIDE, LABEL))
        .with_y_label_wrap(words::fitting(height * INSIDE, LABEL))
        .with_legend_wrap(LEGEND)
        .with_legend_position(LegendPosition::OutsideRightTop);
    layout = x_axis(chart, layout);
    layout = y_axis(chart, layout);
    match chart.kind {
        Kind::Map => framed(chart, layout).with_equal_aspect(),
        Kind::Bars if is_crowded(chart) => turned(chart, layout.with_x_tick_rotate(TURNED)),
        _ => layout,
    }
}

fn x_axis(chart: &Chart, mut layout: Layout) -> Layout {
    let dates = chart.span_x().filter(|_| chart.x.dates).and_then(|span| calendar::axis(span, chart.size.0 * INSIDE));
    let zone = dates.as_ref().map(|(_, zone)| zone.as_str());
    layout = layout.with_x_label(label(&chart.x, zone));
    if chart.x.log {
        layout = layout.with_log_x().with_x_tick_format(TickFormat::Custom(Arc::new(power)));
    } else if chart.span_x().is_some_and(is_long) {
        layout = layout.with_x_tick_format(TickFormat::Custom(Arc::new(scientific)));
    }
    if let Some((least, greatest)) = chart.x.range {
        layout = layout.with_x_axis_min(least).with_x_axis_max(greatest);
    }
    match dates {
        Some((axis, _)) => layout.with_x_datetime(axis),
        None => layout,
    }
}

fn y_axis(chart: &Chart, mut layout: Layout) -> Layout {
    let dates = chart.span_y().filter(|_| chart.y.dates).and_then(|span| calendar::axis(span, chart.size.1 * INSIDE));
    let zone = dates.as_ref().map(|(_, zone)| zone.as_str());
    layout = layout.with_y_label(label(&chart.y, zone));
    if chart.y.log {
        layout = layout.with_log_y().with_y_tick_format(TickFormat::Custom(Arc::new(power)));
    } else if chart.span_y().is_some_and(is_long) {
        layout = layout.with_y_tick_format(TickFormat::Custom(Arc::new(scientific)));
    }
    if chart.y.whole {
        let (least, greatest) = chart.y.range.or(chart.span_y()).unwrap_or((0.0, 1.0));
        let step = ((greatest - least) / TICKS).ceil().max(1.0);
        layout = layout.with_y_tick_step(step).with_y_tick_format(TickFormat::Fixed(0));
    }
    if let Some((least, greatest)) = chart.y.range {
        layout = layout.with_y_axis_min(least).with_y_axis_max(greatest);
    }
    match dates {
        Some((axis, _)) => layout.with_y_datetime(axis),
        None => layout,
    }
}

/// What an axis shows, with its unit, the zone of its dates, and whether it is logarithmic.
fn label(axis: &Axis, zone: Option<&str>) -> String {
    let mut label = axis.label.clone();
    if let Some(zone) = zone {
        label.push_str(&format!(" ({zone})"));
    }
    if axis.log {
        label.push_str(", log scale");
    }
    label.trim_start().to_owned()
}

/// A tick of a logarithmic axis, in digits where they are few.
fn power(value: f64) -> String {
    if (1e-4..1e7).contains(&value) {
        // What a power of ten is off by is not shown.
        let text = format!("{value:.6}");
        return text.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    format!("{value:.0e}")
}

/// Whether ticks of an axis would have more digits than a double is exact to.
fn is_long((least, greatest): (f64, f64)) -> bool {
    least.abs().max(greatest.abs()) >= 1e15
}

/// A tick with the digits that differ between ticks, and an exponent.
fn scientific(value: f64) -> String {
    let text = format!("{value:.3e}");
    match text.split_once('e') {
        Some((digits, "0")) => digits.trim_end_matches('0').trim_end_matches('.').to_owned(),
        Some((digits, exponent)) => format!("{}e{exponent}", digits.trim_end_matches('0').trim_end_matches('.')),
        None => text,
    }
}

/// Turned names need no more room than a line has; where they are too many even so, some are left out.
fn turned(chart: &Chart, layout: Layout) -> Layout {
    let fits = categories(chart).len() as f64 * TICK * 1.4 < chart.size.0 * INSIDE;
    if fits { layout.with_x_label_overlap(AxisLabelOverlap::Allow) } else { layout }
}

/// Whether the names of bars do not fit beside each other.
fn is_crowded(chart: &Chart) -> bool {
    let names = categories(chart);
    let widest = names.iter().map(|name| words::width(name, TICK)).fold(0.0, f64::max);
    (widest + TICK) * names.len() as f64 > chart.size.0 * INSIDE
}

/// A layout with a margin around all that a map shows.
fn framed(chart: &Chart, layout: Layout) -> Layout {
    let arrow = chart.arrow();
    let points = chart.points().flat_map(|point| [Some([point.x, point.y]), point.tip(arrow)]).flatten();
    let corners = chart.series.iter().flat_map(|series| series.outlines.iter().flatten().copied());
    let places: Vec<[f64; 2]> = points.chain(corners).collect();
    let (Some((left, right)), Some((low, high))) =
        (span(places.iter().map(|[x, _]| *x)), span(places.iter().map(|[_, y]| *y)))
    else {
        return layout;
    };
    let longest = (right - left).max(high - low);
    let margin = if longest > 0.0 { longest * 0.1 } else { 0.5 };
    layout
        .with_x_axis_min(left - margin)
        .with_x_axis_max(right + margin)
        .with_y_axis_min(low - margin)
        .with_y_axis_max(high + margin)
}
