//! Why the steps of a plan are in their order: causal links, and the partial order that they demand.
//!
//! A step that needs a fact, or that one is false, is linked to the last step before it that makes it so; without
//! one, it is so from the beginning. The partial order keeps two steps in the order of the plan where one needs what
//! the other changes, or where they change one fact in opposite ways (Bäckström 1998, deordering). What is looked
//! at are facts in conjunctions, with their times; steps with quantifiers, alternatives or conditional effects stay
//! where they are, so that the partial order never promises too much.

use std::collections::HashMap;

use super::Step;
use super::domain::Domain;
use super::model::{Arg, Change, Fact, Formula};
use super::table::Named as _;
use crate::formats::pddl::ast::Moment;

/// A fact that one step makes true and another needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Link {
    /// The step that makes it true, from 0.
    pub from: usize,
    /// The step that needs it.
    pub to: usize,
    /// The fact, as PDDL writes it.
    pub fact: String,
}

/// The structure of a plan.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Structure {
    /// Causal links, by the step that needs.
    pub links: Vec<Link>,
    /// Which step has to be before which, without what follows from others.
    pub order: Vec<(usize, usize)>,
}

/// What a ground step needs and does, as a whole or at its start or end.
#[derive(Default)]
pub(super) struct Ground {
    needs: Vec<Key>,
    adds: Vec<Key>,
    deletes: Vec<Key>,
    /// Whether it says more than facts in conjunctions.
    is_opaque: bool,
    /// When, where it is not the whole step.
    moment: Option<Moment>,
}

impl Ground {
    /// Whether what an action has at a time is of this part of the step.
    fn is_at(&self, time: Moment) -> bool {
        self.moment.is_none_or(|moment| time == moment || time == Moment::All)
    }
}

/// A ground literal: its predicate, its arguments in small letters, and whether the fact holds.
type Key = (u32, Vec<String>, bool);

/// Steps by the literals that they need or make true.
#[derive(Default)]
struct Known<'a> {
    needs: HashMap<&'a Key, Vec<usize>>,
    adds: HashMap<&'a Key, Vec<usize>>,
    opaque: Vec<usize>,
}

impl<'a> Known<'a> {
    fn insert(&mut self, index: usize, step: &'a Ground) {
        step.needs.iter().for_each(|fact| self.needs.entry(fact).or_default().push(index));
        step.adds.iter().for_each(|fact| self.adds.entry(fact).or_default().push(index));
        if step.is_opaque {
            self.opaque.push(index);
        }
    }

    /// The steps whose facts, needed or made true, a step undoes.
    fn undone(&self, step: &Ground) -> impl Iterator<Item = usize> {
        let facts = step.deletes.iter();
        facts.flat_map(|fact| [self.needs.get(fact), self.adds.get(fact)]).flatten().flatten().copied()
    }
}

impl Structure {
    /// Which of these has to be before which, without what follows from others.
    pub(super) fn order_of(ground: &[Ground]) -> Vec<(usize, usize)> {
        reduced(&linked(ground).1)
    }
}

impl Domain {
    /// The structure of a plan, as far as this domain knows its actions.
    #[must_use]
    pub fn structure(&self, steps: &[Step]) -> Structure {
        let ground: Vec<Ground> = steps.iter().map(|step| self.ground(step, None)).collect();
        let (links, before) = linked(&ground);
        let constants = self.constants.items().iter().map(|entry| entry.name().as_str());
        let arguments = steps.iter().flat_map(|step| step.arguments.iter().map(String::as_str));
        let spelled: HashMap<String, &str> =
            constants.chain(arguments).map(|name| (name.to_lowercase(), name)).collect();
        let link = |(from, to, need): (usize, usize, &Key)| Link { from, to, fact: self.fact_text(need, &spelled) };
        Structure { links: links.into_iter().map(link).collect(), order: reduced(&before) }
    }

    /// What a step needs and does at its start or end, or as a whole.
    pub(super) fn ground(&self, step: &Step, moment: Option<Moment>) -> Ground {
        let mut ground = Ground { moment, ..Ground::default() };
        let Some(action) = self.action(&step.action) else { return Ground { is_opaque: true, ..ground } };
        self.needs(&action.body.condition, step, &mut ground);
        self.effects(&action.body.effect, step, &mut ground);
        ground
    }

    fn needs(&self, formula: &Formula, step: &Step, ground: &mut Ground) {
        match formula {
            Formula::Fact(fact) => ground.needs.extend(self.key(fact, step, true)),
            Formula::Not(inner) if matches!(**inner, Formula::Fact(_)) => {
                if let Formula::Fact(fact) = &**inner {
                    ground.needs.extend(self.key(fact, step, false));
                }
            }
            Formula::And(parts) => parts.iter().for_each(|part| self.needs(part, step, ground)),
            Formula::Timed(time, inner) if ground.is_at(*time) => self.needs(inner, step, ground),
            Formula::Timed(..) => {}
            Formula::Same(..) | Formula::Compare(..) | Formula::Preference(..) => {}
            Formula::Not(inner) if matches!(**inner, Formula::Same(..)) => {}
            _ => ground.is_opaque = true,
        }
    }

    fn effects(&self, change: &Change, step: &Step, ground: &mut Ground) {
        match change {
            Change::Add(fact) | Change::Delete(fact) => {
                let holds = matches!(change, Change::Add(_));
                ground.adds.extend(self.key(fact, step, holds));
                ground.deletes.extend(self.key(fact, step, !holds));
            }
            Change::And(parts) => parts.iter().for_each(|part| self.effects(part, step, ground)),
            Change::Timed(time, inner) if ground.is_at(*time) => self.effects(inner, step, ground),
            Change::Timed(..) => {}
            Change::Forall(..) | Change::When(..) => ground.is_opaque = true,
            Change::Assign(..) | Change::AssignObject => {}
        }
    }

    fn key(&self, fact: &Fact, step: &Step, holds: bool) -> Option<Key> {
        let argument = |argument: &Arg| match argument {
            Arg::Slot(slot) => step.arguments.get(*slot as usize).map(|name| name.to_lowercase()),
            Arg::Object(number) => self.constants.get(*number).map(|entry| entry.name().as_str().to_lowercase()),
            Arg::Fluent => None,
        };
        Some((fact.predicate, fact.arguments.iter().map(argument).collect::<Option<_>>()?, holds))
    }

    /// A literal as PDDL, with the names as the plan spells them.
    fn fact_text(&self, (predicate, arguments, holds): &Key, spelled: &HashMap<String, &str>) -> String {
        let name = self.vocabulary.predicates.get(*predicate).map_or("", |entry| entry.name().as_str());
        let arguments = arguments.iter().map(|name| spelled.get(name).copied().unwrap_or(name.as_str()));
        let words: Vec<&str> = std::iter::once(name).chain(arguments).collect();
        let fact = format!("({})", words.join(" "));
        if *holds { fact } else { format!("(not {fact})") }
    }
}

/// The causal links, and behind each step those that have to wait for it.
fn linked(ground: &[Ground]) -> (Vec<(usize, usize, &Key)>, Vec<Steps>) {
    let (mut links, mut known) = (Vec::new(), Known::default());
    let mut before = vec![Steps::new(ground.len()); ground.len()];
    for (to, step) in ground.iter().enumerate() {
        for need in &step.needs {
            if let Some(from) = known.adds.get(need).and_then(|steps| steps.last()).copied() {
                links.push((from, to, need));
                before[from].insert(to);
            }
        }
        known.undone(step).for_each(|from| before[from].insert(to));
        let all = if step.is_opaque { 0..to } else { 0..0 };
        all.chain(known.opaque.iter().copied()).for_each(|from| before[from].insert(to));
        known.insert(to, step);
    }
    (links, before)
}

/// A set of steps, a bit each.
#[derive(Clone)]
struct Steps(Vec<u64>);

impl Steps {
    fn new(count: usize) -> Self {
        Self(vec![0; count.div_ceil(64)])
    }

    fn insert(&mut self, step: usize) {
        self.0[step / 64] |= 1 << (step % 64);
    }

    fn contains(&self, step: usize) -> bool {
        self.0[step / 64] & (1 << (step % 64)) != 0
    }

    fn extend(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(word, more)| *word |= more);
    }
}

/// The pairs that do not follow from others. Steps are in an order already, so that a way around a pair begins
/// with a step that is looked at before its end.
fn reduced(before: &[Steps]) -> Vec<(usize, usize)> {
    let mut reach: Vec<Steps> = vec![Steps::new(before.len()); before.len()];
    let mut pairs = Vec::new();
    for (first, direct) in before.iter().enumerate().rev() {
        let mut own = Steps::new(before.len());
        for (last, further) in reach.iter().enumerate().skip(first + 1) {
            if direct.contains(last) && !own.contains(last) {
                pairs.push((first, last));
                own.insert(last);
                own.extend(further);
            }
        }
        reach[first] = own;
    }
    pairs.sort_unstable();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::Dialect;
    use proptest::prelude::*;

    #[test]
    fn two_towers_are_built_side_by_side() {
        let text = "(define (domain b) (:predicates (clear ?x) (held ?r ?x) (on ?x ?y) (free ?r))
          (:action take :parameters (?r ?x) :precondition (and (free ?r) (clear ?x)) :effect (and (held ?r ?x) (not (free ?r))))
          (:action put :parameters (?r ?x ?y) :precondition (and (held ?r ?x) (clear ?y))
            :effect (and (on ?x ?y) (free ?r) (not (held ?r ?x)) (not (clear ?y)))))";
        let domain = Domain::read(&Source::new("d", text), Dialect::default()).unwrap();
        let step = |line: &str| {
            let mut words = line.split(' ').map(str::to_owned);
            Step { action: words.next().unwrap(), arguments: words.collect(), start: None, duration: None }
        };
        let steps: Vec<Step> = ["take r a", "take s c", "put r a b", "put s c d", "take r e"].map(step).into();
        let structure = domain.structure(&steps);
        let link = |from: usize, to: usize, fact: &str| Link { from, to, fact: fact.to_owned() };
        assert_eq!(structure.links, [link(0, 2, "(held r a)"), link(1, 3, "(held s c)"), link(2, 4, "(free r)")]);
        assert_eq!(structure.order, [(0, 2), (1, 3), (2, 4)], "the robots do not wait for each other");
    }

    proptest! {
        #[test]
        fn a_pair_is_left_out_where_there_is_a_way_around_it(pairs in prop::collection::vec((0..9_usize, 0..9_usize), 0..40)) {
            let mut before = vec![Steps::new(9); 9];
            let pairs: Vec<(usize, usize)> = pairs.into_iter().filter(|(first, last)| first < last).collect();
            pairs.iter().for_each(|(first, last)| before[*first].insert(*last));
            let reduced = reduced(&before);
            // Whether the second is behind the first, by these pairs without one.
            let leads = |pairs: &[(usize, usize)], without: Option<(usize, usize)>, from: usize, to: usize| {
                let mut reached = vec![from];
                for step in from..9 {
                    let is_next = |first: &usize| pairs.contains(&(*first, step)) && Some((*first, step)) != without;
                    if reached.iter().any(is_next) {
                        reached.push(step);
                    }
                }
                reached[1..].contains(&to)
            };
            for &(first, last) in &pairs {
                prop_assert!(leads(&reduced, None, first, last), "{:?} is lost in {:?}", (first, last), reduced);
            }
            for &(first, last) in &reduced {
                prop_assert!(pairs.contains(&(first, last)));
                prop_assert!(!leads(&reduced, Some((first, last)), first, last), "{:?} is not needed", (first, last));
            }
        }
    }
}
