//! What happens at each moment of a plan, and what it changes.

use std::fmt;

/// A moment of a plan: what happens at it, and what becomes true and false. Names are spelled as the domain and the
/// problem spell them; derived predicates are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Happening {
    /// When: in a plan without times, the number of the step.
    pub time: f64,
    /// The actions that take place, start or end.
    pub events: Vec<Event>,
    /// The facts that become true, sorted.
    pub becomes_true: Vec<String>,
    /// The facts that become false, sorted.
    pub becomes_false: Vec<String>,
    /// The numbers that change, sorted, each with its value before, if it had one, and after.
    pub values: Vec<(String, Option<f64>, f64)>,
}

/// What takes place at a moment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// An action without duration.
    Action(String),
    /// The start of a durative action.
    Start(String),
    /// The end of a durative action.
    End(String),
    /// A timed initial literal.
    Literal,
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Action(action) => f.write_str(action),
            Self::Start(action) => write!(f, "{action} starts"),
            Self::End(action) => write!(f, "{action} ends"),
            Self::Literal => f.write_str("a timed initial literal"),
        }
    }
}
