//! Where a stored plan comes from.

use std::fmt::Write as _;
use std::time::Duration;

use bson::{Array, Bson, DateTime, Document, doc};
use sha2::{Digest as _, Sha256};

use super::{Input, TaskSource};
use crate::formats::shell;
use crate::pddl::{Problem, Why};
use crate::problem::{Generated, SectionReport, names};
use crate::saturate::to_i64;

/// What stands for the planner of a plan that came from a file.
pub const IMPORTED: &str = "import";

/// The SHA-256 of a text, in hexadecimal.
#[must_use]
pub fn hash(text: &str) -> String {
    let mut hex = String::with_capacity(64);
    for byte in Sha256::digest(text.as_bytes()) {
        let _ = write!(hex, "{byte:02x}");
    }
    hex
}

/// A query that a template asked, and how many documents answered.
#[derive(Debug, Clone, PartialEq)]
pub struct Answered {
    /// The section or the call that asked.
    pub name: String,
    /// The namespace that was asked.
    pub namespace: String,
    /// The query as it was written.
    pub query: String,
    /// How many documents answered.
    pub count: u64,
    /// The line of the template that asks, from 1.
    pub line: usize,
}

impl From<&SectionReport> for Answered {
    fn from(section: &SectionReport) -> Self {
        Self {
            name: section.name.clone(),
            namespace: section.namespace.to_string(),
            query: shell::relaxed(&section.query),
            count: section.matched,
            line: section.line,
        }
    }
}

/// What a planner did in a race.
#[derive(Debug, Clone, PartialEq)]
pub struct Racer {
    /// Its name.
    pub planner: String,
    /// Its version, where known.
    pub version: Option<String>,
    /// The outcome's word; `ended` where another had won before it was done.
    pub outcome: String,
    /// Wall time.
    pub time: Duration,
    /// Processor time, where known.
    pub cpu: Option<Duration>,
    /// How many steps its plan has.
    pub length: Option<usize>,
    /// What there was to say about it.
    pub message: String,
}

/// Where a plan comes from, for `_robmem_info.lineage`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Lineage {
    /// The SHA-256 of the domain's text.
    pub domain: String,
    /// The SHA-256 of the problem's text.
    pub problem: String,
    /// The SHA-256 of the template's text, where the problem came from one.
    pub template: Option<String>,
    /// The goal as it was given or written.
    pub goal: String,
    /// The queries of the template, in the order they were asked.
    pub queries: Vec<Answered>,
    /// The planner's name.
    pub planner: String,
    /// Its version, where known.
    pub version: Option<String>,
    /// Program and arguments.
    pub arguments: Vec<String>,
    /// The outcome's word.
    pub outcome: String,
    /// The plan's cost.
    pub cost: Option<f64>,
    /// What the cost counts, where the problem says so: an expression of PDDL, like `total-cost`.
    pub metric: Option<String>,
    /// How many steps the plan has; none without a plan.
    pub length: Option<usize>,
    /// Whether the planner let actions touch, and the plan has them apart.
    pub is_spaced: bool,
    /// When planning began.
    pub started: Option<DateTime>,
    /// What the plan was made from.
    pub sources: Option<TaskSource>,
    /// The planners that were asked.
    pub planners: Vec<String>,
    /// Whether they were to use all of their time.
    pub anytime: bool,
    /// How long the planners were allowed to take.
    pub timeout: Option<Duration>,
    /// How many bytes of memory the planner was allowed to use.
    pub memory_limit: Option<u64>,
    /// The id of the plan whose task this one was found for again.
    pub rerun_of: Option<String>,
    /// What each planner did, where there were several.
    pub race: Vec<Racer>,
    /// Why there is no plan, where that was looked into.
    pub why: Option<Why>,
    /// How long each part of the way took: `render`, `plan`, `validate`, ….
    pub times: Vec<(String, Duration)>,
}

impl Lineage {
    /// That of a plan before it is looked for: what it is made from, the problem that this gave, and the
    /// queries that its template asked.
    #[must_use]
    pub fn of(source: TaskSource, problem: &Problem, generated: Option<&Generated>) -> Self {
        let request = match &source.input {
            Input::Template(request) => Some(request),
            Input::Problem(_) => None,
        };
        // One that a part of the template would have used that was left out is not the goal of the problem.
        let given = request.filter(|_| generated.is_none_or(|generated| !generated.is_goal_unused));
        let goal = || problem.tree().goal.as_ref().map(ToString::to_string).unwrap_or_default();
        Self {
            domain: hash(source.domain.text()),
            problem: hash(problem.source().text()),
            template: request.map(|request| hash(request.template.text())),
            metric: problem.tree().metric.as_ref().map(|metric| bare(&metric.expression.to_string())),
            goal: given.and_then(|request| request.goal.clone()).unwrap_or_else(goal),
            queries: generated.iter().flat_map(|generated| &generated.sections).map(Answered::from).collect(),
            sources: Some(source),
            ..Self::default()
        }
    }

    /// The document; times are in milliseconds.
    #[must_use]
    pub fn to_document(&self) -> Document {
        let queries = self.queries.iter().map(|asked| {
            let count = to_i64(asked.count);
            Bson::Document(doc! {
                "name": &asked.name, "namespace": &asked.namespace, "query": &asked.query, "count": count,
                "line": to_i64(asked.line),
            })
        });
        let mut document = doc! { "domain": &self.domain, "problem": &self.problem };
        insert(&mut document, "template", self.template.clone());
        document.insert("goal", &self.goal);
        document.insert("queries", queries.collect::<Array>());
        document.insert("planner", &self.planner);
        insert(&mut document, "version", self.version.clone());
        document.insert("arguments", &self.arguments);
        document.insert("outcome", &self.outcome);
        insert(&mut document, "cost", self.cost);
        insert(&mut document, "metric", self.metric.clone());
        insert(&mut document, "length", self.length.and_then(|length| i64::try_from(length).ok()));
        if self.is_spaced {
            document.insert("spaced", true);
        }
        if !self.race.is_empty() {
            document.insert("race", self.race.iter().map(racer).collect::<Array>());
        }
        insert(&mut document, "why", self.why.as_ref().map(reasons));
        insert(&mut document, "started", self.started);
        let times = self.times.iter().map(|(name, time)| (name.clone(), Bson::Double(time.as_secs_f64() * 1000.0)));
        document.insert("times", times.collect::<Document>());
        document.insert("planners", &self.planners);
        document.insert("anytime", self.anytime);
        insert(&mut document, "timeout", self.timeout.map(|timeout| timeout.as_secs_f64() * 1000.0));
        insert(&mut document, "memory_limit", self.memory_limit.and_then(|limit| i64::try_from(limit).ok()));
        insert(&mut document, "rerun_of", self.rerun_of.clone());
        insert(&mut document, "sources", self.sources.as_ref().map(TaskSource::to_document));
        document
    }
}

/// What a planner did in a race, as a document.
fn racer(racer: &Racer) -> Bson {
    let millis = |time: Duration| time.as_secs_f64() * 1000.0;
    let mut document = doc! { "planner": &racer.planner };
    insert(&mut document, "version", racer.version.clone());
    document.insert("outcome", &racer.outcome);
    document.insert("time", millis(racer.time));
    insert(&mut document, "cpu", racer.cpu.map(millis));
    insert(&mut document, "length", racer.length.and_then(|length| i64::try_from(length).ok()));
    insert(&mut document, "message", Some(racer.message.clone()).filter(|message| !message.is_empty()));
    document.into()
}

/// What keeps the goal from being reached: the conditions that can never hold, those of the goal first, each
/// with what would make it hold and what that lacks, in the memory's spelling, and the predicates that are never true
/// of anything.
fn reasons(why: &Why) -> Document {
    if why.is_unknown {
        return doc! { "unknown": true };
    }
    let spelled = |text: &String| names::readable(text);
    let obstacles = why.obstacles.iter().enumerate().map(|(place, obstacle)| {
        let achievers = obstacle.achievers.iter().map(|achiever| {
            let missing: Vec<String> = achiever.missing.iter().map(spelled).collect();
            Bson::Document(doc! { "action": spelled(&achiever.action), "missing": missing })
        });
        Bson::Document(doc! {
            "condition": spelled(&obstacle.condition),
            "goal": place < why.goals,
            "achievers": achievers.collect::<Array>(),
        })
    });
    doc! { "unreachable": obstacles.collect::<Array>(), "unfilled": &why.unfilled }
}

/// `total-cost` for `(total-cost)`; an expression of several words stays.
fn bare(expression: &str) -> String {
    let inner = expression.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    inner.filter(|inner| !inner.contains([' ', '('])).unwrap_or(expression).to_owned()
}

fn insert(document: &mut Document, key: &str, value: Option<impl Into<Bson>>) {
    if let Some(value) = value {
        document.insert(key, value);
    }
}
