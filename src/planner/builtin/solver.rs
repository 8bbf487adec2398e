//! A task solved in this process, printed as FF prints it.

use std::cell::RefCell;
use std::sync::mpsc;
use std::thread;

use ferroplan::types::{Domain, Problem};
use ferroplan::{Options as Settings, Plan, SolveError, parser, pddl3};

use super::classical::{self, Answer, Message, Numeric};
use super::ff_output::{self, NoPlan};
use super::judge::Judge;
use super::options::Options;
use super::{Builtin, REQUIREMENTS, compared, portfolio, proof, temporal};
use crate::formats::pddl::portable::{self, Sent};
use crate::planner::capabilities::refuse;
use crate::planner::task::Task;

/// ferroplan grounds and searches with recursion over formulas.
const STACK: usize = 64 << 20;

/// Plans, and says what FF says, piece by piece; returns the exit code of [`crate::planner::Outcome`]. What
/// ferroplan cannot do is refused with the line, and the plan has the names of the task.
pub fn solve(task: &Task<'_>, options: Options, say: &mut dyn FnMut(&str)) -> i32 {
    say(&ff_output::preface(task.domain.name(), task.problem.name()));
    if let Some(refusal) = refuse(&Builtin::default(), task) {
        say(&format!("\nff: {refusal}\n"));
        return 34;
    }
    let (domain, problem) = portable::simplified(task.domain.tree(), task.problem.tree());
    let sent = portable::send(&domain, &problem, Some(&REQUIREMENTS));
    apart(&sent.domain, &sent.problem, options, Some(&sent), say)
}

/// As [`solve`], for the texts of a task that is known to be well-formed: they go to
/// ferroplan as they are (3 where it cannot read them all the same).
pub fn child(domain: &str, problem: &str, options: Options, say: &mut dyn FnMut(&str)) -> i32 {
    apart(domain, problem, options, None, say)
}

/// Solves the task on a stack of its own.
fn apart(domain: &str, problem: &str, options: Options, sent: Option<&Sent>, say: &mut dyn FnMut(&str)) -> i32 {
    let (sender, texts) = mpsc::channel::<String>();
    thread::scope(|scope| {
        let work = move || {
            // The receiver is gone only when this process ends.
            let send = |text: String| drop(sender.send(text));
            let report = &mut |message: Message<'_>| match message {
                Message::Plan(plan) => send(ff_output::plan(plan, sent)),
                Message::Progress(words) => send(ff_output::progress(&words)),
            };
            match answer(domain, problem, options, report) {
                Ok(None) => 0,
                Ok(Some(reason)) => {
                    let (text, code) = ff_output::no_plan(&reason);
                    send(text);
                    code
                }
                Err(error) => {
                    let (text, code) = ff_output::refusal(&error);
                    send(text);
                    code
                }
            }
        };
        let work = match thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work) {
            Ok(work) => work,
            // A thread that cannot be had lacks the memory for its stack.
            Err(error) => {
                say(&format!("\nmemory allocation of {STACK} bytes for the stack failed: {error}\n"));
                return 22;
            }
        };
        texts.iter().for_each(|text| say(&text));
        work.join().unwrap_or_else(|_| {
            say("\nthe planner crashed\n");
            32
        })
    })
}

/// Passes on the plans that hold: each at once, or the last one at the end.
struct Reporter<'t, 'r> {
    judge: Option<Judge<'t>>,
    says_each: bool,
    has_plan: bool,
    last: Option<Plan>,
    /// When the best plan with times ends.
    earliest: Option<f64>,
    report: &'r mut dyn FnMut(Message<'_>),
}

impl Reporter<'_, '_> {
    fn send(&mut self, message: Message<'_>) {
        if let Message::Plan(plan) = message {
            if self.judge.as_mut().is_some_and(|judge| !judge.allows(plan)) {
                return;
            }
            self.has_plan = true;
            let shorter = self.judge.as_ref().and_then(|judge| judge.without_needless(plan));
            let plan = shorter.as_ref().unwrap_or(plan);
            // Without what it did not need, the one before may end earlier.
            if let (Some(end), None) = (plan.makespan, plan.metric) {
                if self.earliest.is_some_and(|earliest| end > earliest) {
                    return;
                }
                self.earliest = Some(end);
            }
            if !self.says_each {
                self.last = Some(plan.clone());
                return;
            }
            return (self.report)(Message::Plan(plan));
        }
        (self.report)(message);
    }

    /// Says the last plan where that is still to be done; returns why there is none.
    fn finish(mut self, reason: Option<NoPlan>) -> Option<NoPlan> {
        if let Some(plan) = self.last.take() {
            (self.report)(Message::Plan(&plan));
        }
        if self.has_plan {
            return None;
        }
        let fault = self.judge.and_then(|judge| judge.fault);
        reason.or_else(|| Some(NoPlan::GaveUp(format!("its plan does not hold: {}", fault.unwrap_or_default()))))
    }
}

/// Finds plans and reports them, each better than the one before; says why there is none.
fn answer(
    domain: &str,
    problem: &str,
    options: Options,
    report: &mut dyn FnMut(Message<'_>),
) -> Result<Option<NoPlan>, SolveError> {
    let task = parser::parse_domain(domain).map_err(SolveError::DomainParse)?;
    let instance = parser::parse_problem(problem).map_err(SolveError::ProblemParse)?;
    // What is true or false only is searched as it is.
    let is_judged = !is_classical(&task, &instance) || compared::has_numbers(&task, &instance);
    let judge = is_judged.then(|| Judge::new(domain, problem));
    let mut reporter =
        Reporter { judge, says_each: options.says_each(), has_plan: false, last: None, earliest: None, report };
    let reason = match is_classical(&task, &instance) {
        true => timeless(&task, &instance, options, &mut reporter)?,
        false => timed(&task, &instance, options, (domain, problem), &mut reporter)?,
    };
    let reason = reporter.finish(reason);
    options.free((task, instance));
    Ok(reason)
}

fn timeless(
    task: &Domain,
    instance: &Problem,
    options: Options,
    reporter: &mut Reporter<'_, '_>,
) -> Result<Option<NoPlan>, SolveError> {
    let mut open = match classical::plan(task, instance, options, &mut |message| reporter.send(message))? {
        Answer::Solved if reporter.has_plan => return Ok(None),
        Answer::None(reason) => return Ok(Some(reason)),
        Answer::Solved | Answer::Declined => None,
        Answer::Open(open) => Some(open),
    };
    let reporter = RefCell::new(reporter);
    let (mut work, mut proof) = (classical::NUMERIC_WORK, None);
    // The search starts anew with more work each time, so that all it did in vain is a part of what it needs.
    let beside = &mut || {
        work = work.saturating_mul(2);
        let send = &mut |message: Message<'_>| reporter.borrow_mut().send(message);
        let Some(searched) = open.take() else { return false };
        match classical::numeric(&searched, classical::memory(), work, options, send) {
            // A search whose plan does not hold would find it again.
            Numeric::Solved => return reporter.borrow().has_plan,
            Numeric::None(reason) => proof = Some(reason),
            Numeric::Open => open = Some(searched),
        }
        proof.is_some()
    };
    let found = &mut |plan: &Plan| reporter.borrow_mut().send(Message::Plan(plan));
    let reason = portfolio::plan(task, instance, options, beside, found)?;
    if proof.is_none() && reason.is_some() && !reporter.borrow().has_plan {
        let send = &mut |message: Message<'_>| reporter.borrow_mut().send(message);
        let refuted = |open: Box<_>| classical::refuted(&open, classical::memory(), classical::PROOF_WORK, send);
        if let Some(Numeric::None(reason)) = open.map(refuted) {
            proof = Some(reason);
        }
    }
    Ok(proof.or(reason))
}

fn timed(
    task: &Domain,
    instance: &Problem,
    options: Options,
    (domain, problem): (&str, &str),
    reporter: &mut Reporter<'_, '_>,
) -> Result<Option<NoPlan>, SolveError> {
    if is_plain(task, instance) {
        temporal::plan(task, instance, options, classical::memory(), &mut |message| reporter.send(message));
        if reporter.has_plan {
            return Ok(None);
        }
    }
    if let Some(reason) = temporal::refuted(task, instance, classical::memory(), classical::NUMERIC_WORK) {
        return Ok(Some(reason));
    }
    let bare = temporal::without_own(domain);
    let texts = (bare.as_deref().unwrap_or(domain), problem);
    let reason = by_ferroplan(task, instance, options, texts, reporter);
    if !reporter.has_plan && is_plain(task, instance) {
        let send = &mut |message: Message<'_>| reporter.send(message);
        temporal::plan_with_literals(task, instance, options, classical::memory(), send);
        if reporter.has_plan {
            return Ok(None);
        }
    }
    let reason = reason?;
    if reason.is_none() || reporter.has_plan {
        return Ok(reason);
    }
    Ok(temporal::refuted(task, instance, classical::memory(), classical::PROOF_WORK).or(reason))
}

/// Why ferroplan has no plan for a task with times, where it has none.
fn by_ferroplan(
    task: &Domain,
    instance: &Problem,
    options: Options,
    (domain, problem): (&str, &str),
    reporter: &mut Reporter<'_, '_>,
) -> Result<Option<NoPlan>, SolveError> {
    let mut reason = None;
    // A plan for what must be is there sooner than one that pleases as well.
    let quick = (options.anytime && pddl3::has_preferences(instance)).then_some(false);
    for optimize in quick.into_iter().chain([options.optimize]) {
        let settings = Settings { optimize, ..Settings::default() };
        let solution = ferroplan::solve(domain, problem, &settings)?;
        match solution.plan {
            Some(plan) if solution.solved => reporter.send(Message::Plan(&plan)),
            _ => {
                let why = solution.notes.join("; ");
                reason = Some(match proof::doubt(task, instance) {
                    Some(doubt) => NoPlan::Doubted { doubt },
                    None => NoPlan::GaveUp(why),
                });
            }
        }
    }
    Ok(reason)
}

/// Whether states and actions are all there is to a task: no time, no preferences, no constraints.
fn is_classical(domain: &Domain, problem: &Problem) -> bool {
    domain.durative_actions.is_empty() && problem.til.is_empty() && is_plain(domain, problem)
}

/// Whether nothing is preferred or constrained.
fn is_plain(domain: &Domain, problem: &Problem) -> bool {
    domain.constraints.is_empty() && problem.constraints.is_empty() && !pddl3::has_preferences(problem)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::plan::{Transcript, Verdict, ff};

    fn task(domain: &str, problem: &str) -> (Transcript, i32) {
        let read = |name: &str| {
            let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/transcripts/tasks/");
            std::fs::read_to_string(format!("{folder}{name}.pddl")).unwrap()
        };
        let mut text = String::new();
        let code = child(&read(domain), &read(problem), Options::default(), &mut |part| text.push_str(part));
        (ff::read(&text, ""), code)
    }

    #[test]
    fn outcomes_are_right() {
        for (domain, problem, verdict, code, length) in [
            ("dom", "p_plan", Verdict::Plan, 0, Some(8)),
            ("dom", "p_disj", Verdict::Plan, 0, None),
            ("dom", "p_neg", Verdict::Plan, 0, Some(1)),
            ("dom", "p_goaltrue", Verdict::Plan, 0, Some(0)),
            ("dom", "p_goaltrue_empty", Verdict::Plan, 0, Some(0)),
            ("dom", "p_unsolv_search", Verdict::Unsolvable, 11, Some(0)),
            ("dom", "p_goalfalse_static", Verdict::Unsolvable, 11, Some(0)),
            ("dom", "p_goalfalse_unreach", Verdict::Unsolvable, 11, Some(0)),
            ("dom", "p_syntax", Verdict::Rejected, 3, Some(0)),
            ("acdom", "acp", Verdict::Plan, 0, Some(2)),
            ("ndom", "np", Verdict::Plan, 0, None),
            ("ndom", "np_unreach", Verdict::Unsolvable, 11, Some(0)),
            ("durdom", "durp", Verdict::Plan, 0, Some(2)),
            ("adldom", "adlp", Verdict::Plan, 0, None),
            ("ffbug_dom", "ffbug_p1", Verdict::Plan, 0, None),
            ("ffbug_dom", "ffbug_p2", Verdict::Plan, 0, None),
        ] {
            let (transcript, exit) = task(domain, problem);
            assert_eq!((transcript.verdict, exit), (verdict, code), "{domain} {problem}: {transcript:?}");
            if let Some(length) = length {
                assert_eq!(transcript.actions.len(), length, "{domain} {problem}");
            }
        }
    }

    #[test]
    fn costs_and_times_are_said() {
        assert_eq!(task("acdom", "acp").0.cost, Some(4.0));
        let (transcript, _) = task("durdom", "durp");
        assert_eq!(transcript.actions.iter().map(|action| action.duration).collect::<Vec<_>>(), [Some(5.0), Some(5.0)]);
    }

    #[test]
    fn a_match_burns_while_fuses_are_mended() {
        let domain = "(define (domain cellar) (:requirements :typing :durative-actions) (:types match fuse)
            (:predicates (free) (unused ?m - match) (mended ?f - fuse) (light ?m - match))
            (:durative-action burn :parameters (?m - match) :duration (= ?duration 5)
              :condition (and (at start (unused ?m)) (over all (light ?m)))
              :effect (and (at start (not (unused ?m))) (at start (light ?m)) (at end (not (light ?m)))))
            (:durative-action mend :parameters (?f - fuse ?m - match) :duration (= ?duration 2)
              :condition (and (at start (free)) (over all (light ?m)))
              :effect (and (at start (not (free))) (at end (mended ?f)) (at end (free)))))";
        let problem = "(define (problem two) (:domain cellar) (:objects m n - match f g h - fuse)
            (:init (free) (unused m) (unused n)) (:goal (and (mended f) (mended g) (mended h))))";
        let mut text = String::new();
        assert_eq!(child(domain, problem, Options::default(), &mut |part| text.push_str(part)), 0, "{text}");
        let actions = ff::read(&text, "").actions;
        assert_eq!(actions.iter().filter(|action| action.name.eq_ignore_ascii_case("mend")).count(), 3, "{text}");
    }

    #[test]
    fn the_same_task_has_the_same_text() {
        assert_eq!(task("adldom", "adlp"), task("adldom", "adlp"));
    }
}
