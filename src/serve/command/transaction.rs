//! The ends of transactions; their beginning is a part of other commands.

use super::definition::Command;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::host::Host;

pub(super) const COMMANDS: &[Command] = &[
    Command::read("commitTransaction", outside).transactional(),
    Command::read("abortTransaction", outside).transactional(),
];

/// Where there is no transaction, there is no end of one.
fn outside(_: &mut Host<'_>, call: &Call) -> Answer {
    call.request.fields().known(&["recoveryToken"])?;
    let message = format!("{} must be run within a transaction", call.request.name);
    Err(Failure::new(codes::COMMAND_FAILED, message))
}
