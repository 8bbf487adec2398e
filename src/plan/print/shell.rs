//! As scripts read plans.

use std::fmt::Write as _;

use super::page::{PrintedPlan, restored};
use crate::formats::command_line::word;

/// `1 done unstack "box #18" A`, a line a step.
pub(super) fn lines(page: &PrintedPlan<'_>) -> String {
    let mut text = String::new();
    for (index, step) in page.plan.steps.iter().enumerate() {
        let _ = write!(text, "{} {} {}", index + 1, page.status(index), word(&step.action));
        for argument in &step.arguments {
            let _ = write!(text, " {}", word(&restored(&(page.value)(argument))));
        }
        text.push('\n');
    }
    text
}
