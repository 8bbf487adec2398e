//! How errors are printed, and the exit codes of errors and outcomes.
//!
//! Each error type states what is at fault ([`crate::fault`]): a new one needs no line here.

use crate::error::Error;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::formats::Diagnostics;
use crate::output::{self, Output};
use crate::planner::Outcome;

impl From<Fault> for Exit {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Usage => Self::Usage,
            Fault::Input => Self::BadInput,
            Fault::Store => Self::Store,
            Fault::Conflict => Self::Conflict,
            Fault::Program => Self::PlannerNotFound,
            Fault::Interrupt => Self::Interrupted,
            Fault::Unsupported => Self::Unsupported,
        }
    }
}

impl From<&Outcome> for Exit {
    fn from(outcome: &Outcome) -> Self {
        match outcome {
            Outcome::Plan(_) => Self::Done,
            Outcome::Unsolvable => Self::Unsolvable,
            Outcome::GaveUp => Self::GaveUp,
            Outcome::OutOfMemory => Self::OutOfMemory,
            Outcome::OutOfTime => Self::OutOfTime,
            Outcome::Invalid | Outcome::Failed | Outcome::NoPlan | Outcome::NotExecutable => Self::PlannerBroken,
            Outcome::Unsupported => Self::Unsupported,
            Outcome::NotFound => Self::PlannerNotFound,
            Outcome::Interrupted => Self::Interrupted,
        }
    }
}

/// The exit code of an outcome that is stored as a word.
pub(super) fn exit_of_word(word: &str) -> Exit {
    match word {
        "success" => Exit::Done,
        "unsolvable" => Exit::Unsolvable,
        "timeout" => Exit::OutOfTime,
        "memory" => Exit::OutOfMemory,
        "invalid" | "crashed" => Exit::PlannerBroken,
        "unsupported" => Exit::Unsupported,
        "not-found" => Exit::PlannerNotFound,
        "interrupted" => Exit::Interrupted,
        _ => Exit::GaveUp,
    }
}

/// Prints an error, its causes each on a line, and returns its exit code.
pub(crate) fn report(error: &Error, output: &mut Output<'_>) -> Exit {
    if output::is_broken_pipe(error) {
        // The reader of stdout has seen enough: a graceful end.
        return Exit::Done;
    }
    // What was found before the failure is still the product.
    let _ = output.flush();
    match error.downcast_ref() {
        Some(Diagnostics(several)) => several.iter().for_each(|diagnostic| output.error(&diagnostic.to_string())),
        None => output.error(&text(error)),
    }
    error.fault().into()
}

/// The text of an error and its causes, without those that repeat what is there already.
pub(super) fn text(error: &Error) -> String {
    error.chain().skip(1).map(ToString::to_string).fold(error.to_string(), |text, cause| {
        if text.contains(&cause) { text } else { format!("{text}\n  caused by: {cause}") }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{Context as _, Result};
    use crate::fault::AtFault;

    #[derive(Debug, thiserror::Error)]
    #[error("the arm is held by {0}")]
    struct ArmError(&'static str);

    impl AtFault for ArmError {
        fn fault(&self) -> Fault {
            Fault::Conflict
        }
    }

    #[test]
    fn an_error_type_that_is_named_nowhere_else_has_its_exit_code_and_message() {
        let take = || Err(ArmError("robot2"));
        let command = || -> Result<()> { Ok(take()?) };
        let error = command().context("picking up A").unwrap_err();
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        assert_eq!(report(&error, &mut Output::new(&mut stdout, &mut stderr)), Exit::Conflict);
        let printed = String::from_utf8(stderr).unwrap();
        assert_eq!(printed, "error: picking up A\n  caused by: the arm is held by robot2\n");
    }
}
