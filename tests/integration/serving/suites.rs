//! The project's own suites, with `mongodb://…` of a `rmem serve` as their memory.

use std::sync::{Mutex, PoisonError};

use libtest_mimic::{Failed, Trial};
use rmem::store::{Role, StoreUri, open};

use super::Served;
use crate::{computables, contract, mixtures, planning, triggers, worlds};

/// The one server of these tests, and the folder it is in.
static SERVER: Mutex<Option<(Served, tempfile::TempDir)>> = Mutex::new(None);

/// The suites.
pub(super) fn trials() -> Vec<Trial> {
    let mut trials = contract::trials("serving::contract", || {
        Ok(contract::Subject { store: open(&StoreUri::parse(&uri()?)?, Role::Shared)?, folder: None })
    });
    trials.extend(computables::trials("serving::computables", true, || {
        Ok(computables::Place { uri: uri()?, folder: None })
    }));
    let cases = worlds::CASES.iter().chain(triggers::CASES).chain(&mixtures::CASES).chain(planning::CASES);
    trials.extend(cases.map(|(name, case)| Trial::test(format!("serving::{name}"), move || case(&uri()?))));
    trials
}

fn uri() -> Result<String, Failed> {
    let mut server = SERVER.lock().unwrap_or_else(PoisonError::into_inner);
    if server.is_none() {
        let folder = tempfile::tempdir()?;
        *server = Some((Served::start(folder.path(), &[])?, folder));
    }
    Ok(server.as_ref().map(|(server, _)| server.uri.clone()).unwrap_or_default())
}

/// Ends the server, where one was started.
pub(crate) fn stop() {
    drop(SERVER.lock().unwrap_or_else(PoisonError::into_inner).take());
}
