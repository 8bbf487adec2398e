//! The delete-relaxed task: what the effects of operators add is never lost.
//!
//! Costs of facts are those of the additive heuristic (Bonet and Geffner 2001); relaxed plans are made of the
//! cheapest supporters that it finds, as in the FF/additive heuristic of Keyder and Geffner (2008). The operators of
//! a relaxed plan that are applicable at once are the preferred ones (FF's helpful actions, Hoffmann and Nebel 2001;
//! Helmert 2006).

use std::rc::Rc;

use super::achieve::{self, Repetitions};
use super::task::{Fact, OperatorId, Task};

/// No supporter.
const NONE: u32 = u32::MAX;

/// Costs above which the order of facts does not matter.
const DEEP: usize = 1 << 18;

/// An operator's effects under one condition, or an axiom.
#[derive(Debug, Clone, Copy)]
struct Rule {
    operator: OperatorId,
    cost: u32,
}

/// How far a rule is from being applied.
#[derive(Debug, Clone, Copy)]
struct Progress {
    /// How many of the facts that it needs are not reached.
    open: u32,
    /// What it costs, with the facts that are reached.
    sum: u32,
}

/// The axioms and other rules have no operator.
const AXIOM: OperatorId = OperatorId::MAX;

/// What draws begin with.
const SEED: u64 = 0x2545_f491_4f6c_dd1d;

/// Odd, with well-spread bits (the golden ratio of 2⁶⁴).
const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;

/// How operators cost in estimates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Costs {
    /// One each.
    Unit,
    /// What they cost, and one more (Richter and Westphal 2010).
    PlusOne,
}

/// Lists of numbers, one after the other.
#[derive(Debug, Clone, Default)]
pub(super) struct Lists {
    ends: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    pub(super) fn push(&mut self, items: impl IntoIterator<Item = u32>) {
        self.items.extend(items);
        self.ends.push(self.items.len() as u32);
    }

    /// Makes the lists of places in which each number is.
    pub(super) fn inverted(&self, numbers: usize) -> Self {
        let mut ends = vec![0_u32; numbers];
        self.items.iter().for_each(|item| ends[*item as usize] += 1);
        let mut sum = 0;
        for end in &mut ends {
            let count = *end;
            *end = sum;
            sum += count;
        }
        let mut items = vec![0; self.items.len()];
        for place in 0..self.ends.len() {
            for item in self.get(place) {
                let next = &mut ends[*item as usize];
                items[*next as usize] = place as u32;
                *next += 1;
            }
        }
        Self { ends, items }
    }

    pub(super) fn get(&self, place: usize) -> &[u32] {
        let start = if place == 0 { 0 } else { self.ends[place - 1] };
        &self.items[start as usize..self.ends[place] as usize]
    }
}

/// The estimate of a state, and what it recommends.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Estimate {
    /// The cost of a relaxed plan; `None` where there is none: then there is no plan either.
    pub(super) value: Option<u32>,
    /// The operators to try first, each once, in order.
    pub(super) preferred: Vec<OperatorId>,
}

/// The relaxed task, with room for one exploration.
#[derive(Debug, Clone)]
pub(super) struct Relaxed {
    // What does not change is shared by the searches.
    rules: Rc<[Rule]>,
    conditions: Rc<Lists>,
    effects: Rc<Lists>,
    uses: Rc<Lists>,
    /// The rules without conditions.
    free: Rc<[u32]>,
    /// What is open of each rule at first.
    start: Rc<[Progress]>,
    is_goal: Vec<bool>,
    goals: Vec<Fact>,
    /// For each fact, its cost, and the rule that achieves it at that cost.
    costs: Vec<u32>,
    supporters: Vec<u32>,
    progress: Vec<Progress>,
    buckets: Vec<Vec<Fact>>,
    marks: Vec<bool>,
    marked: Vec<Fact>,
    /// How often each operator is in the relaxed plan.
    used: Vec<u32>,
    /// The variables that are not numbers.
    variables: usize,
    /// How often the operators of numeric rules are applied, and for each fact how often its supporter's is.
    repetitions: Option<Repetitions>,
    counts: Vec<u32>,
    /// Where one of the supporters that cost the same is drawn, and not the first one taken: what the draw is made of.
    chance: Option<u64>,
    /// How many rules have been touched so far.
    pub(super) work: u64,
}

impl Relaxed {
    pub(super) fn new(task: &Task, costs: Costs) -> Self {
        let (mut rules, mut conditions, mut effects) = (Vec::new(), Lists::default(), Lists::default());
        let wanted = wanted(task);
        let unit = |operator: &super::task::Operator| match costs {
            Costs::Unit => 1,
            Costs::PlusOne => (operator.cost.clamp(0.0, 1e6) as u32).saturating_add(1),
        };
        for (number, operator) in task.operators.iter().enumerate() {
            let cost = unit(operator);
            let mut left: Vec<&super::task::Effect> =
                operator.effects.iter().filter(|effect| wanted[effect.fact as usize]).collect();
            while let Some(first) = left.first().copied() {
                let (same, rest): (Vec<&super::task::Effect>, Vec<_>) =
                    left.iter().partition(|effect| effect.condition == first.condition);
                rules.push(Rule { operator: number as OperatorId, cost });
                let mut condition = [operator.condition.as_slice(), &first.condition].concat();
                condition.sort_unstable();
                condition.dedup();
                conditions.push(condition);
                effects.push(same.iter().map(|effect| effect.fact));
                left = rest;
            }
        }
        let axioms = task.axioms.iter().map(|axiom| (&axiom.condition, axiom.fact));
        for (condition, fact) in axioms.chain(task.relaxed.iter().map(|(condition, fact)| (condition, *fact))) {
            rules.push(Rule { operator: AXIOM, cost: 0 });
            conditions.push(condition.iter().copied());
            effects.push([fact]);
        }
        let numeric = achieve::rules(task, &wanted);
        let first = rules.len();
        for rule in &numeric {
            rules.push(Rule { operator: rule.operator, cost: unit(&task.operators[rule.operator as usize]) });
            conditions.push(rule.condition.iter().copied());
            effects.push([rule.fact]);
        }
        let repetitions = (!numeric.is_empty()).then(|| Repetitions::new(task, numeric, first));
        let facts = task.relaxed_facts.max(task.facts());
        let needs = |rule: usize| conditions.get(rule).len() as u32;
        let start: Rc<[Progress]> =
            rules.iter().enumerate().map(|(number, rule)| Progress { open: needs(number), sum: rule.cost }).collect();
        let free = (0..rules.len() as u32).filter(|rule| needs(*rule as usize) == 0).collect();
        let uses = conditions.inverted(facts);
        Self {
            uses: uses.into(),
            free,
            is_goal: vec![false; facts],
            goals: Vec::new(),
            costs: vec![u32::MAX; facts],
            supporters: vec![NONE; facts],
            progress: start.to_vec(),
            buckets: Vec::new(),
            marks: vec![false; facts],
            marked: Vec::new(),
            used: vec![0; task.operators.len()],
            variables: task.len(),
            counts: vec![1; if repetitions.is_some() { facts } else { 0 }],
            repetitions,
            chance: None,
            work: 0,
            rules: rules.into(),
            conditions: conditions.into(),
            effects: effects.into(),
            start,
        }
    }

    /// Draws one of the supporters that cost the same, anew for each state, in the same way in every run.
    ///
    /// The first one is the same in all states. Where it leads nowhere, as where each car is to be parked behind the same
    /// one, all preferred operators of a plateau do.
    pub(super) fn draw(&mut self) {
        // How often an operator is applied depends on the supporter that came first.
        self.chance = self.repetitions.is_none().then_some(SEED);
    }

    /// Estimates how far it is from a state to the goals.
    pub(super) fn estimate(&mut self, state: &[Fact], goals: &[Fact]) -> Estimate {
        match self.explore(state, goals) {
            true => self.plan(goals),
            false => Estimate::default(),
        }
    }

    /// Computes the costs of facts until those of all goals are known; says whether there are such.
    pub(super) fn explore(&mut self, state: &[Fact], goals: &[Fact]) -> bool {
        self.goals.iter().for_each(|goal| self.is_goal[*goal as usize] = false);
        self.goals.clear();
        self.goals.extend_from_slice(goals);
        goals.iter().for_each(|goal| self.is_goal[*goal as usize] = true);
        self.costs.fill(u32::MAX);
        self.progress.copy_from_slice(&self.start);
        self.buckets.iter_mut().for_each(Vec::clear);
        if let Some(repetitions) = &mut self.repetitions {
            repetitions.start(self.variables, state);
        }
        for fact in &state[..self.variables] {
            self.reach(*fact, 0, NONE);
        }
        for place in 0..self.free.len() {
            let rule = self.free[place];
            self.apply(rule);
        }
        self.chance = self.chance.map(|chance| chance.wrapping_add(SEED).rotate_left(17));
        let mut left = goals.len();
        let mut cost = 0;
        while cost < self.buckets.len() {
            let mut next = 0;
            while next < self.buckets[cost].len() {
                let fact = self.buckets[cost][next] as usize;
                next += 1;
                // Found again at a smaller cost, and done.
                if (self.costs[fact] as usize).min(DEEP) != cost {
                    continue;
                }
                if self.is_goal[fact] {
                    left -= 1;
                    if left == 0 {
                        return true;
                    }
                }
                self.spread(fact);
            }
            cost += 1;
        }
        left == 0
    }

    /// Lowers what is open of the rules that need a fact.
    fn spread(&mut self, fact: usize) {
        let cost = self.costs[fact];
        let uses = self.uses.get(fact);
        self.work += uses.len() as u64;
        let (start, count) = (self.range(fact), uses.len());
        for place in start..start + count {
            let rule = self.uses.items[place];
            let progress = &mut self.progress[rule as usize];
            // A fact of the last bucket may come twice.
            if progress.open == 0 {
                continue;
            }
            progress.open -= 1;
            progress.sum = progress.sum.saturating_add(cost);
            if progress.open == 0 {
                self.apply(rule);
            }
        }
    }

    fn range(&self, fact: usize) -> usize {
        if fact == 0 { 0 } else { self.uses.ends[fact - 1] as usize }
    }

    fn apply(&mut self, rule: u32) {
        let mut cost = self.progress[rule as usize].sum;
        if let Some(repetitions) = &mut self.repetitions {
            let Some(count) = repetitions.count(rule, &self.supporters) else { return };
            cost = cost.saturating_add(self.rules[rule as usize].cost.saturating_mul(count - 1));
            if repetitions.is_numeric(rule) {
                self.work += 2;
            }
            for fact in self.effects.get(rule as usize) {
                if cost < self.costs[*fact as usize] {
                    self.counts[*fact as usize] = count;
                }
            }
        }
        let start = if rule == 0 { 0 } else { self.effects.ends[rule as usize - 1] };
        for place in start..self.effects.ends[rule as usize] {
            let fact = self.effects.items[place as usize];
            self.reach(fact, cost, rule);
        }
    }

    fn reach(&mut self, fact: Fact, cost: u32, supporter: u32) {
        if cost >= self.costs[fact as usize] {
            if cost == self.costs[fact as usize] && self.is_drawn(self.supporters[fact as usize], supporter) {
                self.supporters[fact as usize] = supporter;
            }
            return;
        }
        self.costs[fact as usize] = cost;
        self.supporters[fact as usize] = supporter;
        // Facts that nothing needs are not looked at again.
        if self.range(fact as usize) == self.uses.ends[fact as usize] as usize && !self.is_goal[fact as usize] {
            return;
        }
        let bucket = (cost as usize).min(DEEP);
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, Vec::new);
        }
        self.buckets[bucket].push(fact);
    }

    /// Whether a supporter takes the place of another one that costs the same.
    fn is_drawn(&self, known: u32, other: u32) -> bool {
        let Some(chance) = self.chance else { return false };
        if known == NONE || other == NONE || self.rules[other as usize].cost == 0 {
            // Rules that cost nothing might support each other in a circle.
            return false;
        }
        let lot = |rule: u32| (u64::from(rule) ^ chance).wrapping_mul(SPREAD) >> 20;
        lot(other) > lot(known)
    }

    /// Makes a relaxed plan of the supporters.
    fn plan(&mut self, goals: &[Fact]) -> Estimate {
        let (mut value, mut preferred) = (0_u32, Vec::new());
        let mut operators: Vec<OperatorId> = Vec::new();
        self.marked.clear();
        goals.iter().for_each(|goal| self.mark(*goal));
        let mut next = 0;
        while next < self.marked.len() {
            let fact = self.marked[next] as usize;
            next += 1;
            let rule = self.supporters[fact];
            if rule == NONE {
                continue;
            }
            let Rule { operator, cost } = self.rules[rule as usize];
            if operator != AXIOM {
                let count = self.counts.get(fact).copied().unwrap_or(1);
                let known = std::mem::replace(&mut self.used[operator as usize], count);
                self.used[operator as usize] = count.max(known);
                value = value.saturating_add(cost.saturating_mul(count.saturating_sub(known)));
                if known == 0 {
                    operators.push(operator);
                    if self.progress[rule as usize].sum == cost {
                        preferred.push(operator);
                    }
                }
            }
            for place in 0..self.conditions.get(rule as usize).len() {
                self.mark(self.conditions.get(rule as usize)[place]);
            }
        }
        self.work += self.marked.len() as u64;
        self.marked.iter().for_each(|fact| self.marks[*fact as usize] = false);
        operators.iter().for_each(|operator| self.used[*operator as usize] = 0);
        preferred.sort_unstable();
        Estimate { value: Some(value), preferred }
    }

    /// Returns the facts that the last relaxed plan achieves or needs.
    pub(super) fn planned(&self) -> &[Fact] {
        &self.marked
    }

    fn mark(&mut self, fact: Fact) {
        if !std::mem::replace(&mut self.marks[fact as usize], true) {
            self.marked.push(fact);
        }
    }
}

/// The facts that a condition or the goal mentions.
fn wanted(task: &Task) -> Vec<bool> {
    let mut wanted = vec![false; task.relaxed_facts.max(task.facts())];
    let operators = task.operators.iter().flat_map(|operator| {
        operator.condition.iter().chain(operator.effects.iter().flat_map(|effect| &effect.condition))
    });
    let amounts = task.operators.iter().flat_map(|operator| &operator.amounts).flat_map(|effect| &effect.condition);
    let axioms = task.axioms.iter().flat_map(|axiom| &axiom.condition).chain(amounts);
    let relaxed = task.relaxed.iter().flat_map(|(condition, _)| condition);
    for fact in operators.chain(axioms).chain(relaxed).chain(&task.goal) {
        wanted[*fact as usize] = true;
    }
    wanted
}

/// What landmarks are found by.
impl Relaxed {
    /// Marks the facts that are reachable before any of some facts is, in `reached`, which has a place for each fact.
    ///
    /// Operators that are sure to add one of the facts cannot be applied before it.
    pub(super) fn reach_before(
        &mut self,
        state: &[Fact],
        facts: &[Fact],
        achievers: &Lists,
        sure: &[bool],
        reached: &mut [bool],
    ) {
        reached.fill(false);
        self.progress.copy_from_slice(&self.start);
        let mut banned: Vec<OperatorId> = Vec::new();
        for fact in facts {
            for rule in achievers.get(*fact as usize) {
                let operator = self.rules[*rule as usize].operator;
                if operator != AXIOM
                    && sure[*rule as usize]
                    && std::mem::replace(&mut self.used[operator as usize], 1) == 0
                {
                    banned.push(operator);
                }
            }
        }
        let mut queue: Vec<Fact> = Vec::new();
        for fact in state[..self.variables].iter().filter(|fact| !facts.contains(fact)) {
            reached[*fact as usize] = true;
            queue.push(*fact);
        }
        for place in 0..self.free.len() {
            self.add_before(self.free[place], facts, reached, &mut queue);
        }
        while let Some(fact) = queue.pop() {
            let (start, count) = (self.range(fact as usize), self.uses.get(fact as usize).len());
            self.work += count as u64;
            for place in start..start + count {
                let rule = self.uses.items[place];
                let progress = &mut self.progress[rule as usize];
                progress.open -= 1;
                if progress.open == 0 {
                    self.add_before(rule, facts, reached, &mut queue);
                }
            }
        }
        banned.iter().for_each(|operator| self.used[*operator as usize] = 0);
    }

    fn add_before(&self, rule: u32, facts: &[Fact], reached: &mut [bool], queue: &mut Vec<Fact>) {
        let operator = self.rules[rule as usize].operator;
        if operator != AXIOM && self.used[operator as usize] > 0 {
            return;
        }
        for fact in self.effects.get(rule as usize) {
            if !facts.contains(fact) && !std::mem::replace(&mut reached[*fact as usize], true) {
                queue.push(*fact);
            }
        }
    }

    /// Returns the rules that achieve each fact.
    pub(super) fn achievers(&self) -> Lists {
        self.effects.inverted(self.costs.len())
    }

    /// Returns, for each rule, whether it applies whenever its operator does.
    pub(super) fn sure(&self, task: &Task) -> Vec<bool> {
        let is_sure = |(number, rule): (usize, &Rule)| {
            let needs = self.start[number].open as usize;
            let is_numeric = self.repetitions.as_ref().is_some_and(|known| known.is_numeric(number as u32));
            let operator = task.operators.get(rule.operator as usize);
            !is_numeric && operator.is_none_or(|operator| operator.condition.len() == needs)
        };
        self.rules.iter().enumerate().map(is_sure).collect()
    }

    /// Returns what a rule needs.
    pub(super) fn condition(&self, rule: u32) -> &[Fact] {
        self.conditions.get(rule as usize)
    }
}

impl Relaxed {
    /// Returns the operator of a rule; `None` for an axiom.
    pub(super) fn operator(&self, rule: u32) -> Option<OperatorId> {
        Some(self.rules[rule as usize].operator).filter(|operator| *operator != AXIOM)
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::{door, names};
    use super::*;

    #[test]
    fn a_relaxed_plan_counts_each_operator_once() {
        let task = door();
        let mut relaxed = Relaxed::new(&task, Costs::Unit);
        // Nothing is lost: hall-store, take, open, enter; one never has to go back.
        let estimate = relaxed.estimate(&task.init, &task.goal);
        assert_eq!(estimate.value, Some(4));
        assert_eq!(names(&task, &estimate.preferred), ["hall-store"]);
    }

    #[test]
    fn costs_of_facts_are_sums() {
        // Two goals that share a step of cost one: the additive costs are 2 + 2, the relaxed plan has three steps.
        let task = super::super::example::task(
            &[2, 2, 2],
            &[0; 3],
            &[(1, 1), (2, 1)],
            &[("share", &[], &[(0, 1)]), ("one", &[(0, 1)], &[(1, 1)]), ("two", &[(0, 1)], &[(2, 1)])],
        );
        let mut relaxed = Relaxed::new(&task, Costs::Unit);
        assert_eq!(relaxed.estimate(&task.init, &task.goal).value, Some(3));
        assert_eq!(task.goal.iter().map(|goal| relaxed.costs[*goal as usize]).collect::<Vec<_>>(), [2, 2]);
    }

    #[test]
    fn where_no_relaxed_plan_is_there_is_no_estimate() {
        let mut task = door();
        task.operators.retain(|operator| operator.name != [2]);
        assert_eq!(Relaxed::new(&task, Costs::Unit).estimate(&task.init, &task.goal), Estimate::default());
    }

    #[test]
    fn equal_supporters_are_drawn_in_the_same_way_in_every_run() {
        let ways = [("one", &[][..], &[(0, 1)][..]), ("two", &[], &[(0, 1)]), ("three", &[], &[(1, 1)])];
        let task = super::super::example::task(&[2, 2], &[0, 0], &[(0, 1)], &ways);
        let drawn = || {
            let mut relaxed = Relaxed::new(&task, Costs::Unit);
            relaxed.draw();
            let estimates = (0..64).map(|_| relaxed.estimate(&task.init, &task.goal));
            estimates.map(|estimate| (estimate.value, estimate.preferred)).collect::<Vec<_>>()
        };
        let found = drawn();
        assert_eq!(found, drawn());
        let count = |operator| found.iter().filter(|estimate| **estimate == (Some(1), vec![operator])).count();
        assert!(count(0) > 8 && count(1) > 8 && count(0) + count(1) == 64, "{found:?}");
    }

    #[test]
    fn costs_count_one_more_than_they_are() {
        let mut task = door();
        task.operators.iter_mut().for_each(|operator| operator.cost = 10.0);
        assert_eq!(Relaxed::new(&task, Costs::PlusOne).estimate(&task.init, &task.goal).value, Some(44));
    }
}
