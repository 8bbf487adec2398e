//! The same operations on a real mongod and on the embedded store, made up by
//! family of operators. Answers are compared with their types and order, and
//! what is there afterwards too.
//!
//! `RMEM_DIFFERENTIAL_SEED`, `RMEM_DIFFERENTIAL_CASES` and
//! `RMEM_DIFFERENTIAL_FAMILY` (a part of a family's name) choose other cases,
//! more of them, or those of some families. `RMEM_DIFFERENTIAL_KNOWN` is how many
//! known differences of a family are printed.

mod family;
mod generate;
mod known;
mod pair;
mod shrink;
mod table;
mod wire;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use libtest_mimic::{Failed, Trial};
use proptest::strategy::{Strategy as _, ValueTree as _};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

use crate::mongod::Mongod;
use family::{FAMILIES, Family};
use pair::{Case, Pair, Verdict};
use table::Counts;

/// The one server of this run, started by the first family that is asked.
static SERVER: Mutex<Option<Mongod>> = Mutex::new(None);

/// How many cases of each family a normal run has.
const CASES: usize = 2000;
/// The seed of a normal run: the same cases every time.
const SEED: u64 = 1;
/// So many operations are asked of the same documents.
const BATCH: usize = 40;
/// So many differences of a family are shrunk and shown.
const SHOWN: usize = 8;

const DOCUMENTED: &str = "known_differences_are_documented";

/// The names of the tests that need a mongod.
pub(crate) fn names() -> Vec<String> {
    FAMILIES.iter().map(|(name, _)| format!("differential::{name}")).collect()
}

/// A test for each family; ignored where there is no mongod.
pub(crate) fn trials(program: Option<PathBuf>) -> Vec<Trial> {
    let wanted = std::env::var("RMEM_DIFFERENTIAL_FAMILY").unwrap_or_default();
    let chosen = FAMILIES.iter().filter(|(name, _)| name.contains(&wanted));
    let trial = |(name, family): &(&'static str, fn() -> Family)| {
        let (name, family, program) = (*name, *family, program.clone());
        let ignored = program.is_none();
        let run = move || match &program {
            Some(program) => compare(name, &family(), program),
            None => Err("there is no mongod".into()),
        };
        Trial::test(format!("differential::{name}"), run).with_ignored_flag(ignored)
    };
    let mut trials: Vec<_> = chosen.map(trial).collect();
    trials.push(Trial::test(DOCUMENTED, known::are_documented));
    trials
}

/// Stops the server, where one was started, and prints what was compared.
pub(crate) fn stop() {
    drop(SERVER.lock().unwrap_or_else(PoisonError::into_inner).take());
    table::print();
}

fn port(program: &Path) -> Result<u16, Failed> {
    let mut server = SERVER.lock().unwrap_or_else(PoisonError::into_inner);
    let running = match server.take() {
        Some(running) => running,
        // Nothing has to outlive a crash: writes without a journal are quicker.
        None => Mongod::alone(program, &["--nojournal"])?,
    };
    Ok(server.insert(running).port)
}

fn setting(name: &str, default: u64) -> Result<u64, Failed> {
    match std::env::var(name) {
        Ok(text) => text.parse().map_err(|_| format!("{name} must be a number, not {text:?}").into()),
        Err(_) => Ok(default),
    }
}

/// Compares the answers of one family.
fn compare(name: &str, family: &Family, program: &Path) -> Result<(), Failed> {
    let seed = setting("RMEM_DIFFERENTIAL_SEED", SEED)?;
    let cases = setting("RMEM_DIFFERENTIAL_CASES", CASES as u64)? as usize / family.cost;
    let mut pair = Pair::connect(port(program)?, name, family.index.clone())?;
    let mut runner = runner(seed, name);
    let mut known = setting("RMEM_DIFFERENTIAL_KNOWN", 0)?;
    let (mut counts, mut shown) = (Counts::default(), Vec::new());
    while counts.cases < cases {
        let documents = numbered(family, &mut runner)?;
        let others = numbered(family, &mut runner)?;
        pair.reset(&documents, &others)?;
        for _ in 0..BATCH.min(cases - counts.cases) {
            let command = family.commands.new_tree(&mut runner)?.current();
            let case = Case { documents: pair.documents().to_vec(), others: others.clone(), command };
            let verdict = pair.ask(&case.command).map_err(|failed| {
                let why = failed.message().unwrap_or("mongod did not answer").to_owned();
                format!("{why}, asked {} of {:?}", case.command, case.documents)
            })?;
            counts.add(&verdict);
            if let Verdict::Known(what, difference) = &verdict
                && known > 0
            {
                known -= 1;
                println!("{name}: {what}\n{}\n", case.show(difference));
            }
            if let Verdict::Differs(difference) = &verdict {
                if counts.differ <= SHOWN {
                    shown.push(match shrink::shrink(&mut pair, &case)? {
                        Some((smallest, smaller)) => smallest.show(&smaller),
                        None => format!("(only after other operations)\n{}", case.show(difference)),
                    });
                }
                pair.reset(&documents, &others)?;
            } else if pair.is_worn() {
                pair.reset(&documents, &others)?;
            }
        }
    }
    table::add(name, &counts);
    if counts.differ == 0 {
        return Ok(());
    }
    let count = format!(
        "{} of {} cases differ (RMEM_DIFFERENTIAL_SEED={seed} RMEM_DIFFERENTIAL_CASES={})",
        counts.differ,
        counts.cases,
        cases * family.cost
    );
    Err(format!("{count}\n\n{}", shown.join("\n\n")).into())
}

/// Documents with the numbers from 1 on as their `_id`s.
fn numbered(family: &Family, runner: &mut TestRunner) -> Result<Vec<bson::Document>, Failed> {
    let mut documents = Vec::with_capacity(family.count);
    for id in 1..=family.count {
        let mut document = bson::doc! { "_id": id as i32 };
        document.extend(family.documents.new_tree(runner)?.current());
        documents.push(document);
    }
    Ok(documents)
}

/// The source of chance: its own for each family, so that one family alone gets the same cases.
fn runner(seed: u64, name: &str) -> TestRunner {
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    for (place, byte) in name.bytes().enumerate() {
        let slot = &mut bytes[8 + place % 24];
        *slot = slot.wrapping_mul(31).wrapping_add(byte);
    }
    TestRunner::new_with_rng(Config::default(), TestRng::from_seed(RngAlgorithm::ChaCha, &bytes))
}
