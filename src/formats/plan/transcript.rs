//! What a planner printed, whatever the dialect.

use std::fmt;

/// Which steps of a text count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Counted {
    /// All: it is one plan.
    All,
    /// Those of the last plan: planners print several, each better than the one before.
    Last,
}

/// One action of a plan, as it is spelled in the text.
#[derive(Debug, Clone, PartialEq)]
pub struct Action {
    /// The action's name, in the text's own case.
    pub name: String,
    /// Its arguments in order.
    pub arguments: Vec<String>,
    /// When it starts, in temporal plans.
    pub start: Option<f64>,
    /// How long it takes, for durative actions.
    pub duration: Option<f64>,
    /// The line it stands on, from 1.
    pub line: usize,
}

/// What the text amounts to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// A plan; the empty one where the goal holds already.
    Plan,
    /// The planner says that it has a proof that there is none.
    Unsolvable,
    /// The planner stopped without a plan and without a proof.
    GaveUp,
    /// The planner says that its memory ran out.
    OutOfMemory,
    /// The planner says that its time ran out.
    OutOfTime,
    /// The planner says that the task uses what it cannot do, or is larger than
    /// it was compiled for.
    Unsupported,
    /// The planner refused its input or its command line.
    Rejected,
    /// Metric-FF 2.1 wants `-s 0` for a task without `:metric`.
    NoCriterion,
    /// None of the above: a crash, or not a planner.
    Unclear,
}

/// What a planner has against its input.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Complaint {
    /// The file it names.
    pub file: Option<String>,
    /// The line it names, from 1.
    pub line: Option<usize>,
    /// The token it names.
    pub token: Option<String>,
    /// Its own words.
    pub text: String,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.file, self.line) {
            (Some(file), Some(line)) => write!(f, "{file}:{line}: ")?,
            (Some(file), None) => write!(f, "{file}: ")?,
            (None, Some(line)) => write!(f, "line {line}: ")?,
            (None, None) => {}
        }
        f.write_str(&self.text)?;
        match &self.token {
            Some(token) => write!(f, " at `{token}`"),
            None => Ok(()),
        }
    }
}

/// What a planner printed.
#[derive(Debug, Clone, PartialEq)]
pub struct Transcript {
    /// What it amounts to.
    pub verdict: Verdict,
    /// The plan's actions in the order of the text; of several plans, those of the last.
    pub actions: Vec<Action>,
    /// The planner's word on the plan's cost.
    pub cost: Option<f64>,
    /// The sentence that decided, in the planner's words; empty for a plan.
    pub message: String,
    /// What it has against the input, where it says so.
    pub complaint: Option<Complaint>,
}

impl Transcript {
    /// A transcript that says nothing yet.
    pub(crate) fn unclear() -> Self {
        Self { verdict: Verdict::Unclear, actions: Vec::new(), cost: None, message: String::new(), complaint: None }
    }

    /// Takes `verdict` unless an earlier sentence decided already.
    pub(super) fn decide(&mut self, verdict: Verdict, message: &str) {
        if self.verdict == Verdict::Unclear {
            self.verdict = verdict;
            self.message = message.trim().to_owned();
        }
    }

    /// Takes a complaint about the input unless an earlier sentence decided already.
    pub(super) fn reject(&mut self, complaint: Complaint) {
        if self.verdict == Verdict::Unclear {
            self.verdict = if complaint.names_a_feature() { Verdict::Unsupported } else { Verdict::Rejected };
            self.message = complaint.to_string();
            self.complaint = Some(complaint);
        }
    }

    /// Adds the line after a complaint, which says what was expected.
    pub(super) fn explain(&mut self, text: &str) {
        if let Some(complaint) = &mut self.complaint {
            complaint.text = format!("{}, {}", complaint.text, text.trim());
            self.message = complaint.to_string();
        }
    }
}

/// What stands at the point of a syntax error when the planner is older than the language.
const FEATURES: [&str; 27] = [
    ":strips",
    ":typing",
    ":equality",
    ":adl",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":fluents",
    ":numeric-fluents",
    ":object-fluents",
    ":action-costs",
    ":goal-utilities",
    ":durative-actions",
    ":durative-action",
    ":duration-inequalities",
    ":continuous-effects",
    ":timed-initial-literals",
    ":time",
    ":derived-predicates",
    ":derived",
    ":preferences",
    ":constraints",
    ":functions",
    ":metric",
];

impl Complaint {
    /// A syntax error, with the words that name its file, its line and the token it stands at.
    pub(super) fn syntax_error(file: Option<&str>, line: Option<&str>, token: Option<&str>) -> Self {
        Self {
            file: file.map(str::to_owned),
            line: line.and_then(|line| line.parse().ok()),
            token: token.map(str::to_owned),
            text: "syntax error".to_owned(),
        }
    }

    fn names_a_feature(&self) -> bool {
        let Some(token) = &self.token else { return false };
        FEATURES.iter().any(|feature| feature.eq_ignore_ascii_case(token))
    }
}
