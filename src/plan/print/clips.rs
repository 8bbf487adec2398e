//! As facts `plan` and `plan-action` of CLIPS.

use std::fmt::Write as _;

use super::page::{PrintedPlan, slot, symbol};
use crate::fault::{AtFault, Fault};

/// What a format has no way to write.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PrintError {
    /// CLIPS ends every text at a NUL.
    #[error("{0:?} has a NUL in it, at which CLIPS would end it")]
    Nul(String),
}

impl AtFault for PrintError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

pub(super) fn facts(page: &PrintedPlan<'_>) -> Result<String, PrintError> {
    let id = spelled(symbol(page.id))?;
    let mut text = format!("(plan (id {id})");
    if let Some(cost) = page.plan.cost {
        let _ = write!(text, " (cost {cost:?})");
    }
    text.push_str(")\n");
    for (index, step) in page.plan.steps.iter().enumerate() {
        let arguments = step.arguments.iter().map(|name| Ok(format!(" {}", spelled(slot(&(page.value)(name)))?)));
        let arguments = arguments.collect::<Result<String, PrintError>>()?;
        let number = index + 1;
        let name = spelled(symbol(&step.action))?;
        let _ = write!(text, "(plan-action (id {number}) (plan-id {id}) (name {name}) (arguments{arguments})");
        if let Some(start) = step.start {
            let _ = write!(text, " (start {start:?})");
        }
        if let Some(duration) = step.duration {
            let _ = write!(text, " (duration {duration:?})");
        }
        let _ = writeln!(text, " (status {}))", page.status(index).symbol());
    }
    Ok(text)
}

/// A word of a fact that CLIPS reads as a whole.
fn spelled(word: String) -> Result<String, PrintError> {
    if word.contains('\0') { Err(PrintError::Nul(word)) } else { Ok(word) }
}
