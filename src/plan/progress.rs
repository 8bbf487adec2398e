//! How far the execution of a stored plan has come, step by step.
//!
//! A step that nothing is known of has no key for it. Once something is, its status and
//! times stand in the step itself, where whoever executes the plan sees them: `_status`
//! (`"running"`, `"done"` or `"failed"`), `_started` and `_ended` (dates) in the numbered
//! layout, where no parameter can be called so; `status`, `started` and `ended` in the
//! other.

use std::fmt;

use bson::{Bson, DateTime, Document};

/// How far a step is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Status {
    /// Not begun, as far as is known.
    #[default]
    Open,
    /// Begun and not ended.
    Running,
    /// Ended well.
    Done,
    /// Ended badly.
    Failed,
}

impl Status {
    /// Its word in documents.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Running => "running",
            Self::Done => "done",
            Self::Failed => "failed",
        }
    }

    /// Its word in facts, as the CLIPS executive of Fawkes calls the states of an action.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Open => "FORMULATED",
            Self::Running => "RUNNING",
            Self::Done => "FINAL",
            Self::Failed => "FAILED",
        }
    }

    fn from_word(word: &str) -> Self {
        let known = [Self::Running, Self::Done, Self::Failed];
        known.into_iter().find(|status| status.word() == word).unwrap_or_default()
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// What is known of the execution of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// How far it is.
    pub status: Status,
    /// When it began.
    pub started: Option<DateTime>,
    /// When it ended.
    pub ended: Option<DateTime>,
}

/// The keys of a step for its status, its start and its end.
type Keys = [&'static str; 3];
const NUMBERED: Keys = ["_status", "_started", "_ended"];
const LISTED: Keys = ["status", "started", "ended"];

/// What is known of each step of a stored plan, in either layout; of a failure, nothing.
#[must_use]
pub(super) fn progress(document: &Document) -> Vec<Progress> {
    if let Ok(actions) = document.get_array("actions") {
        return actions.iter().map(|action| of(action, LISTED)).collect();
    }
    (1_u64..).map_while(|number| document.get(number.to_string())).map(|step| of(step, NUMBERED)).collect()
}

fn of(step: &Bson, [status, started, ended]: Keys) -> Progress {
    let Some(step) = step.as_document() else { return Progress::default() };
    Progress {
        status: step.get_str(status).map(Status::from_word).unwrap_or_default(),
        started: step.get_datetime(started).ok().copied(),
        ended: step.get_datetime(ended).ok().copied(),
    }
}

/// The update that notes a step's status; steps count from 1. Nothing where the plan has no such step.
#[must_use]
pub(super) fn mark(document: &Document, number: usize, status: Status, at: DateTime) -> Option<Document> {
    let index = number.checked_sub(1)?;
    let known = progress(document).get(index).copied()?;
    let (step, [state, started, ended]) = match document.get_array("actions") {
        Ok(_) => (format!("actions.{index}"), LISTED),
        Err(_) => (number.to_string(), NUMBERED),
    };
    let (mut set, mut unset) = (Document::new(), Document::new());
    let mut note = |key: &str, value: Option<Bson>| {
        let path = format!("{step}.{key}");
        match value {
            Some(value) => set.insert(path, value),
            None => unset.insert(path, ""),
        };
    };
    let is_over = matches!(status, Status::Done | Status::Failed);
    // What begins again forgets how it ended; what ends keeps when it began.
    let began = match status {
        Status::Open => None,
        Status::Running => Some(at),
        Status::Done | Status::Failed => known.started,
    };
    note(state, (status != Status::Open).then(|| status.word().into()));
    note(started, began.map(Bson::DateTime));
    note(ended, is_over.then_some(Bson::DateTime(at)));
    let mut update = Document::new();
    if !set.is_empty() {
        update.insert("$set", set);
    }
    if !unset.is_empty() {
        update.insert("$unset", unset);
    }
    Some(update)
}

#[cfg(test)]
mod tests {
    use bson::doc;

    use super::*;

    #[test]
    fn a_step_is_marked_in_either_layout() {
        let at = DateTime::from_millis(5);
        let numbered = doc! { "plan": "success", "1": { "action": "go" } };
        let update = mark(&numbered, 1, Status::Done, at);
        let wanted = doc! { "$set": { "1._status": "done", "1._ended": at }, "$unset": { "1._started": "" } };
        assert_eq!(update, Some(wanted));
        let listed = doc! { "plan": 1, "actions": [{ "name": "go", "args": [] }] };
        let update = mark(&listed, 1, Status::Running, at);
        let wanted = doc! { "$set": { "actions.0.status": "running", "actions.0.started": at }, "$unset": { "actions.0.ended": "" } };
        assert_eq!(update, Some(wanted));
        for number in [0, 2] {
            assert_eq!(mark(&numbered, number, Status::Done, at), None);
            assert_eq!(mark(&listed, number, Status::Done, at), None);
        }
    }

    #[test]
    fn what_was_noted_is_read() {
        let at = DateTime::from_millis(5);
        let document = doc! { "plan": "success", "1": { "action": "go", "_status": "failed", "_ended": at }, "2": {} };
        let failed = Progress { status: Status::Failed, started: None, ended: Some(at) };
        assert_eq!(progress(&document), [failed, Progress::default()]);
    }
}
