//! Whether the embedded store answers as mongod does: recorded answers of a
//! real mongod replayed, and a mongod that is there asked the same.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a test program prints its report")]

mod command;
mod compare;
#[cfg(feature = "mongodb")]
mod differential;
mod modify;
#[cfg(feature = "mongodb")]
#[allow(dead_code, reason = "the other tests of real programs do more with it")]
#[path = "../integration/mongod.rs"]
mod mongod;
mod recorded;
mod report;
mod served;
mod server;

use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mut trials = vec![recorded::trial()];
    let stop = with_server(&arguments, &mut trials);
    let conclusion = libtest_mimic::run(&arguments, trials);
    stop();
    conclusion.exit_code()
}

#[cfg(feature = "mongodb")]
fn with_server(arguments: &Arguments, trials: &mut Vec<Trial>) -> fn() {
    trials.extend(differential::trials(mongod::program_for(arguments, &differential::names())));
    differential::stop
}

#[cfg(not(feature = "mongodb"))]
fn with_server(_: &Arguments, _: &mut Vec<Trial>) -> fn() {
    || ()
}
