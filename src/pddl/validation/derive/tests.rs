//! Rules that look random and are the same in every run, solved by joins and by trying everything.

use std::collections::{HashMap, HashSet};

use crate::formats::Source;
use crate::formats::pddl::Dialect;
use crate::pddl::domain::Domain;
use crate::pddl::model::Rule;
use crate::pddl::problem::Problem;
use crate::pddl::validation::state::{Bindings, Ground, State};
use crate::pddl::validation::stratum::predicates;

/// Numbers that look random.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % sides
    }

    fn one<'t>(&mut self, texts: &[&'t str]) -> &'t str {
        texts[self.roll(texts.len())]
    }

    fn kind(&mut self) -> &'static str {
        self.one(&["", " - t", " - u", " - (either t v)"])
    }

    fn formula(&mut self, depth: usize, variables: &mut Vec<String>) -> String {
        let term = |dice: &mut Self| {
            let place = dice.roll(variables.len() + 1);
            variables.get(place).cloned().unwrap_or_else(|| "a".to_owned())
        };
        match self.roll(if depth == 0 { 7 } else { 14 }) {
            0..=4 => {
                let name = self.one(&["p", "q", "r", "d", "e", "f", "g"]);
                match name {
                    "p" | "d" => format!("({name} {})", term(self)),
                    "g" => "(g)".to_owned(),
                    _ => format!("({name} {} {})", term(self), term(self)),
                }
            }
            5 => format!("(= {} {})", term(self), term(self)),
            6 => format!("(not (q {} {}))", term(self), term(self)),
            7 | 8 => format!("(and {})", self.formulas(depth, variables)),
            9 | 10 => format!("(or {})", self.formulas(depth, variables)),
            11 => format!("(not {})", self.formula(depth - 1, variables)),
            12 => self.quantified("exists", depth, variables),
            _ => match self.roll(3) {
                0 => self.quantified("forall", depth, variables),
                1 => format!("(imply {})", [(); 2].map(|()| self.formula(depth - 1, variables)).join(" ")),
                _ => self.quantified("exists", depth, variables),
            },
        }
    }

    fn formulas(&mut self, depth: usize, variables: &mut Vec<String>) -> String {
        (0..=self.roll(3)).map(|_| self.formula(depth - 1, variables)).collect::<Vec<_>>().join(" ")
    }

    fn quantified(&mut self, word: &str, depth: usize, variables: &mut Vec<String>) -> String {
        let name = format!("?v{}", variables.len());
        let kind = self.kind();
        variables.push(name.clone());
        let inner = self.formula(depth - 1, variables);
        variables.pop();
        format!("({word} ({name}{kind}) {inner})")
    }

    fn domain(&mut self) -> String {
        let mut rules = String::new();
        for _ in 0..3 + self.roll(4) {
            let name = self.one(&["d", "e", "f", "g"]);
            let count = ["g", "d", "e"].iter().position(|other| *other == name).unwrap_or(2);
            let mut variables: Vec<String> = (0..count).map(|number| format!("?v{number}")).collect();
            let head: Vec<String> = variables.iter().map(|variable| format!("{variable}{}", self.kind())).collect();
            let body = self.formula(3, &mut variables);
            rules += &format!("(:derived ({name} {}) {body})\n", head.join(" "));
        }
        format!(
            "(define (domain d) (:types t u v) (:constants a - t)
            (:predicates (p ?x) (q ?x ?y) (r ?x ?y) (d ?x) (e ?x ?y) (f ?x ?y) (g)) {rules})"
        )
    }

    fn problem(&mut self) -> String {
        let objects = ["a", "b", "c", "w", "z"];
        let facts = (0..self.roll(14)).map(|_| match self.roll(4) {
            0 => format!("(p {})", self.one(&objects)),
            number => format!("({} {} {})", ["q", "r", "q"][number - 1], self.one(&objects), self.one(&objects)),
        });
        let facts: String = facts.collect();
        format!("(define (problem x) (:domain d) (:objects b - t c - u w z - v) (:init {facts}) (:goal (and)))")
    }
}

/// Applies all rules to all objects until nothing is new, from the predicates without negations up.
fn naive(state: &State<'_>) -> HashSet<Ground> {
    let rules = &state.domain.rules;
    let mut levels: HashMap<u32, usize> = rules.iter().map(|rule| (rule.predicate, 0)).collect();
    for _ in 0..rules.len() * rules.len() + 1 {
        for rule in rules {
            let mut level = levels[&rule.predicate];
            predicates(&rule.condition, &mut |predicate, negated| {
                level = level.max(levels.get(&predicate).map_or(0, |below| below + usize::from(negated)));
            });
            levels.insert(rule.predicate, level);
        }
    }
    state.derived.replace(Some(HashSet::new()));
    state.deriving.set(true);
    for level in 0..=rules.len() {
        let now: Vec<&Rule> = rules.iter().filter(|rule| levels[&rule.predicate] == level).collect();
        while now.iter().filter(|rule| apply_everywhere(state, rule)).count() > 0 {}
    }
    state.deriving.set(false);
    state.derived.take().unwrap_or_default()
}

/// Whether a rule has made something new.
fn apply_everywhere(state: &State<'_>, rule: &Rule) -> bool {
    let mut found = Vec::new();
    let mut all = vec![Bindings::new()];
    for variable in &rule.variables {
        let members = state.members(&variable.kind);
        all = all.iter().flat_map(|chosen| members.iter().map(|object| [&chosen[..], &[*object]].concat())).collect();
    }
    for mut objects in all {
        let fact: Ground = [&[rule.predicate], &objects[..]].concat().into();
        if state.is_true(&rule.condition, &mut objects).unwrap() {
            found.push(fact);
        }
    }
    let mut derived = state.derived.borrow_mut();
    let derived = derived.as_mut().unwrap();
    found.into_iter().filter(|fact| derived.insert(fact.clone())).count() > 0
}

#[test]
fn joins_derive_what_trying_everything_does() {
    let mut dice = Dice(17);
    let (mut compared, mut derived) = (0, 0);
    while compared < 500 {
        let (domain_text, problem_text) = (dice.domain(), dice.problem());
        let source = |text: &str| Source::new("x.pddl", text);
        // Some depend on their own negations.
        let Ok(domain) = Domain::read(&source(&domain_text), Dialect::default()) else { continue };
        let problem = Problem::read(&source(&problem_text), &domain, Dialect::default()).unwrap();
        let state = State::new(&domain, &problem);
        let wanted = naive(&state);
        state.derive().unwrap();
        assert_eq!(state.derived.take(), Some(wanted.clone()), "{domain_text}\n{problem_text}");
        compared += 1;
        derived += wanted.len();
    }
    assert!(derived > 5 * compared, "{derived} facts in {compared} tasks");
}
