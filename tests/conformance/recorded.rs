//! Recorded commands of a real mongod, replayed on the embedded store.
//!
//! `RMEM_CONFORMANCE` names the recording: a zstd stream of BSON documents
//! `{test, cmds: [{db, cmd, reply}]}`. Without it the test is reported as
//! ignored. A table per family is printed; `RMEM_CONFORMANCE_FAMILY` (a part of
//! a family's name) and `RMEM_CONFORMANCE_SHOW` (how many) print differences. `RMEM_CONFORMANCE_HALF` (`odd` or `even`)
//! replays every second case: the first, third and so on, or the others.

use std::fs::File;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};

use bson::{Bson, Document};
use libtest_mimic::{Failed, Trial};

use crate::command::{Answer, Failure};
use crate::compare;
use crate::report::{Outcome, Report};
use crate::served::Served;
use crate::server::Server;

/// The least part of the cases that are not refused which must agree.
const LEAST: f64 = 0.99;

pub(crate) fn trial() -> Trial {
    let recording = std::env::var_os("RMEM_CONFORMANCE").map(PathBuf::from).filter(|path| path.is_file());
    let ignored = recording.is_none();
    let trial = Trial::test("recorded_answers_of_mongod_agree", move || match recording {
        Some(path) => replay(&path),
        None => Ok(()),
    });
    trial.with_ignored_flag(ignored)
}

fn replay(path: &Path) -> Result<(), Failed> {
    let mut reader = zstd::stream::read::Decoder::new(File::open(path)?)?;
    let mut report = Report::from_environment();
    let half = std::env::var("RMEM_CONFORMANCE_HALF").ok();
    let mut served = Served::start()?;
    let mut number = 0_usize;
    while let Ok(case) = Document::from_reader(&mut reader) {
        number += 1;
        let own = if number % 2 == 1 { "odd" } else { "even" };
        if half.as_deref().is_some_and(|half| half != own) {
            continue;
        }
        let name = case.get_str("test").unwrap_or_default().to_owned();
        if !report.wants(&name) {
            continue;
        }
        let outcome = match std::panic::catch_unwind(AssertUnwindSafe(|| answer(&case, &mut served))) {
            Ok(outcome) => outcome,
            Err(_) => Outcome::Differs("PANIC".to_owned()),
        };
        report.add(&name, outcome);
    }
    report.print();
    let agreed = report.agreement();
    if agreed < LEAST {
        return Err(format!("only {:.1} % agree", agreed * 100.0).into());
    }
    Ok(())
}

/// Runs a case on the embedded store; one that has no word for what a command says there, on a server.
fn answer(case: &Document, served: &mut Served) -> Outcome {
    let Ok(mut server) = Server::open() else { return Outcome::Differs("no store".to_owned()) };
    let outcome = compared(case, &mut |command, reply| server.run(command, reply));
    let Outcome::Refused(name) = outcome else { return outcome };
    if let Err(error) = served.clear() {
        return Outcome::Differs(format!("the server is gone: {error}"));
    }
    match compared(case, &mut |command, reply| served.run(command, reply)) {
        Outcome::Refused(_) => Outcome::Refused(name),
        Outcome::Differs(difference) => Outcome::Differs(format!("served, for {name}: {difference}")),
        Outcome::Agrees => Outcome::Agrees,
    }
}

/// Runs the commands of a case until an answer differs.
fn compared(case: &Document, run: &mut dyn FnMut(&Document, &Document) -> Answer) -> Outcome {
    let Ok(commands) = case.get_array("cmds") else { return Outcome::Refused("unreadable".to_owned()) };
    for entry in commands.iter().filter_map(Bson::as_document) {
        let (Ok(command), Ok(reply)) = (entry.get_document("cmd"), entry.get_document("reply")) else { continue };
        let ours = run(command, reply);
        match ours {
            Err(Failure::Refused(name)) => return Outcome::Refused(name),
            ours => {
                if let Err(difference) = compare::replies(command, reply, &ours) {
                    return Outcome::Differs(format!("{difference}\n    {}", shortened(command)));
                }
            }
        }
    }
    Outcome::Agrees
}

fn shortened(command: &Document) -> String {
    let mut command = command.clone();
    command.remove("$db");
    command.to_string().chars().take(1200).collect()
}
