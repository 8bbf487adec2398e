//! Why the steps of a plan are in their order: causal links, and the partial order that they demand.
//!
//! A step that needs a fact, or that one is false, is linked to the last step before it that makes it so; without
//! one, it is so from the beginning. The partial order keeps two steps in the order of the plan where one needs what
//! the other changes, or where they change one fact in opposite ways (Bäckström 1998, deordering). What is looked
//! at are facts in conjunctions, with their times; steps with quantifiers, alternatives or conditional effects stay
//! where they are, so that the partial order never promises too much.

use super::Step;
use super::domain::Domain;
use super::model::{Arg, Change, Fact, Formula};
use super::table::Named as _;

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

/// What a ground step needs and does.
#[derive(Default)]
struct Ground {
    needs: Vec<Key>,
    adds: Vec<Key>,
    deletes: Vec<Key>,
    /// Whether it says more than facts in conjunctions.
    is_opaque: bool,
}

/// A ground literal: its predicate, its arguments in small letters, and whether the fact holds.
type Key = (u32, Vec<String>, bool);

impl Domain {
    /// The structure of a plan, as far as this domain knows its actions.
    #[must_use]
    pub fn structure(&self, steps: &[Step]) -> Structure {
        let ground: Vec<Ground> = steps.iter().map(|step| self.ground(step)).collect();
        let mut structure = Structure::default();
        let mut before = vec![vec![false; ground.len()]; ground.len()];
        for (to, step) in ground.iter().enumerate() {
            for need in &step.needs {
                if let Some(from) = (0..to).rev().find(|from| ground[*from].adds.contains(need)) {
                    structure.links.push(Link { from, to, fact: self.fact_text(need) });
                    before[from][to] = true;
                }
            }
            for (other, earlier) in ground.iter().enumerate().take(to) {
                let undoes = |facts: &[Key]| facts.iter().any(|fact| step.deletes.contains(fact));
                let is_opaque = step.is_opaque || earlier.is_opaque;
                before[other][to] |= is_opaque || undoes(&earlier.needs) || undoes(&earlier.adds);
            }
        }
        structure.order = reduced(before);
        structure
    }

    fn ground(&self, step: &Step) -> Ground {
        let mut ground = Ground::default();
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
            Formula::Timed(_, inner) => self.needs(inner, step, ground),
            Formula::Same(..) | Formula::Compare(..) | Formula::Preference(_) => {}
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
            Change::Timed(_, inner) => self.effects(inner, step, ground),
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

    fn fact_text(&self, (predicate, arguments, holds): &Key) -> String {
        let name = self.vocabulary.predicates.get(*predicate).map_or("", |entry| entry.name().as_str());
        let words: Vec<&str> = std::iter::once(name).chain(arguments.iter().map(String::as_str)).collect();
        let fact = format!("({})", words.join(" "));
        if *holds { fact } else { format!("(not {fact})") }
    }
}

/// The pairs that do not follow from others. Steps are in an order already.
fn reduced(mut before: Vec<Vec<bool>>) -> Vec<(usize, usize)> {
    let count = before.len();
    let direct = before.clone();
    for middle in 0..count {
        for first in 0..middle {
            if before[first][middle] {
                let (front, back) = before.split_at_mut(middle);
                for (known, further) in front[first].iter_mut().zip(&back[0]) {
                    *known |= further;
                }
            }
        }
    }
    let follows =
        |first: usize, last: usize| (first + 1..last).any(|middle| before[first][middle] && before[middle][last]);
    let pairs = (0..count).flat_map(|first| (first + 1..count).map(move |last| (first, last)));
    pairs.filter(|(first, last)| direct[*first][*last] && !follows(*first, *last)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::Dialect;

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
}
