//! Why a goal cannot be reached, and the text of the explanation.

use std::fmt;

/// What keeps a goal from being reached.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Why {
    /// Whether the task was too large, or uses what is not simulated; then nothing else is known.
    pub is_unknown: bool,
    /// The conditions of the goal that can never hold, then the conditions behind them; not all of very many.
    pub obstacles: Vec<Obstacle>,
    /// How many of the obstacles stand in the goal itself.
    pub goals: usize,
    /// Predicates that actions ask for, that are true of nothing at first and that no action can
    /// make true.
    pub unfilled: Vec<String>,
}

/// A condition that can never hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// As PDDL, with variables where any object would do.
    pub condition: String,
    /// The actions and rules that would make it hold; not all of very many.
    pub achievers: Vec<Achiever>,
}

/// What would make a condition hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Achiever {
    /// The action with its objects, and variables where any object would do.
    pub action: String,
    /// What it lacks, as PDDL. Empty where each of its conditions can hold, but never all for
    /// the same objects.
    pub missing: Vec<String>,
}

impl Why {
    /// Whether it proves that there is no plan: a condition of the goal can never hold.
    #[must_use]
    pub fn is_proof(&self) -> bool {
        !self.is_unknown && self.goals > 0
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_unknown {
            return f.write_str("why: not known; the task is too large, or uses what is not simulated");
        }
        if self.goals == 0 {
            f.write_str("why: each condition of the goal could be reached if nothing were ever undone; ")?;
            f.write_str("what actions delete, numbers or times stand in the way")?;
        }
        for (place, obstacle) in self.obstacles.iter().enumerate() {
            if place > 0 {
                f.write_str("\n")?;
            }
            let what = if place < self.goals { "why: the goal asks for " } else { "     and " };
            write!(f, "{what}{}, which can never hold", obstacle.condition)?;
            if obstacle.achievers.is_empty() {
                f.write_str(": no action makes it true")?;
            }
            for achiever in &obstacle.achievers {
                match achiever.missing.as_slice() {
                    [] => write!(
                        f,
                        "\n       {} would make it true, but its preconditions never hold together",
                        achiever.action
                    )?,
                    missing => {
                        write!(f, "\n       {} would make it true, but needs {}", achiever.action, missing.join(", "))?
                    }
                }
            }
        }
        if !self.unfilled.is_empty() {
            write!(f, "\nnever true, in the initial state or by an action: {}", self.unfilled.join(", "))?;
        }
        Ok(())
    }
}
