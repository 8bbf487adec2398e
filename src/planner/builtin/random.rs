//! Small tasks that look random and are the same in every run: each plan for them has to hold by the rules of the validator.

use ferroplan::parser::{parse_domain, parse_problem};

use super::classical::{self, Message, Numeric};
use super::convert::convert;
use super::judge::Judge;
use super::options::Options;
use super::search::{Ground, ground};
use super::temporal;

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

    /// So many texts, one after the other.
    fn some(&mut self, most: usize, mut each: impl FnMut(&mut Self) -> String) -> String {
        (0..self.roll(most + 1)).map(|_| each(self)).collect::<Vec<_>>().join(" ")
    }

    fn atom(&mut self) -> String {
        self.one(&["(p ?x)", "(p ?y)", "(q ?x)", "(q a)", "(z)", "(p b)"]).to_owned()
    }

    fn literal(&mut self) -> String {
        let atom = self.atom();
        if self.roll(5) < 2 { format!("(not {atom})") } else { atom }
    }

    /// A condition that is made of literals.
    fn formula(&mut self) -> String {
        match self.roll(8) {
            0 => format!("(exists (?u) (or (p ?u) {}))", self.literal()),
            1 => format!("(forall (?u) (or (q ?u) {}))", self.literal()),
            2 => format!("(or {} {})", self.literal(), self.literal()),
            _ => self.literal(),
        }
    }

    fn function(&mut self) -> &'static str {
        self.one(&["(f ?x)", "(f a)", "(f ?y)", "(g)", "(h)"])
    }

    fn amount(&mut self, depth: usize) -> String {
        match self.roll(if depth == 0 { 5 } else { 8 }) {
            0..=2 => self.one(&["0", "1", "2", "-1", "0.5", "3"]).to_owned(),
            3 | 4 => self.function().to_owned(),
            _ => format!("({} {} {})", self.one(&["+", "-", "*", "/"]), self.amount(depth - 1), self.amount(depth - 1)),
        }
    }

    fn comparison(&mut self) -> String {
        let compared = format!("({} {} {})", self.one(&["<", "<=", ">", ">=", "="]), self.function(), self.amount(1));
        if self.roll(4) == 0 { format!("(not {compared})") } else { compared }
    }

    fn numeric_condition(&mut self) -> String {
        if self.roll(2) == 0 { self.comparison() } else { self.formula() }
    }

    fn numeric_effect(&mut self) -> String {
        let change = |dice: &mut Self| {
            let how = dice.one(&["increase", "increase", "decrease", "assign", "scale-up", "scale-down"]);
            format!("({how} {} {})", dice.function(), dice.amount(1))
        };
        match self.roll(8) {
            0 => format!("(when {} {})", self.numeric_condition(), change(self)),
            1 => format!("(when {} {})", self.numeric_condition(), self.literal()),
            2 => "(forall (?u) (increase (f ?u) 1))".to_owned(),
            3 | 4 => self.literal(),
            _ => change(self),
        }
    }

    fn init(&mut self) -> String {
        ["(p a)", "(p b)", "(q a)", "(q b)", "(z)"].into_iter().filter(|_| self.roll(3) == 0).collect()
    }

    fn goal(&mut self) -> String {
        let ground = |text: String| text.replace("?x", "a").replace("?y", "b");
        let (one, other) = (ground(self.literal()), ground(self.formula()));
        format!("(and {one} {other})")
    }
}

const HEAD: &str = "(define (domain d) (:requirements :adl :fluents :durative-actions :timed-initial-literals
    :duration-inequalities) (:predicates (p ?x) (q ?x) (z)) (:functions (f ?x) (g) (h))";

fn numeric(seed: u64) -> (String, String) {
    let mut dice = Dice(seed);
    for _ in 0..4 {
        dice.roll(2);
    }
    let actions: Vec<String> = (0..1 + dice.roll(4))
        .map(|number| {
            let condition = dice.some(2, Dice::numeric_condition);
            let effect = format!("{} {}", dice.numeric_effect(), dice.some(2, Dice::numeric_effect));
            format!("(:action act{number} :parameters (?x ?y) :precondition (and {condition}) :effect (and {effect}))")
        })
        .collect();
    let values = ["(f a)", "(f b)", "(g)", "(h)"].map(|function| match dice.roll(4) {
        0 => String::new(),
        _ => format!("(= {function} {})", dice.one(&["0", "1", "2", "-1", "0.5"])),
    });
    let goal = match dice.roll(2) {
        0 => dice.comparison().replace("?x", "a").replace("?y", "b"),
        _ => dice.goal(),
    };
    let (init, values) = (dice.init(), values.concat());
    let problem =
        format!("(define (problem r) (:domain d) (:objects a b) (:init {init} {values}) (:goal (and {goal})))");
    (format!("{HEAD} {})", actions.join(" ")), problem)
}

fn timed(seed: u64) -> (String, String) {
    let mut dice = Dice(seed);
    for _ in 0..4 {
        dice.roll(2);
    }
    let condition = |dice: &mut Dice| {
        let moment = dice.one(&["at start", "over all", "over all", "at end"]);
        format!("({moment} {})", if dice.roll(4) == 0 { "(w ?x)".to_owned() } else { dice.formula() })
    };
    let effect = |dice: &mut Dice| {
        let moment = dice.one(&["at start", "at end"]);
        match dice.roll(16) {
            0 => format!("({moment} (when {} {}))", dice.literal(), dice.literal()),
            1 => format!("({moment} (forall (?u) (not (p ?u))))"),
            _ => format!("({moment} {})", dice.literal()),
        }
    };
    let actions: Vec<String> = (0..1 + dice.roll(4))
        .map(|number| {
            let duration = match dice.roll(16) {
                0 => "(= ?duration 0)",
                1 => "(= ?duration (- 1 3))",
                2 | 3 => "(and (>= ?duration 4) (<= ?duration 3))",
                4 | 5 => "(and (>= ?duration 1) (<= ?duration (g)))",
                6 | 7 => "(= ?duration (f ?x))",
                8 => "(<= ?duration 2.5)",
                _ => dice.one(&["(= ?duration 1)", "(= ?duration 2)"]),
            };
            let conditions = dice.some(2, condition);
            let effects = format!("{} {}", effect(&mut dice), dice.some(3, effect));
            format!(
                "(:durative-action act{number} :parameters (?x ?y) :duration {duration}
                :condition (and {conditions}) :effect (and {effects}))"
            )
        })
        .collect();
    let windows = dice.some(3, |dice| {
        let fact = dice.one(&["(w a)", "(w b)", "(not (w a))"]);
        format!("(at {} {fact})", dice.one(&["0", "1", "2", "2.001", "3", "5"]))
    });
    let (init, goal) = (dice.init(), dice.goal());
    let head = HEAD.replace("(z))", "(z) (w ?x))");
    let problem = format!(
        "(define (problem r) (:domain d) (:objects a b)
        (:init {init} (w b) (= (f a) 1) (= (g) 3) {windows}) (:goal {goal}))"
    );
    (format!("{head} {})", actions.join(" ")), problem)
}

/// Asserts that a plan holds.
fn holds((domain, problem): &(String, String), plan: &ferroplan::Plan) {
    let mut judge = Judge::new(domain, problem);
    assert!(judge.allows(plan), "{:?}\n{domain}\n{problem}\n{plan:?}", judge.fault);
}

/// The most tasks without a plan that ferroplan is asked about, as it takes its time.
const MOST: usize = 4;

/// Whether ferroplan finds a plan that holds.
fn has_plan((domain, problem): &(String, String)) -> bool {
    let solution = ferroplan::solve(domain, problem, &ferroplan::Options::default()).ok();
    let plan = solution.and_then(|solution| solution.plan.filter(|_| solution.solved));
    plan.is_some_and(|plan| Judge::new(domain, problem).is_valid(&plan))
}

#[test]
fn plans_with_numbers_hold_and_what_is_refuted_has_none() {
    let (mut solved, mut refuted) = (0, 0);
    for task in (0..1500).map(numeric) {
        let (domain, problem) = (parse_domain(&task.0).unwrap(), parse_problem(&task.1).unwrap());
        let Ok(lifted) = convert(&domain, &problem) else { continue };
        let Ok(Ground::Task(ground)) = ground(&lifted, 1 << 22, &mut |_, _| {}) else { continue };
        let mut best = None;
        let found = classical::numeric(&ground, 1 << 17, 0, Options::default(), &mut |message| {
            if let Message::Plan(plan) = message {
                holds(&task, plan);
                best = Some(plan.length);
            }
        });
        solved += usize::from(found == Numeric::Solved && best.is_some_and(|length| length > 0));
        if let Numeric::None(_) = classical::refuted(&ground, 1 << 17, 1 << 14, &mut |_| {}) {
            assert!(best.is_none(), "{task:?}");
            refuted += 1;
            assert!(refuted > MOST || !has_plan(&task), "{task:?}");
        }
    }
    assert!(solved > 60 && refuted > 60, "{solved} {refuted}");
}

#[test]
fn plans_with_times_hold_and_what_is_refuted_has_none() {
    let (mut solved, mut refuted) = (0, 0);
    for task in (0..1500).map(timed) {
        let (domain, problem) = (parse_domain(&task.0).unwrap(), parse_problem(&task.1).unwrap());
        let mut best = None;
        temporal::plan(&domain, &problem, Options::default(), 1 << 17, &mut |message| {
            let Message::Plan(plan) = message else { return };
            holds(&task, plan);
            best = Some(plan.length);
        });
        solved += usize::from(best.is_some_and(|length| length > 0));
        if temporal::refuted(&domain, &problem, 1 << 17, 1 << 14).is_some() {
            refuted += 1;
            assert!(best.is_none() && (refuted > MOST || !has_plan(&task)), "{task:?}");
        }
    }
    assert!(solved > 60 && refuted > 15, "{solved} {refuted}");
}
