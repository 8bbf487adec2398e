//! The planners that a name may mean: rmem's own, and those of the settings.

use std::path::PathBuf;

use crate::fault::{AtFault, Fault};

use super::{Builtin, Configured, FastDownward, Ff, Planner};

/// Makes a planner; with the flag, one that improves its plan until the limit of time, where it can.
type Make = fn(&Registry, bool) -> Box<dyn Planner>;

/// The planners that need no configuration, one line each.
const OWN: &[(&str, Make)] = &[
    ("builtin", |_, anytime| Box::new(Builtin { anytime })),
    ("ff", |registry, _| Box::new(registry.ff())),
    ("fast-downward", |_, anytime| Box::new(FastDownward::configured(anytime))),
];

/// The planners that are known by name.
#[derive(Debug, Clone, Default)]
pub struct Registry {
    configured: Vec<Configured>,
    ff: Option<PathBuf>,
}

/// No planner has the name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no planner `{name}`; expected one of {}", .known.join(", "))]
pub struct UnknownPlanner {
    name: String,
    known: Vec<String>,
}

impl AtFault for UnknownPlanner {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

impl Registry {
    /// The planners of rmem and those of the settings. `ff` is the path of the program `ff`, where it is
    /// installed: what it can do depends on which program that is.
    #[must_use]
    pub fn new(configured: Vec<Configured>, ff: Option<PathBuf>) -> Self {
        Self { configured, ff }
    }

    /// Returns the planner with a name. With `anytime` it improves its plan until the limit of time, where it can.
    ///
    /// # Errors
    /// Where there is none.
    pub fn get(&self, name: &str, anytime: bool) -> Result<Box<dyn Planner>, UnknownPlanner> {
        if let Some(configured) = self.configured.iter().find(|planner| planner.name == name) {
            return Ok(Box::new(configured.clone()));
        }
        match OWN.iter().find(|(own, _)| *own == name) {
            Some((_, make)) => Ok(make(self, anytime)),
            None => Err(UnknownPlanner { name: name.to_owned(), known: self.names().map(str::to_owned).collect() }),
        }
    }

    /// The names, rmem's own first.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        OWN.iter().map(|(name, _)| *name).chain(self.configured.iter().map(|planner| planner.name.as_str()))
    }

    /// Whether a name is that of a planner that needs no configuration.
    #[must_use]
    pub fn is_own(name: &str) -> bool {
        OWN.iter().any(|(own, _)| *own == name)
    }

    fn ff(&self) -> Ff {
        self.ff.as_ref().map_or_else(Ff::default, |path| Ff { program: path.into() })
    }
}
