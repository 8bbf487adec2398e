//! The external program `fast-downward`.

use std::ffi::OsString;

use super::files::{DOMAIN, PLAN, PROBLEM};
use super::interface::{Output, Planner};
use crate::formats::plan::{Transcript, downward};
use crate::pddl::Feature;
use crate::process::Host;

const LACKS: [Feature; 11] = [
    Feature::DurativeActions,
    Feature::DurationInequalities,
    Feature::TimedInitialLiterals,
    Feature::ContinuousEffects,
    Feature::NumericFluents,
    Feature::Preferences,
    Feature::Constraints,
    Feature::ObjectFluents,
    Feature::ActionVariables,
    Feature::FractionalNumbers,
    Feature::OtherMetrics,
];

/// What its translator accepts, by its own words when it meets another.
const REQUIREMENTS: [&str; 13] = [
    ":strips",
    ":adl",
    ":typing",
    ":negation",
    ":equality",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":derived-predicates",
    ":action-costs",
];

/// Fast Downward, with `lama-first` by default.
#[derive(Debug, Clone)]
pub struct FastDownward {
    /// The program, a name on the path or a path.
    pub program: OsString,
    /// The alias of a search configuration.
    pub alias: String,
}

impl Default for FastDownward {
    fn default() -> Self {
        Self { program: "fast-downward".into(), alias: "lama-first".to_owned() }
    }
}

impl FastDownward {
    /// With `lama-first`, or with `lama`, which improves its plan until the limit of time.
    pub(super) fn configured(anytime: bool) -> Self {
        match anytime {
            true => Self { alias: "lama".to_owned(), ..Self::default() },
            false => Self::default(),
        }
    }
}

impl Planner for FastDownward {
    fn name(&self) -> &str {
        "fast-downward"
    }

    fn lacks(&self) -> &[Feature] {
        &LACKS
    }

    fn requirements(&self) -> Option<&[&str]> {
        Some(&REQUIREMENTS)
    }

    fn command(&self, _host: &Host<'_>) -> Vec<OsString> {
        let words = ["--alias", &self.alias, "--plan-file", PLAN, DOMAIN, PROBLEM];
        std::iter::once(self.program.clone()).chain(words.map(OsString::from)).collect()
    }

    fn read(&self, output: &Output) -> Transcript {
        downward::read(&output.plans, output.code, &output.stdout, &output.stderr)
    }

    fn is_anytime(&self) -> bool {
        true
    }

    fn install(&self) -> String {
        format!(
            "there is no program `{}`; get Fast Downward from https://www.fast-downward.org or PyPI's up-fast-downward, \
             or use `--planner builtin`, which needs none",
            self.program.to_string_lossy()
        )
    }
}
