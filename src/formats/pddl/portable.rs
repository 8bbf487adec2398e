//! Names that every planner understands, and the way back.
//!
//! FF drops characters it does not know, so that objects `1a` and `2a` both become
//! `A`; other planners stop at a dot. What is sent has only names `[a-z][a-z0-9_-]*`.
//! Names that are that already, but for case, stay; others get a name of their own. What some planners do not
//! read is written as all do: a function without arguments has its brackets, and what is false at the
//! beginning is left out.
//! The plan comes back in the spelling of the domain and the problem; where they
//! differ, the problem's wins.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::fmt::{self, Display, Write as _};
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::formats::pddl::ast::{Domain, Init, Problem};
use crate::formats::plan::Action;

/// The longest name that is sent; some planners have buffers of fixed size.
const LONGEST: usize = 100;

/// How much text is rewritten at once, in bytes.
const PIECE: usize = 1 << 16;

/// The type of what functions give. A type of that name, which tasks of the competition of 2004 have, is none
/// that Fast Downward reads.
const NUMBER: &str = "number";

/// Names that planners add to a task themselves: a task that has them means something else.
const ADDED: [&str; 3] = ["reach-goal", "traj-end", NUMBER];

/// What is followed by numbers. Objects may follow `=` as well.
const COUNTING: [&str; 13] =
    ["<", ">", "<=", ">=", "+", "-", "*", "/", "increase", "decrease", "assign", "scale-up", "scale-down"];

/// How long a plan takes: a function that no domain declares.
const TOTAL_TIME: &str = "total-time";

/// A task as it is sent, and the way back.
#[derive(Debug, Clone, PartialEq, Default)]
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
    // What is never interrupted is always written.
    try_send(domain, problem, known, &AtomicBool::new(false)).unwrap_or_default()
}

/// As [`send`]; nothing where `interrupted` becomes true before it is done.
pub(crate) fn try_send(
    domain: &Domain,
    problem: &Problem,
    known: Option<&[&str]>,
    interrupted: &AtomicBool,
) -> Option<Sent> {
    let mut writer = Writer::new(domain, problem, known);
    let domain_text = writer.write(domain, interrupted)?;
    let problem_text = writer.write(without_denials(problem).as_ref(), interrupted)?;
    let actions = domain.actions.iter().map(|action| &action.name);
    let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
    let constants = domain.constants.iter().map(|constant| &constant.name);
    let objects = constants.chain(problem.objects.iter().map(|object| &object.name));
    let back = |name: &str| (writer.sent(name), name.to_owned());
    Some(Sent {
        actions: actions.map(|name| back(name.as_str())).collect(),
        objects: objects.map(|name| back(name.as_str())).collect(),
        domain: domain_text,
        problem: problem_text,
    })
}

impl Sent {
    /// An action of the planner's in the task's own spelling. A name that was never sent
    /// stays as it is.
    #[must_use]
    pub fn restore(&self, action: &Action) -> Action {
        let back = |names: &HashMap<String, String>, name: &String| {
            names.get(&name.to_lowercase()).cloned().unwrap_or_else(|| name.clone())
        };
        Action {
            name: back(&self.actions, &action.name),
            arguments: action.arguments.iter().map(|argument| back(&self.objects, argument)).collect(),
            start: action.start,
            duration: action.duration,
            line: action.line,
        }
    }
}

/// The problem without the facts of which it says that they are not there, as if others were.
fn without_denials(problem: &Problem) -> Cow<'_, Problem> {
    let is_denial = |fact: &Init| matches!(fact, Init::Not(_));
    if !problem.init.iter().any(is_denial) {
        return Cow::Borrowed(problem);
    }
    Cow::Owned(Problem {
        name: problem.name.clone(),
        domain: problem.domain.clone(),
        requirements: problem.requirements.clone(),
        objects: problem.objects.clone(),
        init: problem.init.iter().filter(|fact| !is_denial(fact)).cloned().collect(),
        goal: problem.goal.clone(),
        constraints: problem.constraints.clone(),
        metric: problem.metric.clone(),
        length: problem.length.clone(),
        place: problem.place,
    })
}

/// Rewrites PDDL, word by word.
struct Writer<'a> {
    known: Option<&'a [&'a str]>,
    /// Names that read as numbers. They are names where a predicate or a function
    /// applies to them, and in lists of names.
    numbers: HashSet<String>,
    /// What applies to arguments.
    applied: HashSet<String>,
    /// Functions without arguments.
    constants: HashSet<String>,
    /// Those of them that are objects, too.
    ambiguous: HashSet<String>,
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
        let constants = domain.functions.iter().map(|function| &function.signature);
        let constants = constants.filter(|signature| signature.parameters.is_empty());
        let mut constants: HashSet<String> =
            constants.map(|signature| signature.name.as_str().to_lowercase()).collect();
        let names = domain.types.iter().chain(&domain.constants).chain(&problem.objects).map(|typed| &typed.name);
        constants.insert(TOTAL_TIME.to_owned());
        let objects = domain.constants.iter().chain(&problem.objects).map(|typed| typed.name.as_str().to_lowercase());
        let ambiguous = objects.filter(|name| constants.contains(name)).collect();
        let numbers = names.clone().map(|name| name.as_str().to_lowercase()).filter(|name| is_number(name)).collect();
        let actions = domain.actions.iter().map(|action| &action.name);
        let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
        let names = names.chain(actions).map(|name| name.as_str().to_lowercase()).chain(applied.iter().cloned());
        let taken =
            names.filter(|name| is_plain(name)).chain(ADDED.map(str::to_owned)).chain(["object".to_owned()]).collect();
        Self { known, numbers, applied, constants, ambiguous, renamed: HashMap::new(), taken }
    }

    /// What is sent for a name that has been written.
    fn sent(&self, name: &str) -> String {
        let name = name.to_lowercase();
        self.renamed.get(&name).cloned().unwrap_or(name)
    }

    fn write(&mut self, tree: &impl Display, interrupted: &AtomicBool) -> Option<String> {
        let mut rewrite = Rewrite {
            writer: self,
            interrupted,
            pending: String::with_capacity(2 * PIECE),
            written: String::new(),
            heads: Vec::new(),
        };
        write!(rewrite, "{tree}").ok()?;
        Some(rewrite.finish())
    }

    /// Whether a word in a list that starts with `head` is a function without its brackets.
    fn is_bare(&self, word: &str, head: Head) -> bool {
        if !matches!(head, Head::Counting | Head::Equal) {
            return false;
        }
        let name = word.to_lowercase();
        self.constants.contains(&name) && !(head == Head::Equal && self.ambiguous.contains(&name))
    }

    fn is_known(&self, requirement: &str) -> bool {
        self.known.is_none_or(|known| known.iter().any(|known| known.eq_ignore_ascii_case(requirement)))
    }

    /// What the first word of a list makes of its other words.
    fn head(&self, word: &str) -> Head {
        match word {
            ":requirements" => Head::Requirements,
            ":objects" | ":constants" | ":types" | "either" => Head::Names,
            ":functions" => Head::Functions,
            ":metric" => Head::Metric,
            "=" => Head::Equal,
            _ if COUNTING.iter().any(|counting| counting.eq_ignore_ascii_case(word)) => Head::Counting,
            // It matters only where a number is a name.
            _ if !self.numbers.is_empty() && self.applied.contains(&word.to_lowercase()) => Head::Applied,
            _ => Head::Other,
        }
    }

    /// What is written for a word in a list that starts with `head`.
    fn word(&mut self, word: &str, head: Head) -> String {
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
        let named = || head == Head::Names || head == Head::Applied && self.numbers.contains(&lower);
        let number = is_number(word) && !named();
        if number || is_plain(&lower) && !is_added(&lower, head) {
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

/// What the first word of a list says about the others.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Head {
    /// There is none yet.
    Missing,
    /// They are requirements.
    Requirements,
    /// They are names, even if they read as numbers.
    Names,
    /// They are functions and their types.
    Functions,
    /// They are arguments, where names may read as numbers.
    Applied,
    /// They are numbers, and functions whose values are.
    Counting,
    /// They are that, or objects.
    Equal,
    /// The first one is `minimize` or `maximize`.
    Metric,
    Other,
}

/// Rewrites a text as it comes, without ever having it as a whole.
struct Rewrite<'w, 'a> {
    writer: &'w mut Writer<'a>,
    interrupted: &'w AtomicBool,
    /// What has come and is not rewritten yet.
    pending: String,
    written: String,
    /// The lists that are open.
    heads: Vec<Head>,
}

impl fmt::Write for Rewrite<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.pending.push_str(text);
        if self.pending.len() < PIECE {
            return Ok(());
        }
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(fmt::Error);
        }
        // The last word may go on.
        let whole = self.pending.rfind(is_delimiter).unwrap_or(0);
        let mut text = mem::take(&mut self.pending);
        self.rewrite(text.get(..whole).unwrap_or_default());
        text.drain(..whole);
        self.pending = text;
        Ok(())
    }
}

impl Rewrite<'_, '_> {
    fn finish(mut self) -> String {
        let rest = mem::take(&mut self.pending);
        self.rewrite(&rest);
        self.written
    }

    fn rewrite(&mut self, mut rest: &str) {
        while let Some(first) = rest.chars().next() {
            let length = match is_delimiter(first) {
                true => first.len_utf8(),
                false => rest.find(is_delimiter).unwrap_or(rest.len()),
            };
            let (word, after) = rest.split_at(length);
            rest = after;
            match first {
                '(' => self.heads.push(Head::Missing),
                ')' => {
                    if self.heads.pop() == Some(Head::Requirements) && self.written.ends_with(":requirements") {
                        self.written.push_str(" :strips");
                    }
                }
                c if c.is_whitespace() => {}
                _ => {
                    self.word(word);
                    continue;
                }
            }
            self.written.push_str(word);
        }
    }

    fn word(&mut self, word: &str) {
        let head = self.heads.last().copied().unwrap_or(Head::Missing);
        if head == Head::Requirements && !self.writer.is_known(word) {
            self.written.truncate(self.written.trim_end().len());
            return;
        }
        if head == Head::Missing
            && let Some(slot) = self.heads.last_mut()
        {
            *slot = self.writer.head(word);
        }
        if head == Head::Metric
            && let Some(slot) = self.heads.last_mut()
        {
            *slot = Head::Counting;
        } else if self.writer.is_bare(word, head) {
            let _ = write!(self.written, "({})", self.writer.word(word, Head::Other));
            return;
        }
        let start = self.written.len();
        if is_plain_but_for_case(word) && !is_added(word, head) {
            self.written.push_str(word);
            if let Some(written) = self.written.get_mut(start..) {
                written.make_ascii_lowercase();
            }
        } else {
            self.written.push_str(&self.writer.word(word, head));
        }
    }
}

fn is_delimiter(c: char) -> bool {
    c == '(' || c == ')' || c.is_whitespace()
}

/// Whether planners have another meaning for the name, in a list that starts with `head`.
fn is_added(name: &str, head: Head) -> bool {
    let is_meant = head == Head::Functions && name.eq_ignore_ascii_case(NUMBER);
    !is_meant && ADDED.iter().any(|added| added.eq_ignore_ascii_case(name))
}

/// Whether every planner reads the name as it is, once it is in lower case.
fn is_plain_but_for_case(name: &str) -> bool {
    name.len() <= LONGEST
        && name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'-')
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
        assert_eq!((step.name.as_str(), step.arguments[0].as_str()), ("Go-To", "G-h"));
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
    fn a_type_that_is_called_number_is_not_the_one_of_functions() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :typing :fluents) (:types number place) (:predicates (near ?n - number))
               (:functions (f ?n - number) - number) (:action a :parameters (?n - number) :effect (near ?n)))",
            "(define (problem n) (:domain d) (:objects one - number) (:init (= (f one) 5)) (:goal (near one)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(
            sent.domain.contains("number-2 place") && sent.domain.contains("(f ?n - number-2) - number"),
            "{}",
            sent.domain
        );
        assert!(sent.problem.contains("one - number-2"), "{}", sent.problem);
    }

    #[test]
    fn what_some_planners_do_not_read_is_written_as_all_do() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :fluents) (:predicates (p) (q)) (:functions (used) (unused))
               (:action a :parameters () :precondition (< used 5) :effect (and (p) (increase Used (+ used 1)))))",
            "(define (problem n) (:domain d) (:objects unused) (:init (not (p)) (q) (= used 0)) (:goal (p)) (:metric minimize used))",
        );
        let sent = send(&domain, &problem, None);
        assert!(
            sent.domain.contains("(< (used) 5)") && sent.domain.contains("(increase (used) (+ (used) 1))"),
            "{}",
            sent.domain
        );
        assert!(sent.problem.contains("(= (used) 0)") && sent.problem.contains("minimize (used)"), "{}", sent.problem);
        assert!(!sent.problem.contains("not"), "{}", sent.problem);
        assert!(sent.problem.contains("(q)") && sent.problem.contains(":objects unused"), "{}", sent.problem);
    }

    #[test]
    fn a_function_may_be_called_as_anything_else_is() {
        let (domain, problem) = task(
            "(define (domain d) (:requirements :typing :fluents) (:types fuel place) (:predicates (p))
               (:functions (fuel) (used) (minimize))
               (:action a :parameters (?x - place) :precondition (and (>= fuel 1) (< USED 3)) :effect (decrease fuel 1)))",
            "(define (problem n) (:domain d) (:objects used - place) (:init (= (used) 0)) (:goal (p))
               (:metric minimize (+ minimize total-time)))",
        );
        let sent = send(&domain, &problem, None);
        assert!(sent.domain.contains("(>= (fuel) 1)") && sent.domain.contains("(< (used) 3)"), "{}", sent.domain);
        assert!(sent.domain.contains("(decrease (fuel) 1)") && sent.domain.contains("fuel place"), "{}", sent.domain);
        assert!(sent.problem.contains("(:metric minimize (+ (minimize) (total-time)))"), "{}", sent.problem);
    }

    #[test]
    fn a_long_task_is_rewritten_as_a_short_one() {
        let objects: Vec<String> = (0..40_000).map(|number| format!("Ob.{number} x{number}")).collect();
        let text =
            format!("(define (problem n) (:domain nm) (:objects {} - t) (:init) (:goal (q x7)))", objects.join(" "));
        let (domain, problem) = task(DOMAIN, &text);
        let sent = send(&domain, &problem, None);
        assert!(sent.problem.len() > 4 * PIECE);
        let (_, read) = task(&sent.domain, &sent.problem);
        let names: Vec<String> = (0..40_000).map(|number| format!("ob_{number} x{number}")).collect();
        let read: Vec<&str> = read.objects.iter().map(|object| object.name.as_str()).collect();
        assert_eq!(read.join(" "), names.join(" "));
    }

    #[test]
    fn writing_ends_when_it_is_interrupted() {
        let objects: Vec<String> = (0..40_000).map(|number| format!("x{number}")).collect();
        let text =
            format!("(define (problem n) (:domain nm) (:objects {} - t) (:init) (:goal (q x7)))", objects.join(" "));
        let (domain, problem) = task(DOMAIN, &text);
        assert_eq!(try_send(&domain, &problem, None, &AtomicBool::new(true)), None);
        assert!(try_send(&domain, &problem, None, &AtomicBool::new(false)).is_some());
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
