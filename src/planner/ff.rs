//! The external program `ff`: FF 2.3, Metric-FF 2.1, or the present-day one.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use memchr::memmem;

use super::files::{DOMAIN, PROBLEM};
use super::interface::{Output, Planner};
use super::sizes::Sizes;
use crate::formats::plan::{Transcript, Verdict, ff};
use crate::pddl::Feature;
use crate::process::Host;

/// What FF 2.3 and Metric-FF 2.1 cannot do. That FF 2.3 knows no numbers it says itself.
const LACKS: [Feature; 8] = [
    Feature::DurativeActions,
    Feature::DurationInequalities,
    Feature::TimedInitialLiterals,
    Feature::ContinuousEffects,
    Feature::DerivedPredicates,
    Feature::Preferences,
    Feature::Constraints,
    Feature::ObjectFluents,
];

/// The sizes that FF 2.3 and Metric-FF 2.1 are built with unless they are enlarged.
const SIZES: Sizes = Sizes { arity: 5, predicates: 50, objects: 2000 };

/// What stands in the executable of the present-day program, whose tables grow.
const PRESENT_DAY: &str = "ferroplan";

/// The requirement keywords that both know; an unknown one is a syntax error to them.
const REQUIREMENTS: [&str; 11] = [
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
];

/// FF prunes where an action only deletes and the delete matters to a conditional effect. The
/// others are what the built-in planner, which may be called `ff` as well, proves nothing with.
pub(super) const DOUBTS: [Feature; 7] = [
    Feature::ConditionalEffects,
    Feature::NumericFluents,
    Feature::DurativeActions,
    Feature::TimedInitialLiterals,
    Feature::DerivedPredicates,
    Feature::Preferences,
    Feature::Constraints,
];

/// The external program `ff`.
#[derive(Debug, Clone)]
pub struct Ff {
    /// The program, a name on the path or a path.
    pub program: OsString,
}

impl Default for Ff {
    fn default() -> Self {
        Self { program: "ff".into() }
    }
}

impl Ff {
    /// Whether the program is the present-day one, where it is given by its path.
    fn is_present_day(&self) -> bool {
        let path = Path::new(&self.program);
        path.components().count() > 1
            && fs::read(path).is_ok_and(|program| memmem::find(&program, PRESENT_DAY.as_bytes()).is_some())
    }
}

impl Planner for Ff {
    fn name(&self) -> &str {
        "ff"
    }

    fn lacks(&self) -> &[Feature] {
        &LACKS
    }

    fn sizes(&self) -> Option<Sizes> {
        Some(SIZES).filter(|_| !self.is_present_day())
    }

    fn requirements(&self) -> Option<&[&str]> {
        Some(&REQUIREMENTS)
    }

    fn command(&self, _host: &Host<'_>) -> Vec<OsString> {
        vec![self.program.clone(), "-o".into(), DOMAIN.into(), "-f".into(), PROBLEM.into()]
    }

    /// Metric-FF 2.1 searches without a `:metric` only with an option, which FF does not know.
    fn again(&self, answer: &Transcript, command: &[OsString]) -> Option<Vec<OsString>> {
        (answer.verdict == Verdict::NoCriterion).then(|| {
            let mut command = command.to_vec();
            command.extend(["-s".into(), "0".into()]);
            command
        })
    }

    fn read(&self, output: &Output) -> Transcript {
        ff::read(&output.stdout, &output.stderr)
    }

    fn doubts(&self) -> &[Feature] {
        &DOUBTS
    }

    fn install(&self) -> String {
        format!(
            "there is no program `{}`; `cargo install ferroplan-cli` installs one, and `--planner builtin` needs none",
            self.program.to_string_lossy()
        )
    }
}
