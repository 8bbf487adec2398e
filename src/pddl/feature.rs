//! Parts of the language, and which of them a text really uses.

use std::fmt;

use crate::formats::Span;

/// A part of PDDL that not every planner knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Feature {
    /// Types other than `object`.
    Typing,
    /// `=` between objects.
    Equality,
    /// `not` in a condition, other than of `=`.
    NegativePreconditions,
    /// `or` and `imply`.
    DisjunctivePreconditions,
    /// `exists`.
    ExistentialPreconditions,
    /// `forall` in a condition.
    UniversalPreconditions,
    /// `when` and `forall` in an effect.
    ConditionalEffects,
    /// Effects of durative actions under conditions of other moments.
    TimedConditionalEffects,
    /// `:derived`.
    DerivedPredicates,
    /// `:derived` with rules that look at facts which actions change.
    ChangingDerivedPredicates,
    /// The same, beside durative actions.
    TimedDerivedPredicates,
    /// `(increase (total-cost) …)` and no other arithmetic.
    ActionCosts,
    /// Numbers in conditions, or effects on them.
    NumericFluents,
    /// Functions whose values are objects.
    ObjectFluents,
    /// `:durative-action`.
    DurativeActions,
    /// Durations that are not given by one `=`.
    DurationInequalities,
    /// `(at end …)` in `:duration`.
    DurationsAtEnd,
    /// `#t`.
    ContinuousEffects,
    /// `(at 5 (p))` in `:init`.
    TimedInitialLiterals,
    /// `preference`.
    Preferences,
    /// `preference` in the condition of a durative action.
    TimedPreferences,
    /// `:constraints`.
    Constraints,
    /// `:vars` of an action.
    ActionVariables,
    /// A number that is not whole, such as `1.5`.
    FractionalNumbers,
    /// A metric other than `minimize (total-cost)`.
    OtherMetrics,
}

impl Feature {
    /// All of them.
    pub const ALL: [Self; 25] = [
        Self::Typing,
        Self::Equality,
        Self::NegativePreconditions,
        Self::DisjunctivePreconditions,
        Self::ExistentialPreconditions,
        Self::UniversalPreconditions,
        Self::ConditionalEffects,
        Self::TimedConditionalEffects,
        Self::DerivedPredicates,
        Self::ChangingDerivedPredicates,
        Self::TimedDerivedPredicates,
        Self::ActionCosts,
        Self::NumericFluents,
        Self::ObjectFluents,
        Self::DurativeActions,
        Self::DurationInequalities,
        Self::DurationsAtEnd,
        Self::ContinuousEffects,
        Self::TimedInitialLiterals,
        Self::Preferences,
        Self::TimedPreferences,
        Self::Constraints,
        Self::ActionVariables,
        Self::FractionalNumbers,
        Self::OtherMetrics,
    ];

    /// The features that a requirement, with or without its colon, is the name of.
    pub fn named(requirement: &str) -> impl Iterator<Item = Self> {
        let name = requirement.trim_start_matches(':').to_ascii_lowercase();
        Self::ALL.into_iter().filter(move |feature| feature.requirement() == name)
    }

    /// The requirement that announces it, without its colon.
    #[must_use]
    pub fn requirement(self) -> &'static str {
        match self {
            Self::Typing => "typing",
            Self::Equality => "equality",
            Self::NegativePreconditions => "negative-preconditions",
            Self::DisjunctivePreconditions => "disjunctive-preconditions",
            Self::ExistentialPreconditions => "existential-preconditions",
            Self::UniversalPreconditions => "universal-preconditions",
            Self::ConditionalEffects | Self::TimedConditionalEffects => "conditional-effects",
            Self::DerivedPredicates | Self::ChangingDerivedPredicates | Self::TimedDerivedPredicates => {
                "derived-predicates"
            }
            Self::ActionCosts => "action-costs",
            Self::NumericFluents => "numeric-fluents",
            Self::ObjectFluents => "object-fluents",
            Self::DurativeActions => "durative-actions",
            Self::DurationInequalities | Self::DurationsAtEnd => "duration-inequalities",
            Self::ContinuousEffects => "continuous-effects",
            Self::TimedInitialLiterals => "timed-initial-literals",
            Self::Preferences | Self::TimedPreferences => "preferences",
            Self::Constraints => "constraints",
            Self::ActionVariables => "action-variables",
            Self::FractionalNumbers => "fractional-numbers",
            Self::OtherMetrics => "other-metrics",
        }
    }

    /// Whether a requirement, with its colon, announces it.
    #[must_use]
    pub fn is_announced_by(self, requirement: &str) -> bool {
        let requirement = requirement.to_ascii_lowercase();
        let Some(requirement) = requirement.strip_prefix(':') else { return false };
        let wider: &[&str] = match self {
            Self::Typing
            | Self::Equality
            | Self::DisjunctivePreconditions
            | Self::ConditionalEffects
            | Self::TimedConditionalEffects => &["adl", "ucpop"],
            Self::NegativePreconditions => &["adl", "ucpop", "true-negation"],
            Self::ExistentialPreconditions | Self::UniversalPreconditions => {
                &["adl", "ucpop", "quantified-preconditions"]
            }
            Self::DerivedPredicates | Self::ChangingDerivedPredicates | Self::TimedDerivedPredicates => {
                &["domain-axioms"]
            }
            Self::ActionCosts => &["fluents", "numeric-fluents"],
            Self::NumericFluents => &["fluents"],
            Self::ObjectFluents => &["fluents"],
            Self::DurativeActions => &["timed-initial-literals"],
            _ => &[],
        };
        requirement == self.requirement() || wider.contains(&requirement)
    }
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DurationsAtEnd => f.write_str("durations that are checked at the end of an action"),
            Self::TimedConditionalEffects => f.write_str("effects under conditions of other moments"),
            Self::TimedPreferences => f.write_str("preferences in conditions of durative actions"),
            Self::ChangingDerivedPredicates => f.write_str("derived predicates over facts that actions change"),
            Self::TimedDerivedPredicates => {
                f.write_str("derived predicates over facts that actions change, beside durative actions")
            }
            Self::OtherMetrics => f.write_str("a metric other than `minimize (total-cost)`"),
            _ => f.write_str(&self.requirement().replace('-', " ")),
        }
    }
}

/// A feature and the first place that uses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Use {
    /// What is used.
    pub feature: Feature,
    /// Where, in the text it was read from.
    pub span: Span,
}

/// The features in use so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Uses(Vec<Use>);

impl Uses {
    pub(super) fn note(&mut self, feature: Feature, span: Span) {
        if !self.0.iter().any(|used| used.feature == feature) {
            self.0.push(Use { feature, span });
        }
    }

    /// In the order of [`Feature`]; action costs are no feature of their own among numbers.
    pub(super) fn finish(mut self) -> Vec<Use> {
        if self.0.iter().any(|used| used.feature == Feature::NumericFluents) {
            self.0.retain(|used| used.feature != Feature::ActionCosts);
        }
        self.0.sort_by_key(|used| used.feature);
        self.0
    }
}

/// The requirements that exist.
pub(super) const REQUIREMENTS: [&str; 38] = [
    ":strips",
    ":typing",
    ":equality",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":adl",
    ":ucpop",
    ":fluents",
    ":numeric-fluents",
    ":object-fluents",
    ":action-costs",
    ":goal-utilities",
    ":durative-actions",
    ":duration-inequalities",
    ":continuous-effects",
    ":time",
    ":derived-predicates",
    ":timed-initial-literals",
    ":timed-initial-fluents",
    ":timed-effects",
    ":preferences",
    ":constraints",
    ":domain-axioms",
    ":subgoals-through-axioms",
    ":safety-constraints",
    ":expression-evaluation",
    ":open-state",
    ":true-negation",
    ":action-expansions",
    ":foreach-expansions",
    ":dag-expansions",
    ":multi-agent",
    ":no-moving-targets",
    ":supply-demand",
];
