//! Names that every planner understands, and the way back.
//!
//! FF drops characters it does not know, so that objects `1a` and `2a` both become
//! `A`; other planners stop at a dot. What is sent has only names `[a-z][a-z0-9_-]*`.
//! Names that are that already, but for case, stay; others get a name of their own.
//! The plan comes back in the spelling of the domain and the problem; where they
//! differ, the problem's wins.

use std::collections::{HashMap, HashSet};

use crate::formats::pddl::ast::{Domain, Problem};
use crate::formats::plan::Action;
use crate::pddl::Step;

/// The longest name that is sent; some planners have buffers of fixed size.
const LONGEST: usize = 100;

/// Names that planners add to a task themselves: a task that has them means something else.
const ADDED: [&str; 2] = ["reach-goal", "traj-end"];

/// A task as it is sent, and the way back.
#[derive(Debug, Clone, PartialEq)]
pub struct Sent {
    /// The domain's text.
    pub domain: String,
    /// The problem's text.
    pub problem: String,
    actions: HashMap<String, String>,
    objects: HashMap<String, String>,
}

/// Writes a task in names that every planner understands. Of the requirements only those
/// in `known` are written, where that is given; keywords count without regard to case.
#[must_use]
pub fn send(domain: &Domain, problem: &Problem, known: Option<&[&str]>) -> Sent {
    let mut writer = Writer::new(domain, problem, known);
    let domain_text = writer.write(&domain.to_string());
    let problem_text = writer.write(&problem.to_string());
    let actions = domain.actions.iter().map(|action| &action.name);
    let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
    let constants = domain.constants.iter().map(|constant| &constant.name);
    let objects = constants.chain(problem.objects.iter().map(|object| &object.name));
    let back = |name: &str| (writer.sent(name), name.to_owned());
    Sent {
        actions: actions.map(|name| back(name.as_str())).collect(),
        objects: objects.map(|name| back(name.as_str())).collect(),
        domain: domain_text,
        problem: problem_text,
    }
}

impl Sent {
    /// An action of the planner's in the task's own spelling. A name that was never sent
    /// stays as it is.
    #[must_use]
    pub fn restore(&self, action: &Action) -> Step {
        let back = |names: &HashMap<String, String>, name: &String| {
            names.get(&name.to_lowercase()).cloned().unwrap_or_else(|| name.clone())
        };
        Step {
            action: back(&self.actions, &action.name),
            arguments: action.arguments.iter().map(|argument| back(&self.objects, argument)).collect(),
            start: action.start,
            duration: action.duration,
        }
    }
}

/// Rewrites PDDL, word by word.
struct Writer<'a> {
    known: Option<&'a [&'a str]>,
    /// Names that read as numbers. They are names where a predicate or a function
    /// applies to them, and in lists of names.
    numbers: HashSet<String>,
    /// What applies to arguments.
    applied: HashSet<String>,
    /// Lower-case names to what is sent for them, where that is something else.
    renamed: HashMap<String, String>,
    taken: HashSet<String>,
}

impl<'a> Writer<'a> {
    fn new(domain: &Domain, problem: &Problem, known: Option<&'a [&'a str]>) -> Self {
        let predicates = domain.predicates.iter().chain(domain.derived.iter().map(|derived| &derived.head));
        let functions = domain.functions.iter().map(|function| &function.signature);
        let applied: HashSet<String> =
            predicates.chain(functions).map(|signature| signature.name.as_str().to_lowercase()).collect();
        let names = domain.types.iter().chain(&domain.constants).chain(&problem.objects).map(|typed| &typed.name);
        let numbers = names.clone().map(|name| name.as_str().to_lowercase()).filter(|name| is_number(name)).collect();
        let actions = domain.actions.iter().map(|action| &action.name);
        let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
        let names = names.chain(actions).map(|name| name.as_str().to_lowercase()).chain(applied.iter().cloned());
        let taken =
            names.filter(|name| is_plain(name)).chain(ADDED.map(str::to_owned)).chain(["object".to_owned()]).collect();
        Self { known, numbers, applied, renamed: HashMap::new(), taken }
    }

    /// What is sent for a name that has been written.
    fn sent(&self, name: &str) -> String {
        let name = name.to_lowercase();
        self.renamed.get(&name).cloned().unwrap_or(name)
    }

    fn write(&mut self, text: &str) -> String {
        let mut written = String::with_capacity(text.len());
        let mut heads: Vec<Option<&str>> = Vec::new();
        let mut rest = text;
        while let Some(first) = rest.chars().next() {
            let length = match first {
                '(' | ')' => 1,
                c if c.is_whitespace() => c.len_utf8(),
                _ => rest.find(|c: char| c == '(' || c == ')' || c.is_whitespace()).unwrap_or(rest.len()),
            };
            let (word, after) = rest.split_at(length);
            rest = after;
            match first {
                '(' => heads.push(None),
                ')' => {
                    if heads.pop().flatten().is_some_and(|head| head == ":requirements")
                        && written.ends_with(":requirements")
                    {
                        written.push_str(" :strips");
                    }
                }
                c if c.is_whitespace() => {}
                _ => {
                    let head = heads.last().copied().flatten();
                    if head == Some(":requirements") && !self.is_known(word) {
                        written.truncate(written.trim_end().len());
                        continue;
                    }
                    if let Some(slot @ None) = heads.last_mut() {
                        *slot = Some(word);
                    }
                    written.push_str(&self.word(word, head));
                    continue;
                }
            }
            written.push_str(word);
        }
        written
    }

    fn is_known(&self, requirement: &str) -> bool {
        self.known.is_none_or(|known| known.iter().any(|known| known.eq_ignore_ascii_case(requirement)))
    }

    /// What is written for a word in a list that starts with `head`.
    fn word(&mut self, word: &str, head: Option<&str>) -> String {
        let lower = word.to_lowercase();
        if word.starts_with(':') || word == "-" || word == "#t" || is_operator(word) {
            return lower;
        }
        if let Some(variable) = lower.strip_prefix('?') {
            return match is_plain(variable) {
                true => lower,
                false => format!("?{}", self.rename(&lower)),
            };
        }
        let listed = || head.is_some_and(|head| [":objects", ":constants", ":types", "either"].contains(&head));
        let applied = || head.is_some_and(|head| self.applied.contains(&head.to_lowercase()));
        let number = is_number(word) && !(listed() || applied() && self.numbers.contains(&lower));
        if number || is_plain(&lower) && !ADDED.contains(&lower.as_str()) {
            return lower;
        }
        self.rename(&lower)
    }

    fn rename(&mut self, name: &str) -> String {
        if let Some(known) = self.renamed.get(name) {
            return known.clone();
        }
        let plain = name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '_' });
        let stem: String = plain.skip_while(|c| !c.is_ascii_alphanumeric()).take(LONGEST / 2).collect();
        let stem = if stem.starts_with(|c: char| c.is_ascii_lowercase()) { stem } else { format!("n{stem}") };
        let mut candidate = stem.clone();
        let mut number = 1_usize;
        while !self.taken.insert(candidate.clone()) {
            number += 1;
            candidate = format!("{stem}-{number}");
        }
        self.renamed.insert(name.to_owned(), candidate.clone());
        candidate
    }
}

/// Whether every planner reads the (lower-case) name as it is.
fn is_plain(name: &str) -> bool {
    name.len() <= LONGEST
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-')
}

fn is_operator(word: &str) -> bool {
    ["=", "<", "<=", ">", ">=", "+", "*", "/"].contains(&word)
}

fn is_number(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && word.parse::<f64>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::{Dialect, read_domain, read_problem};

    fn task(domain: &str, problem: &str) -> (Domain, Problem) {
        let domain = read_domain(&Source::new("d", domain), Dialect::default()).unwrap();
        (domain, read_problem(&Source::new("p", problem), Dialect::default()).unwrap())
    }

    const DOMAIN: &str = "(define (domain nm) (:requirements :strips :typing :action-costs) (:types t)
        (:constants Base - t) (:predicates (p ?x - t) (q ?x - t))
        (:action Go-To :parameters (?X - t) :precondition (p ?X) :effect (q ?X)))";

    #[test]
    fn distinct_names_stay_distinct() {
        let (domain, problem) = task(
            DOMAIN,
            "(define (problem n) (:domain nm) (:objects r1a x.y x_y G-h - t) (:init (p x.y)) (:goal (q x_y)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(sent.problem.contains("(p x_y-2)") && sent.problem.contains("(q x_y)"), "{}", sent.problem);
        assert!(sent.problem.contains("g-h"), "{}", sent.problem);
    }

    #[test]
    fn a_plan_comes_back_in_the_tasks_spelling() {
        let (domain, problem) =
            task(DOMAIN, "(define (problem n) (:domain nm) (:objects x.y G-h - t) (:init) (:goal (q G-h)))");
        let sent = send(&domain, &problem, None);
        let action = |name: &str, argument: &str| Action {
            name: name.to_owned(),
            arguments: vec![argument.to_owned()],
            start: None,
            duration: None,
            line: 1,
        };
        let step = sent.restore(&action("GO-TO", "G-H"));
        assert_eq!((step.action.as_str(), step.arguments[0].as_str()), ("Go-To", "G-h"));
        assert_eq!(sent.restore(&action("go-to", "x_y")).arguments, ["x.y"]);
        assert_eq!(sent.restore(&action("go-to", "BASE")).arguments, ["Base"]);
        assert_eq!(sent.restore(&action("go-to", "NEVER")).arguments, ["NEVER"]);
    }

    #[test]
    fn unknown_requirements_are_dropped() {
        let (domain, problem) = task(DOMAIN, "(define (problem n) (:domain nm) (:init) (:goal (and)))");
        let sent = send(&domain, &problem, Some(&[":strips", ":typing"]));
        assert!(sent.domain.contains("(:requirements :strips :typing)"), "{}", sent.domain);
        let sent = send(&domain, &problem, Some(&[":none"]));
        assert!(sent.domain.contains("(:requirements :strips)"), "{}", sent.domain);
    }

    #[test]
    fn numbers_stay_numbers_and_names_of_digits_become_names() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :timed-initial-literals :fluents) (:predicates (at ?x) (open))
               (:functions (f ?x)) (:action reach-goal :parameters (?a) :effect (increase (f ?a) 2)))",
            "(define (problem n) (:domain d) (:objects 1a 7up) (:init (at 5 (open)) (= (f 1a) 5) (at 7up)) (:goal (open)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(!sent.problem.contains("1a 7up"), "{}", sent.problem);
        assert!(sent.problem.contains("(at 5 (open))") && sent.problem.contains("(= (f n1a) 5)"), "{}", sent.problem);
        assert!(sent.domain.contains("(:action reach-goal-2") && sent.domain.contains("(increase (f ?a) 2)"));
    }

    #[test]
    fn what_is_sent_reads_back() {
        let (domain, problem) = task(
            DOMAIN,
            "(define (problem n) (:domain nm) (:objects x.y G-h - t) (:init (p x.y)) (:goal (not (q G-h))))",
        );
        let sent = send(&domain, &problem, None);
        let _ = task(&sent.domain, &sent.problem);
    }
}
