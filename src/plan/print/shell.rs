//! As scripts read plans.

use std::fmt::Write as _;

use super::clips::PrintError;
use super::page::{PrintedPlan, restored};
use crate::formats::command_line::word;

/// `1 done unstack "box #18" A`, a line a step.
pub(super) fn lines(page: &PrintedPlan<'_>) -> Result<String, PrintError> {
    let mut text = String::new();
    for (index, step) in page.plan.steps.iter().enumerate() {
        let _ = write!(text, "{} {} {}", index + 1, page.status(index), word(&step.action));
        for argument in &step.arguments {
            let name = restored(&(page.value)(argument));
            if name.contains(['\n', '\r', '\0']) {
                return Err(PrintError::LineBreak(name));
            }
            let _ = write!(text, " {}", word(&name));
        }
        text.push('\n');
    }
    Ok(text)
}
