//! What to plan for, and how.

use std::sync::Arc;
use std::time::Duration;

use crate::formats::Diagnostics;
use crate::pddl::Domain;
use crate::plan::{Layout, Record, TaskSource, whole};
use crate::planner::{Limits, Planner};
use crate::problem::Generated;
use crate::store::Namespace;

/// The most that a planner may print on one stream, or write as its plan, in bytes. More is not a plan, and takes
/// long to read.
pub const MAX_OUTPUT: u64 = 16 << 20;

/// The time limit where none is given.
pub const DEFAULT_TIMEOUT: Duration = Duration::from_secs(60);

/// The planner where none is given.
const DEFAULT_PLANNER: &str = "builtin";

/// A plan wanted.
pub struct PlanRequest {
    /// The texts that the task is made from.
    pub source: TaskSource,
    /// The domain, checked.
    pub domain: Domain,
    /// The problem, where the template was rendered before.
    pub generated: Option<Generated>,
    /// The planners; several race each other.
    pub planners: Arc<[Box<dyn Planner>]>,
    /// How they are run, and where the plan goes.
    pub options: SearchOptions,
    /// The id of the plan whose task is planned for again.
    pub rerun_of: Option<String>,
}

/// How planners are run, and where the plan goes.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOptions {
    /// Whether the planners use all of the time for better plans.
    pub anytime: bool,
    /// How long they may run.
    pub timeout: Duration,
    /// How much memory they may use together, in bytes.
    pub memory_limit: Option<u64>,
    /// Where the plan is stored; none where it is not.
    pub into: Option<Namespace>,
    /// How the plan is laid out in its document.
    pub layout: Layout,
}

impl PlanRequest {
    /// A request for a plan, its domain read and checked.
    ///
    /// # Errors
    /// What is wrong with the domain.
    pub fn new(
        source: TaskSource,
        planners: impl Into<Arc<[Box<dyn Planner>]>>,
        options: SearchOptions,
    ) -> Result<Self, Diagnostics> {
        let domain = source.read_domain()?;
        Ok(Self { source, domain, generated: None, planners: planners.into(), options, rerun_of: None })
    }
}

impl SearchOptions {
    /// The limits of the planners' programs.
    #[must_use]
    pub fn limits(&self) -> Limits {
        Limits { time: Some(self.timeout), memory: self.memory_limit, output: MAX_OUTPUT }
    }

    /// Returns the options with which a stored plan was found, as far as it says; it is stored nowhere.
    #[must_use]
    pub fn recorded(record: &Record) -> Self {
        let lineage = record.lineage();
        let timeout = lineage.and_then(|lineage| lineage.get_f64("timeout").ok());
        let timeout = timeout.and_then(|millis| Duration::try_from_secs_f64(millis / 1000.0).ok());
        let limit = lineage.and_then(|lineage| whole(lineage, "memory_limit"));
        let is_fawkes = record.document.contains_key("actions") || record.document.get_i32("plan").is_ok();
        Self {
            anytime: lineage.is_some_and(|lineage| lineage.get_bool("anytime").unwrap_or_default()),
            timeout: timeout.unwrap_or(DEFAULT_TIMEOUT),
            memory_limit: limit.and_then(|limit| u64::try_from(limit).ok()),
            into: None,
            layout: if is_fawkes { Layout::Fawkes } else { Layout::Numbered },
        }
    }

    /// Returns the names of the planners that were asked for a stored plan.
    #[must_use]
    pub fn recorded_planners(record: &Record) -> Vec<String> {
        let asked = record.lineage().and_then(|lineage| lineage.get_array("planners").ok()).into_iter().flatten();
        let asked: Vec<String> = asked.filter_map(|name| name.as_str().map(str::to_owned)).collect();
        if asked.is_empty() { vec![DEFAULT_PLANNER.to_owned()] } else { asked }
    }
}
