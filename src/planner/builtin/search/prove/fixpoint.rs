//! The pairs of facts that rules lead to: the fixpoint of h² (Haslum and Geffner 2000, "Admissible heuristics for optimal
//! planning"), of which only counts here whether a pair is reached at all.

use super::super::task::{Fact, Task};
use super::pairs::{Pairs, contains, facts, insert, remove};

/// How an operator leads from state to state; either forward or backward.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// What holds where it starts.
    pub(super) needs: Vec<Fact>,
    /// What holds where it leads, as far as that is certain.
    pub(super) certain: Vec<Fact>,
    /// What may hold there, each with what that depends on besides.
    pub(super) adds: Vec<(Fact, Vec<Fact>)>,
    /// The variables of which nothing stays but what is added.
    pub(super) changed: Vec<u32>,
}

/// The pairs that were reached so far.
pub(super) struct Fixpoint<'t> {
    task: &'t Task,
    /// What may be reached.
    allowed: Option<&'t Pairs>,
    pub(super) reached: Pairs,
    /// The facts that were reached.
    single: Vec<u64>,
    /// When the row of each fact changed last.
    changed: Vec<u32>,
    latest: u32,
    now: u32,
    /// What goes with the start of a rule.
    base: Vec<u64>,
    row: Vec<u64>,
    work: u64,
}

impl<'t> Fixpoint<'t> {
    pub(super) fn new(task: &'t Task, allowed: Option<&'t Pairs>) -> Self {
        let reached = Pairs::none(task.facts());
        let words = reached.words();
        let (base, row, single) = (vec![0; words], vec![0; words], vec![0; words]);
        Self { task, allowed, reached, single, changed: vec![1; task.facts()], latest: 1, now: 1, base, row, work: 0 }
    }

    /// Adds all pairs of a set of facts that are allowed.
    pub(super) fn start(&mut self, set: &[u64]) {
        for fact in facts(set) {
            if !self.allows(fact, fact) {
                continue;
            }
            self.row.copy_from_slice(set);
            self.join(fact);
        }
    }

    fn allows(&self, one: Fact, other: Fact) -> bool {
        self.allowed.is_none_or(|allowed| allowed.has(one, other))
            && (one == other || self.task.variable(one) != self.task.variable(other))
    }

    /// Applies rules until nothing is added; says whether that was possible with the work, which it takes from it.
    pub(super) fn run(&mut self, rules: &[Rule], work: &mut u64) -> bool {
        let mut done = vec![0; rules.len()];
        loop {
            let before = self.now;
            for (rule, done) in rules.iter().zip(&mut done) {
                if self.is_news(rule, *done) {
                    *done = self.now;
                    self.now += 1;
                    self.apply(rule);
                }
            }
            self.work += rules.len() as u64;
            if self.work > *work {
                *work = 0;
                return false;
            }
            if self.now == before {
                *work -= self.work;
                return true;
            }
        }
    }

    /// Whether what a rule depends on has changed since it was applied.
    fn is_news(&self, rule: &Rule, done: u32) -> bool {
        let is_new = |fact: &Fact| self.changed[*fact as usize] > done;
        done == 0
            || rule.needs.is_empty() && self.latest > done
            || rule.needs.iter().any(is_new)
            || rule.adds.iter().any(|(_, condition)| condition.iter().any(is_new))
    }

    fn apply(&mut self, rule: &Rule) {
        let words = self.base.len() as u64;
        self.work += 1 + (rule.needs.len() * rule.needs.len()) as u64 / 2;
        if !self.reached.has_all(&rule.needs) {
            return;
        }
        let mut base = std::mem::take(&mut self.base);
        base.copy_from_slice(&self.single);
        self.reached.meet(&rule.needs, &mut base);
        let reachable: Vec<bool> = rule
            .adds
            .iter()
            .map(|(fact, condition)| {
                let fits = |other: &Fact| self.allows(*fact, *other);
                self.allowed.is_none_or(|_| fits(fact) && rule.certain.iter().all(fits))
                    && condition.iter().all(|fact| contains(&base, *fact))
                    && self.reached.has_all(condition)
            })
            .collect();
        rule.changed.iter().for_each(|variable| remove(&mut base, self.task.domain(*variable as usize)));
        if let Some(allowed) = self.allowed {
            allowed.meet(&rule.certain, &mut base);
            self.work += words * rule.certain.len() as u64 / 4;
        }
        self.work += words * (1 + rule.needs.len() as u64 + 2 * rule.adds.len() as u64) / 4;
        for (place, (fact, condition)) in rule.adds.iter().enumerate() {
            if !reachable[place] {
                continue;
            }
            self.row.copy_from_slice(&base);
            self.reached.meet(condition, &mut self.row);
            for (other, (added, second)) in rule.adds.iter().enumerate().filter(|(other, _)| reachable[*other]) {
                let is_joint = condition.is_empty()
                    || second.is_empty()
                    || condition.iter().all(|one| second.iter().all(|two| self.reached.has(*one, *two)));
                if other != place && is_joint {
                    insert(&mut self.row, *added);
                }
            }
            self.work += (rule.adds.len() * (1 + condition.len())) as u64;
            insert(&mut self.row, *fact);
            self.join(*fact);
        }
        self.base = base;
    }

    /// Adds the pairs of a fact with those of the row that are allowed.
    fn join(&mut self, fact: Fact) {
        if let Some(allowed) = self.allowed {
            self.row.iter_mut().zip(allowed.row(fact)).for_each(|(word, row)| *word &= row);
        }
        remove(&mut self.row, self.task.domain(self.task.variable(fact)));
        insert(&mut self.row, fact);
        self.row.iter_mut().zip(self.reached.row(fact)).for_each(|(word, row)| *word &= !row);
        for other in facts(&self.row) {
            self.reached.add(fact, other);
            self.changed[other as usize] = self.now;
            self.changed[fact as usize] = self.now;
            self.latest = self.now;
            self.work += 1;
        }
        insert(&mut self.single, fact);
    }
}
