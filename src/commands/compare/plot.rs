//! How many tasks each planner solved within which time.

use crate::planning::comparison::{Measurement, scores};
use crate::views::{Axis, Chart, Kind, Point, Series};

/// Times below are drawn as this, in seconds.
const LEAST: f64 = 1e-3;

/// The chart: a line for each planner, time on a logarithmic axis.
pub(super) fn solved(measured: &[Measurement]) -> Chart {
    let all = scores(measured);
    let counts: Vec<String> =
        all.iter().map(|score| format!("{} {} of {}", score.planner, score.solved, score.tasks)).collect();
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
        x: Axis { label: "time (s)".to_owned(), log: true, ..Axis::default() },
        y: Axis { label: "tasks solved".to_owned(), ..Axis::default() },
        kind: Kind::Line,
        series: series.filter(|series| !series.points.is_empty()).collect(),
        size: (800.0, 500.0),
    }
}
