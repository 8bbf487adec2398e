//! How the values of one variable follow each other (its domain transition graph, Helmert 2006), and which of them
//! cannot be avoided.

use super::super::task::{Fact, Task};

/// The transitions of each variable.
pub(super) struct Transitions {
    /// The facts that may follow each fact.
    after: Vec<Vec<Fact>>,
    /// The facts that may follow every fact of a variable.
    always: Vec<Vec<Fact>>,
}

impl Transitions {
    pub(super) fn new(task: &Task) -> Self {
        let mut after = vec![Vec::new(); task.facts()];
        let mut always = vec![Vec::new(); task.len()];
        for operator in &task.operators {
            for effect in &operator.effects {
                let variable = task.variable(effect.fact);
                let mut needed = operator.condition.iter().chain(&effect.condition);
                match needed.find(|fact| task.variable(**fact) == variable) {
                    Some(fact) => after[*fact as usize].push(effect.fact),
                    None => always[variable].push(effect.fact),
                }
            }
        }
        for list in after.iter_mut().chain(&mut always) {
            list.sort_unstable();
            list.dedup();
        }
        Self { after, always }
    }

    /// Returns the values on every way from one to another over values that are reachable.
    pub(super) fn between(&self, task: &Task, from: Fact, to: Fact, reached: &[bool]) -> Vec<Fact> {
        let domain = task.domain(task.variable(to));
        if domain.len() < 3 || task.is_derived[task.variable(to)] {
            return Vec::new();
        }
        // Only values on one way can be on all.
        let Some(way) = self.way(task, from, to, None, reached) else { return Vec::new() };
        let is_between = |value: &Fact| self.way(task, from, to, Some(*value), reached).is_none();
        way.into_iter().filter(|value| *value != from && *value != to).filter(is_between).collect()
    }

    /// A shortest way that avoids a value.
    fn way(&self, task: &Task, from: Fact, to: Fact, without: Option<Fact>, reached: &[bool]) -> Option<Vec<Fact>> {
        let variable = task.variable(to);
        let start = task.offsets[variable];
        let mut parents = vec![Fact::MAX; task.domain(variable).len()];
        parents[(from - start) as usize] = from;
        let mut queue = vec![from];
        let mut next = 0;
        while let Some(fact) = queue.get(next).copied() {
            next += 1;
            if fact == to {
                let mut way = vec![to];
                let mut last = to;
                while last != from {
                    last = parents[(last - start) as usize];
                    way.push(last);
                }
                return Some(way);
            }
            for value in self.after[fact as usize].iter().chain(&self.always[variable]) {
                let is_open = parents[(value - start) as usize] == Fact::MAX;
                if is_open && Some(*value) != without && (*value == to || reached[*value as usize]) {
                    parents[(value - start) as usize] = fact;
                    queue.push(*value);
                }
            }
        }
        None
    }
}
