//! A replica set: initiated once, joined, and given the members of the settings.

use std::time::{Duration, Instant};

use bson::{Bson, Document, doc};

use super::error::{BackendError, answered, failed};
use crate::settings::backend::Backend;
use crate::store::mongodb::admin::{Admin, AdminError, Hello};

/// How long a member may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// How long a set may take to be founded, to elect a primary, or to take a member in.
const SETTLE_TIMEOUT: Duration = Duration::from_secs(60);
/// How often it is looked whether it has.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// The server's code for a set that another robot initiated meanwhile.
const ALREADY_INITIALIZED: i32 = 23;

/// How a set is, once nothing is left to be done from here.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Settled {
    /// It has a primary, and this robot's member is the primary or has a copy.
    Up {
        /// `PRIMARY` or `SECONDARY`.
        state: &'static str,
        /// The members that do not answer.
        silent: Vec<String>,
    },
    /// It has a primary, and this robot's member, or another new one, is still copying.
    Copying,
    /// No majority of its members answers.
    Waiting {
        /// The members that do not answer.
        silent: Vec<String>,
    },
}

/// What a look at the members led to.
enum Step {
    Settled(Settled),
    /// Something was done, or has to happen first: what is missing.
    Again(String),
}

/// Founds the set, joins it, and adds members, as far as that can be done now.
///
/// # Errors
/// Where a member belongs to another set, or the set does not settle though a majority answers.
pub fn settle(backend: &Backend) -> Result<Settled, BackendError> {
    let since = Instant::now();
    loop {
        match step(backend)? {
            Step::Settled(Settled::Copying) if since.elapsed() < SETTLE_TIMEOUT => {}
            Step::Settled(settled) => return Ok(settled),
            Step::Again(missing) if since.elapsed() > SETTLE_TIMEOUT => {
                let reason = format!(
                    "the replica set `{}` is not ready: {missing}; `rmem backend status` shows its members, and the \
                     log beside {} says more",
                    backend.replica_set,
                    backend.path.display()
                );
                return Err(failed(backend, reason));
            }
            Step::Again(_) => {}
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// A member of the settings, and its answer.
struct View<'a> {
    host: &'a str,
    hello: Option<Hello>,
}

fn step(backend: &Backend) -> Result<Step, BackendError> {
    let own = ask(&backend.address()).map_err(|error| answered(backend, error))?;
    let views = views(&backend.members);
    for view in &views {
        let set = view.hello.as_ref().and_then(|hello| hello.set.as_deref());
        if let Some(other) = set.filter(|set| *set != backend.replica_set) {
            let reason =
                format!("{} belongs to the replica set `{other}`, not to `{}`", view.host, backend.replica_set);
            return Err(failed(backend, reason));
        }
    }
    let silent: Vec<String> =
        views.iter().filter(|view| view.hello.is_none()).map(|view| view.host.to_owned()).collect();
    let is_majority = (views.len() - silent.len()) * 2 > views.len();
    let belongs = views.iter().filter_map(|view| view.hello.as_ref()).any(|hello| hello.set.is_some());
    if !belongs && own.set.is_none() {
        return match rename(backend)? {
            Some(step) => Ok(step),
            None if is_majority => Ok(found(backend, &views)),
            None => Ok(Step::Settled(Settled::Waiting { silent })),
        };
    }
    let Some(primary) = primary(&views, &own) else {
        return Ok(match is_majority {
            true => Step::Again("it has no primary".to_owned()),
            false => Step::Settled(Settled::Waiting { silent }),
        });
    };
    if let Some(step) = complete(backend, &primary) {
        return Ok(step);
    }
    if primary.voters().is_ok_and(|voters| voters < views.len() - silent.len()) {
        // Until the new member votes as well, the set has a smaller majority than it seems.
        return Ok(Step::Settled(Settled::Copying));
    }
    // It may have been elected since it was asked first.
    let own = ask(&backend.address()).map_err(|error| answered(backend, error))?;
    Ok(match (own.is_primary, own.is_secondary) {
        (true, _) => Step::Settled(Settled::Up { state: "PRIMARY", silent }),
        (_, true) => Step::Settled(Settled::Up { state: "SECONDARY", silent }),
        _ => Step::Settled(Settled::Copying),
    })
}

fn ask(host: &str) -> Result<Hello, AdminError> {
    Admin::at(host, ANSWER_TIMEOUT)?.hello()
}

/// Asks all members at once.
fn views(members: &[String]) -> Vec<View<'_>> {
    std::thread::scope(|scope| {
        let asked: Vec<_> = members.iter().map(|host| (host, scope.spawn(|| ask(host).ok()))).collect();
        asked.into_iter().map(|(host, answer)| View { host, hello: answer.join().ok().flatten() }).collect()
    })
}

/// The primary, as the answering members know it.
fn primary(views: &[View<'_>], own: &Hello) -> Option<Admin> {
    let writable = views.iter().find(|view| view.hello.as_ref().is_some_and(|hello| hello.is_primary));
    let known = || views.iter().filter_map(|view| view.hello.as_ref()?.primary.clone()).next();
    let host = writable.map(|view| view.host.to_owned()).or_else(|| own.primary.clone()).or_else(known)?;
    let admin = Admin::at(&host, ANSWER_TIMEOUT).ok()?;
    admin.hello().is_ok_and(|hello| hello.is_primary).then_some(admin)
}

/// Founds the set with all members that answer, through the first of them.
fn found(backend: &Backend, views: &[View<'_>]) -> Step {
    let answering: Vec<&str> = views.iter().filter(|view| view.hello.is_some()).map(|view| view.host).collect();
    let founder = answering.first().copied().unwrap_or_default();
    let done = Admin::at(founder, ANSWER_TIMEOUT).and_then(|admin| admin.initiate(&backend.replica_set, &answering));
    Step::Again(match done {
        Err(AdminError::Refused { code: ALREADY_INITIALIZED, .. }) | Ok(()) => "it has no primary".to_owned(),
        Err(error) => error.to_string(),
    })
}

/// Adds a member that the settings have and the set does not; `None` where there is none.
fn complete(backend: &Backend, primary: &Admin) -> Option<Step> {
    let mut config = match primary.configuration() {
        Ok(Some(config)) => config,
        Ok(None) => return Some(Step::Again("the primary has no configuration".to_owned())),
        Err(error) => return Some(Step::Again(error.to_string())),
    };
    let members = config.get_array_mut("members").ok()?;
    let is_there = |host: &String| members.iter().any(|member| host_of(member) == Some(host));
    let missing = backend.members.iter().find(|host| !is_there(host))?;
    let id = members.iter().filter_map(|member| member.as_document()?.get_i32("_id").ok()).max().unwrap_or(-1) + 1;
    members.push(doc! { "_id": id, "host": missing }.into());
    next_version(&mut config);
    // Where another robot was faster, the next look sees it.
    let added = primary.reconfigure(config, false);
    Some(Step::Again(match added {
        Ok(()) => format!("{missing} was added"),
        Err(error) => error.to_string(),
    }))
}

/// Gives a set of one member its new address after a change of the port; `None` where the
/// address is right.
fn rename(backend: &Backend) -> Result<Option<Step>, BackendError> {
    let [host] = backend.members.as_slice() else { return Ok(None) };
    let admin = Admin::at(&backend.address(), ANSWER_TIMEOUT).map_err(|error| answered(backend, error))?;
    let Some(mut config) = admin.configuration().map_err(|error| answered(backend, error))? else { return Ok(None) };
    match config.get_array_mut("members").map(Vec::as_mut_slice) {
        Ok([Bson::Document(member)]) if member.get_str("host").ok() != Some(host.as_str()) => {
            member.insert("host", host)
        }
        _ => return Ok(Some(Step::Again("its only member does not find itself in it".to_owned()))),
    };
    next_version(&mut config);
    let changed = admin.reconfigure(config, true);
    Ok(Some(Step::Again(changed.map_or_else(|error| error.to_string(), |()| "it has no primary".to_owned()))))
}

fn host_of(member: &Bson) -> Option<&str> {
    member.as_document()?.get_str("host").ok()
}

fn next_version(config: &mut Document) {
    let version = config.get_i32("version").unwrap_or(1);
    config.insert("version", version.saturating_add(1));
}
