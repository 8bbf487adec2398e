//! Figures as pictures: one without an index and one with, a panel for each operation, durations over the number of
//! documents, both logarithmic.
//!
//! They are those of the thesis' figures 6.2 and 6.3: an operation has the same scale in both.

use super::{Figure, Operation, Work};
use crate::views::pictures::Undrawn;
use crate::views::{Axis, Chart, Kind, Picture, Point, Series, grid};

/// Panels in a row.
const COLUMNS: usize = 3;
/// The size of a panel in pixels.
const PANEL: (f64, f64) = (420.0, 320.0);

/// A picture with the name of its file.
pub struct Drawn {
    /// Its file.
    pub name: &'static str,
    /// What is seen.
    pub picture: Picture,
}

/// The figures as pictures.
///
/// # Errors
/// If rmem was built without pictures.
pub fn plots(figures: &[Figure]) -> Result<Vec<Drawn>, Undrawn> {
    [
        ("figure-6-2.svg", "Operations without an index", false),
        ("figure-6-3.svg", "Operations with an index on the name", true),
    ]
    .into_iter()
    .map(|(name, title, is_indexed)| {
        let panels: Vec<Chart> =
            Work::all().filter(|work| work.is_indexed == is_indexed).map(|work| panel(work, figures)).collect();
        Ok(Drawn { name, picture: grid(title, &panels, COLUMNS, PANEL)? })
    })
    .collect()
}

fn panel(work: Work, figures: &[Figure]) -> Chart {
    let own: Vec<&Figure> = figures.iter().filter(|figure| figure.work == work).collect();
    let names = own.first().map(|figure| figure.medians.as_slice()).unwrap_or_default();
    let series = names.iter().enumerate().map(|(nth, (name, _))| {
        let points = own.iter().filter_map(|figure| {
            let (_, median) = figure.medians.get(nth)?;
            Some(Point { x: figure.documents as f64, y: milliseconds(*median), ..Point::default() })
        });
        Series { name: (*name).to_owned(), points: points.collect(), ..Series::default() }
    });
    let axis = |label: &str| Axis { label: label.to_owned(), log: true, ..Axis::default() };
    Chart {
        title: work.operation.name().to_owned(),
        x: axis("documents"),
        y: Axis { range: scale(work.operation, figures), ..axis("time (ms)") },
        kind: Kind::Line,
        series: series.collect(),
        size: PANEL,
    }
}

fn milliseconds(duration: std::time::Duration) -> f64 {
    (duration.as_secs_f64() * 1e3).max(1e-6)
}

/// The powers of ten around all durations of an operation, with and without an index.
fn scale(operation: Operation, figures: &[Figure]) -> Option<(f64, f64)> {
    let own = figures.iter().filter(|figure| figure.work.operation == operation);
    let logarithms = own.flat_map(|figure| figure.medians.iter().map(|(_, median)| milliseconds(*median).log10()));
    let (least, greatest) = logarithms.fold(None, |span: Option<(f64, f64)>, one| {
        Some(span.map_or((one, one), |(least, greatest)| (least.min(one), greatest.max(one))))
    })?;
    let least = least.floor();
    Some((10_f64.powf(least), 10_f64.powf(greatest.ceil().max(least + 1.0))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn an_operation_has_one_scale_in_both_figures() {
        let figure = |work: Work| {
            let time = if work.is_indexed { Duration::from_micros(20) } else { Duration::from_millis(150) };
            Figure { documents: 1_000, work, medians: vec![("embedded", time)] }
        };
        let figures: Vec<Figure> = Work::all().map(figure).collect();
        assert!(Work::all().all(|work| panel(work, &figures).y.range == Some((0.01, 1000.0))));
    }
}
