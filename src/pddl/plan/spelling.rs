//! Plans in the spelling of their task: FF shouts, the memory does not.

use std::collections::HashMap;

use super::Plan;
use crate::formats::pddl::ast::{Domain, Name, Problem};

impl Plan {
    /// The same plan with the names of actions as the domain spells them, and those of
    /// objects as the problem does, or, for constants only, the domain. Names that are in
    /// neither stay.
    #[must_use]
    pub fn spelled(mut self, domain: &Domain, problem: &Problem) -> Self {
        let actions = domain.actions.iter().map(|action| &action.name);
        let actions = spellings(actions.chain(domain.durative_actions.iter().map(|action| &action.name)));
        let objects = spellings(domain.constants.iter().chain(&problem.objects).map(|object| &object.name));
        for step in &mut self.steps {
            spell(&mut step.action, &actions);
            step.arguments.iter_mut().for_each(|argument| spell(argument, &objects));
        }
        self
    }
}

fn spellings<'a>(names: impl Iterator<Item = &'a Name>) -> HashMap<String, &'a str> {
    names.map(|name| (name.as_str().to_lowercase(), name.as_str())).collect()
}

fn spell(name: &mut String, spellings: &HashMap<String, &str>) {
    if let Some(spelling) = spellings.get(&name.to_lowercase()) {
        *name = (*spelling).to_owned();
    }
}
