//! Figures as a picture: a panel for each kind of work, durations over the number of documents, both logarithmic.
//!
//! The upper panels are those of the thesis' figure 6.2, without an index, the lower ones those of its figure 6.3.

use super::{Figure, Work};
use crate::views::{Axis, Chart, Kind, Picture, Point, Series, grid};

/// Panels in a row.
const COLUMNS: usize = 3;
/// The size of a panel in pixels.
const PANEL: (f64, f64) = (420.0, 320.0);

/// The figures as a picture.
#[must_use]
pub fn plot(figures: &[Figure]) -> Picture {
    grid("Duration of operations of the memory", &Work::ALL.map(|work| panel(work, figures)), COLUMNS, PANEL)
}

fn panel(work: Work, figures: &[Figure]) -> Chart {
    let own: Vec<&Figure> = figures.iter().filter(|figure| figure.work == work).collect();
    let names = own.first().map(|figure| figure.medians.as_slice()).unwrap_or_default();
    let series = names.iter().enumerate().map(|(nth, (name, _))| {
        let points = own.iter().filter_map(|figure| {
            let (_, median) = figure.medians.get(nth)?;
            #[expect(clippy::cast_precision_loss, reason = "a count for a picture")]
            let documents = figure.documents as f64;
            Some(Point { x: documents, y: (median.as_secs_f64() * 1e6).max(1e-3), ..Point::default() })
        });
        Series { name: (*name).to_owned(), points: points.collect(), ..Series::default() }
    });
    let axis = |label: &str| Axis { label: label.to_owned(), log: true, dates: false };
    Chart {
        title: work.name().to_owned(),
        x: axis("documents"),
        y: axis("time (µs)"),
        kind: Kind::Line,
        series: series.collect(),
        size: PANEL,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn each_kind_of_work_has_a_panel_and_each_subject_a_place_in_the_legend() {
        let medians =
            |factor| vec![("embedded", Duration::from_micros(factor)), ("mongod", Duration::from_micros(900))];
        let figures: Vec<Figure> = [1_000, 10_000]
            .into_iter()
            .flat_map(|documents| {
                Work::ALL.map(|work| Figure { documents, work, medians: medians(documents as u64 / 100) })
            })
            .collect();
        let svg = plot(&figures).svg();
        assert!(Work::ALL.iter().all(|work| svg.contains(work.name())), "{svg}");
        assert_eq!(svg.matches(">embedded<").count(), 1, "one legend for all");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
