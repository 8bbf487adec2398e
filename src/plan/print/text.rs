//! As the planning competitions write plans.

use std::fmt::Write as _;

use super::page::{PrintedPlan, line};
use crate::plan::Status;
use crate::plan::report::rounded;
use crate::problem::names;

/// `(unstack b a)`, or `0.001: (move r1 a b) [5.000]`; what is known of a step is a comment.
pub(super) fn text(page: &PrintedPlan<'_>) -> String {
    let mut text = String::new();
    for (index, step) in page.plan.steps.iter().enumerate() {
        text.push_str(&names::readable(&line(step)));
        if page.status(index) != Status::Open {
            let _ = write!(text, " ; {}", page.status(index));
        }
        text.push('\n');
    }
    let length = page.plan.steps.len() as f64;
    let makespan = page.makespan().map(rounded);
    let _ = match page.plan.cost.map(rounded) {
        // Without a metric, the cost is the number of steps, which says nothing about a plan with times.
        Some(cost) if Some(cost) != makespan && (cost != length || (page.has_metric && makespan.is_none())) => {
            writeln!(text, "; cost = {cost} (general cost)")
        }
        _ if makespan.is_some() => Ok(()),
        // A metric that cannot be computed.
        None if page.has_metric => Ok(()),
        _ => writeln!(text, "; cost = {length} (unit cost)"),
    };
    if let Some(makespan) = makespan {
        let _ = writeln!(text, "; makespan = {makespan}");
    }
    text
}
