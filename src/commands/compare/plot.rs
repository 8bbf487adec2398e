//! How many tasks each planner solved within which time.

use std::time::Duration;

use crate::planning::comparison::{Measurement, scores};
use crate::views::{Axis, Chart, Kind, Point, Series};

/// Times below are drawn as this, in seconds.
const LEAST: f64 = 1e-3;

/// The chart: a line for each planner, time on a logarithmic axis.
pub(super) fn solved(measured: &[Measurement], timeout: Duration) -> Chart {
    let all = scores(measured);
    let counts: Vec<String> =
        all.iter().map(|score| format!("{} {} of {}", score.planner, score.solved, score.tasks)).collect();
    let most = all.iter().map(|score| score.tasks).max().unwrap_or_default().max(1);
    let limit = timeout.as_secs_f64().max(LEAST * 10.0);
    let first = measured.iter().filter(|run| run.is_solved()).map(|run| run.seconds).fold(limit, f64::min);
    let least = first.max(LEAST).log10().floor().min((limit / 10.0).log10().floor());
    #[expect(clippy::cast_precision_loss, reason = "a number of tasks")]
    let most = most as f64;
    // A tick above the last task, so that its point is whole.
    let step = (most / 8.0).ceil();
    let top = ((most / step).floor() + 1.0) * step;
    let series = all.into_iter().map(|score| {
        let own = measured.iter().filter(|run| run.planner == score.planner && run.is_solved());
        let mut times: Vec<f64> = own.map(|run| run.seconds.max(LEAST)).collect();
        times.sort_by(f64::total_cmp);
        #[expect(clippy::cast_precision_loss, reason = "a number of tasks")]
        let points = times.iter().enumerate().map(|(nth, x)| Point { x: *x, y: (nth + 1) as f64, ..Point::default() });
        Series { name: score.planner, points: points.collect(), ..Series::default() }
    });
    Chart {
        title: format!("Tasks solved: {}", counts.join(", ")),
        x: Axis {
            label: "time (s)".to_owned(),
            log: true,
            range: Some((10_f64.powf(least), limit * 1.3)),
            ..Axis::default()
        },
        y: Axis { label: "tasks solved".to_owned(), whole: true, range: Some((0.0, top)), ..Axis::default() },
        kind: Kind::Line,
        series: series.chain([time_limit(limit, top)]).collect(),
        size: (800.0, 500.0),
    }
}

/// A line up, at the limit of time.
fn time_limit(limit: f64, top: f64) -> Series {
    let points = [0.0, top].map(|y| Point { x: limit, y, ..Point::default() });
    Series { name: "time limit".to_owned(), points: points.into(), ..Series::default() }
}
