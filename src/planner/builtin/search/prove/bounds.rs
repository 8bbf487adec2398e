//! Which facts and numbers could be reached if nothing were ever undone: the relaxed reachability of numeric tasks by
//! intervals (Hoffmann 2003, "The Metric-FF planning system"; Aldinger, Mattmüller and Göbelbecker 2015, "Complexity of
//! interval relaxed numeric planning"; Scala, Haslum, Thiébaux and Ramírez 2016, "Interval-based relaxation for general
//! numeric planning").
//!
//! What may grow by an operator may grow without end. A goal that is not reached so has no plan.

use super::super::interval::{Interval, outcomes, values};
use super::super::number::{self, Change, NumericEffect};
use super::super::task::{Fact, Task};

/// How often an assignment moves the bounds of a variable before they are given up.
const MOVES: u32 = 8;

/// What is known of a task.
#[derive(Debug, PartialEq)]
pub(super) enum Bounds {
    /// The goal is out of reach: these comparisons, which it or an operator asks for, never hold, each as number and
    /// truth; with the values that the numeric variables may have.
    Refuted(Vec<(u32, bool)>, Vec<Interval>),
    /// Nothing stands in the way.
    Open,
    /// The work did not suffice.
    Spent,
}

/// Looks for what can be reached with so much work.
pub(super) fn bounds(task: &Task, state: &[Fact], work: u64) -> Bounds {
    let mut reach = Reach::new(task, state);
    match reach.run(work) {
        false => Bounds::Spent,
        true if reach.has_all(&task.goal) => Bounds::Open,
        true => Bounds::Refuted(reach.missing(), reach.intervals),
    }
}

struct Reach<'t> {
    task: &'t Task,
    reached: Vec<bool>,
    intervals: Vec<Interval>,
    moves: Vec<u32>,
    is_new: bool,
}

impl<'t> Reach<'t> {
    fn new(task: &'t Task, state: &[Fact]) -> Self {
        let mut reached = vec![false; task.relaxed_facts.max(task.facts())];
        state[..task.len()].iter().for_each(|fact| reached[*fact as usize] = true);
        let value = |variable| Interval::of(number::value(task.len(), state, variable));
        let intervals: Vec<Interval> = (0..task.numbers.count as u32).map(value).collect();
        Self { task, reached, moves: vec![0; intervals.len()], intervals, is_new: true }
    }

    fn has_all(&self, facts: &[Fact]) -> bool {
        facts.iter().all(|fact| self.reached[*fact as usize])
    }

    /// Applies what can be applied until nothing is new; says whether the work sufficed.
    fn run(&mut self, work: u64) -> bool {
        let task = self.task;
        let mut open: Vec<usize> = (0..task.operators.len()).collect();
        let rules = || {
            let axioms = task.axioms.iter().map(|axiom| (&axiom.condition, axiom.fact));
            axioms.chain(task.relaxed.iter().map(|(condition, fact)| (condition, *fact)))
        };
        let mut done = 0;
        while std::mem::take(&mut self.is_new) {
            done += (open.len() + task.axioms.len() + task.relaxed.len() + task.numbers.comparisons.len()) as u64 * 8;
            if done > work {
                return false;
            }
            open.retain(|number| !self.apply(*number));
            for (condition, fact) in rules() {
                if self.has_all(condition) {
                    self.reach(fact);
                }
            }
            self.compare();
        }
        true
    }

    fn reach(&mut self, fact: Fact) {
        self.is_new |= !self.reached[fact as usize];
        self.reached[fact as usize] = true;
    }

    /// Applies an operator; says whether it has nothing more to give.
    fn apply(&mut self, number: usize) -> bool {
        let operator = &self.task.operators[number];
        if !self.has_all(&operator.condition) {
            return false;
        }
        let mut is_done = operator.amounts.is_empty();
        for effect in &operator.effects {
            match self.has_all(&effect.condition) {
                true => self.reach(effect.fact),
                false => is_done = false,
            }
        }
        for effect in &operator.amounts {
            if self.has_all(&effect.condition) {
                self.change(effect);
            }
        }
        is_done
    }

    fn change(&mut self, effect: &NumericEffect) {
        let place = effect.variable as usize;
        let (known, amount) = (self.intervals[place], values(&effect.amount, &self.intervals));
        if amount.is_empty() || known.is_empty() && effect.change != Change::Assign {
            return;
        }
        let mut next = known;
        match effect.change {
            Change::Assign => {
                next = known.joined(amount);
                self.moves[place] += u32::from(next != known);
                if self.moves[place] > MOVES {
                    next = widened(known, next);
                }
            }
            Change::Increase | Change::Decrease => {
                let sign = if effect.change == Change::Increase { 1.0 } else { -1.0 };
                if amount.low * sign > 0.0 || amount.high * sign > 0.0 {
                    next.high = f64::INFINITY;
                }
                if amount.low * sign < 0.0 || amount.high * sign < 0.0 {
                    next.low = f64::NEG_INFINITY;
                }
            }
            Change::ScaleUp => next = widened(known, known.joined(known.times(amount))),
            Change::ScaleDown => {
                next = widened(known, known.joined(known.times(Interval::of(1.0).divided(amount))));
            }
        }
        // A variable without a value keeps none, or gets one.
        next.may_lack = known.may_lack;
        if next != known {
            self.intervals[place] = next;
            self.is_new = true;
        }
    }

    fn compare(&mut self) {
        let task = self.task;
        for comparison in &task.numbers.comparisons {
            let (left, right) = (values(&comparison.left, &self.intervals), values(&comparison.right, &self.intervals));
            let [may_hold, may_fail] = outcomes(comparison.comparator, left, right);
            let may_lack = left.may_lack || right.may_lack;
            if may_hold {
                self.reach(comparison.fact);
            }
            if may_fail || may_lack && !comparison.is_partial {
                self.reach(comparison.fact + 1);
            }
            if may_lack && comparison.is_partial {
                self.reach(comparison.fact + 2);
            }
        }
    }

    /// The comparisons that the goal asks for and that were not reached; those of operators, where there is none.
    fn missing(&self) -> Vec<(u32, bool)> {
        let of_goal = self.missing_of(&mut self.task.goal.iter());
        match of_goal.is_empty() {
            true => self.missing_of(&mut self.task.operators.iter().flat_map(|operator| &operator.condition)),
            false => of_goal,
        }
    }

    fn missing_of(&self, facts: &mut dyn Iterator<Item = &Fact>) -> Vec<(u32, bool)> {
        let mut is_wanted = vec![false; self.reached.len()];
        facts.for_each(|fact| is_wanted[*fact as usize] = true);
        let missing = |(number, fact, truth): (usize, Fact, bool)| {
            (is_wanted[fact as usize] && !self.reached[fact as usize]).then_some((number as u32, truth))
        };
        let comparisons = self.task.numbers.comparisons.iter().enumerate();
        comparisons
            .flat_map(|(number, comparison)| [(number, comparison.fact, true), (number, comparison.fact + 1, false)])
            .filter_map(missing)
            .collect()
    }
}

/// The bounds that moved are given up.
fn widened(known: Interval, next: Interval) -> Interval {
    Interval {
        low: if next.low < known.low { f64::NEG_INFINITY } else { next.low },
        high: if next.high > known.high { f64::INFINITY } else { next.high },
        ..next
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::example::counter;
    use super::super::super::number::Expression;
    use super::*;

    const ENOUGH: u64 = 1 << 20;

    #[test]
    fn a_counter_that_only_falls_never_reaches_ten() {
        let mut task = counter();
        assert_eq!(bounds(&task, &task.init, ENOUGH), Bounds::Open);
        for operator in &mut task.operators {
            operator.amounts.iter_mut().for_each(|effect| effect.change = Change::Decrease);
        }
        let falling = Interval { low: f64::NEG_INFINITY, ..Interval::of(0.0) };
        assert_eq!(bounds(&task, &task.init, ENOUGH), Bounds::Refuted(vec![(0, true)], vec![falling]));
        assert_eq!(bounds(&task, &task.init, 1), Bounds::Spent);
    }

    #[test]
    fn what_is_set_is_never_more_than_that() {
        let mut task = counter();
        for (operator, amount) in [(0, 4.0), (2, 9.5)] {
            task.operators[operator].amounts[0].change = Change::Assign;
            task.operators[operator].amounts[0].amount = Expression::Number(amount);
        }
        let between = Interval { high: 9.5, ..Interval::of(0.0) };
        assert_eq!(bounds(&task, &task.init, ENOUGH), Bounds::Refuted(vec![(0, true)], vec![between]));
        // One more than it is, again and again.
        task.operators[0].amounts[0].amount = Expression::Sum(vec![Expression::Variable(0), Expression::Number(1.0)]);
        assert_eq!(bounds(&task, &task.init, ENOUGH), Bounds::Open);
    }

    #[test]
    fn nothing_is_a_multiple_of_nothing() {
        let mut task = counter();
        for operator in &mut task.operators {
            operator.amounts.iter_mut().for_each(|effect| effect.change = Change::ScaleUp);
        }
        assert!(matches!(bounds(&task, &task.init, ENOUGH), Bounds::Refuted(..)));
        task.init.truncate(task.len());
        task.init.extend(number::words(2.0));
        assert_eq!(bounds(&task, &task.init, ENOUGH), Bounds::Open);
    }

    #[test]
    fn a_number_without_a_value_does_not_grow() {
        let mut task = counter();
        task.init.truncate(task.len());
        task.init.extend(number::words(f64::NAN));
        assert!(matches!(bounds(&task, &task.init, ENOUGH), Bounds::Refuted(..)));
    }
}
