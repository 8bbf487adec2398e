//! The built-in planner: the crate `ferroplan`, in a child process of rmem's own.
//!
//! The child is `rmem ff -o DOMAIN -f PROBLEM`, which prints what FF prints, so that
//! it serves programs written for FF as well. Being a process, it is limited, and
//! crashes, like every other planner. As the planner of `rmem plan` it gets a task that has
//! been read and written already, and is told so with [`CHECKED`].

use std::ffi::OsString;
use std::fmt::Write as _;
use std::thread;

use ferroplan::types::{Effect, Formula};
use ferroplan::{Mode, Options as Settings, Plan, Search, Solution, SolveError, Step};

use super::host::Host;
use super::names::{self, Sent};
use super::process::{DOMAIN, PROBLEM};
use super::run::{Output, Planner, Task, refuse};
use crate::formats::plan::{Action, Transcript, ff};
use crate::pddl::Feature;

/// The version of the engine.
const ENGINE: &str = "ferroplan 0.30.0";

/// What the engine does not read, or refuses.
const LACKS: [Feature; 4] =
    [Feature::ObjectFluents, Feature::ContinuousEffects, Feature::ActionVariables, Feature::ChangingDerivedPredicates];

/// The requirements that the engine knows by name. Others announce what it may well
/// be able to do: it reads `:derived` but not the keyword for it.
const REQUIREMENTS: [&str; 21] = [
    ":strips",
    ":typing",
    ":adl",
    ":equality",
    ":negation",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":fluents",
    ":numeric-fluents",
    ":action-costs",
    ":preferences",
    ":constraints",
    ":goal-utilities",
    ":durative-actions",
    ":duration-inequalities",
    ":timed-initial-literals",
    ":time",
];

/// The option that tells the child that its task is known to be well-formed, in names that
/// the engine reads.
pub const CHECKED: &str = "--checked";

/// The engine grounds and searches with recursion over formulas.
const STACK: usize = 64 << 20;

/// The built-in planner.
#[derive(Debug, Clone, Copy, Default)]
pub struct Builtin;

impl Planner for Builtin {
    fn name(&self) -> &str {
        "builtin"
    }

    fn version(&self) -> Option<String> {
        Some(ENGINE.to_owned())
    }

    fn lacks(&self) -> &[Feature] {
        &LACKS
    }

    fn requirements(&self) -> Option<&[&str]> {
        Some(&REQUIREMENTS)
    }

    fn command(&self, host: &Host<'_>) -> Vec<OsString> {
        vec![
            host.exe.clone().into(),
            "ff".into(),
            "-o".into(),
            DOMAIN.into(),
            "-f".into(),
            PROBLEM.into(),
            CHECKED.into(),
        ]
    }

    /// None: the engine takes settings from the environment, and the same task has the same
    /// plan everywhere.
    fn environment(&self) -> Option<&[(&str, &str)]> {
        Some(&[])
    }

    fn read(&self, output: &Output) -> Transcript {
        ff::read(&output.stdout, &output.stderr)
    }
}

/// What `rmem ff` is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Improve the first plan: its cost, its length, its preferences.
    pub optimize: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { optimize: true }
    }
}

/// Plans, and says what FF says: the text for standard output and the exit code of
/// [`super::Outcome`]. What the engine cannot do is refused with the line, and the plan
/// has the names of the task.
#[must_use]
pub fn solve(task: &Task<'_>, options: Options) -> (String, i32) {
    let mut text = format!(
        "\nff: parsing domain file\ndomain '{}' defined\n ... done.\nff: parsing problem file\nproblem '{}' defined\n ... done.\n\n\n",
        task.domain.name(),
        task.problem.name()
    );
    if let Some(refusal) = refuse(&Builtin, task) {
        return (format!("{text}\nff: {refusal}\n"), 34);
    }
    let sent = names::send(task.domain.tree(), task.problem.tree(), Some(&REQUIREMENTS));
    let (said, code) = apart(&sent.domain, &sent.problem, options, Some(&sent));
    text.push_str(&said);
    (text, code)
}

/// As [`solve`], for the texts of a task that is known to be well-formed: they go to the
/// engine as they are (3 where it cannot read them all the same).
#[must_use]
pub fn child(domain: &str, problem: &str, options: Options) -> (String, i32) {
    apart(domain, problem, options, None)
}

/// Lets the engine work on a stack of its own.
fn apart(domain: &str, problem: &str, options: Options, sent: Option<&Sent>) -> (String, i32) {
    thread::scope(|scope| {
        let work = || answer(domain, problem, options, sent);
        match thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work).map(|work| work.join()) {
            Ok(Ok(answer)) => answer,
            Ok(Err(_)) => ("\nthe engine crashed\n".to_owned(), 32),
            // A thread that cannot be had lacks the memory for its stack.
            Err(error) => (format!("\nmemory allocation of {STACK} bytes for the engine failed: {error}\n"), 22),
        }
    })
}

fn answer(domain: &str, problem: &str, options: Options, sent: Option<&Sent>) -> (String, i32) {
    let settings = Settings { optimize: options.optimize, ..Settings::default() };
    match ferroplan::solve(domain, problem, &settings) {
        Ok(Solution { solved: true, plan: Some(plan), .. }) => (plan_text(&plan, sent), 0),
        Ok(solution) => no_plan(domain, problem, &settings, &solution),
        Err(error) => refusal(error),
    }
}

/// A step in words, with the names of the task.
fn words(step: &Step, sent: Option<&Sent>) -> String {
    let Some(sent) = sent else {
        return std::iter::once(&step.action).chain(&step.args).cloned().collect::<Vec<_>>().join(" ");
    };
    let (name, arguments) = (step.action.clone(), step.args.clone());
    let step = sent.restore(&Action { name, arguments, start: None, duration: None, line: 0 });
    std::iter::once(step.action).chain(step.arguments).collect::<Vec<_>>().join(" ")
}

/// A plan in FF's spelling, or with times where it has times.
fn plan_text(plan: &Plan, sent: Option<&Sent>) -> String {
    if plan.steps.is_empty() && plan.metric.is_none_or(|metric| metric == 0.0) {
        return "\nff: goal can be simplified to TRUE. The empty plan solves it\n\n".to_owned();
    }
    let mut text = "\nff: found legal plan as follows\n".to_owned();
    if plan.makespan.is_some() {
        text.push('\n');
        for step in &plan.steps {
            let _ = write!(text, "{:.3}: ({})", step.time.unwrap_or_default(), words(step, sent).to_lowercase());
            let _ = match step.duration {
                Some(duration) => writeln!(text, " [{duration:.3}]"),
                None => writeln!(text),
            };
        }
        let _ = writeln!(text, "\nplan makespan: {:.3}", plan.makespan.unwrap_or_default());
        return text;
    }
    text.push_str("\nstep ");
    for (index, step) in plan.steps.iter().enumerate() {
        let _ = write!(text, "{index:4}: {}\n     ", words(step, sent).to_uppercase());
    }
    text.push('\n');
    if let Some(metric) = plan.metric {
        let _ = writeln!(text, "plan cost: {metric:.6}");
    }
    text.push_str("\ntime spent:    not measured\n\n");
    text
}

/// What there is to say when there is no plan: a proof is one only where the engine has
/// looked at everything and prunes nothing that matters.
fn no_plan(domain: &str, problem: &str, settings: &Settings, solution: &Solution) -> (String, i32) {
    let simplified = solution.notes.iter().any(|note| note.starts_with("unsolvable at grounding"));
    match doubt(domain, problem) {
        None if simplified => ("\nff: goal can be simplified to FALSE. No plan will solve it\n\n".to_owned(), 11),
        None if is_exhausted(domain, problem, settings) => {
            ("\nbest first search space empty! problem proven unsolvable.\n\n".to_owned(), 11)
        }
        None => ("\nsearch cap reached! no plan found within budget.\n\n".to_owned(), 12),
        Some(doubt) => {
            let notes = solution.notes.join("; ");
            let notes = if notes.is_empty() { String::new() } else { format!(" ({notes})") };
            (format!("\nsearch cap reached! no plan found{notes}; no proof for a task with {doubt}.\n\n"), 12)
        }
    }
}

/// Why an exhausted search proves nothing: the engine's estimate of what is still
/// reachable decides which states it drops, and only for these tasks is it known to err
/// on the safe side.
fn doubt(domain: &str, problem: &str) -> Option<&'static str> {
    let read = ferroplan::parser::parse_domain(domain).ok().zip(ferroplan::parser::parse_problem(problem).ok());
    let Some((domain, problem)) = read else { return Some("a text that cannot be read twice") };
    if !domain.durative_actions.is_empty() || !problem.til.is_empty() {
        return Some("time");
    }
    if !domain.constraints.is_empty() || !problem.constraints.is_empty() || ferroplan::pddl3::has_preferences(&problem)
    {
        return Some("preferences or constraints");
    }
    if !domain.derived.is_empty() {
        return Some("derived predicates");
    }
    if domain.actions.iter().any(|action| is_conditional(&action.effect)) {
        return Some("conditional effects");
    }
    let conditions = domain.actions.iter().map(|action| &action.precond).chain([&problem.goal]);
    conditions.into_iter().any(is_numeric).then_some("numeric conditions")
}

fn is_conditional(effect: &Effect) -> bool {
    match effect {
        Effect::When(..) => true,
        Effect::And(parts) => parts.iter().any(is_conditional),
        Effect::Forall(_, inner) => is_conditional(inner),
        _ => false,
    }
}

fn is_numeric(formula: &Formula) -> bool {
    match formula {
        Formula::Comp(..) => true,
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(is_numeric),
        Formula::Not(inner) | Formula::Forall(_, inner) | Formula::Exists(_, inner) | Formula::Pref(_, inner) => {
            is_numeric(inner)
        }
        _ => false,
    }
}

/// Whether the plain best-first search, which prunes nothing else, runs out of states
/// and not into a cap. The first search does not say which of the two ended it.
fn is_exhausted(domain: &str, problem: &str, settings: &Settings) -> bool {
    let settings = Settings { mode: Mode::Ff, search: Search::BestFirst, ..settings.clone() };
    let (text, _) = ferroplan::run_ff(domain, problem, &settings);
    text.contains("problem proven unsolvable") || text.contains("goal can be simplified to FALSE")
}

fn refusal(error: SolveError) -> (String, i32) {
    match error {
        SolveError::DomainParse(error) => (format!("\nff: parse error in domain file: {error}\n"), 3),
        SolveError::ProblemParse(error) => (format!("\nff: parse error in problem file: {error}\n"), 3),
        SolveError::EmptyType { kind, pred, ty } => {
            (format!("\n{kind} {pred} is declared to use unknown or empty type {ty}\n"), 3)
        }
        SolveError::Derived(words) | SolveError::Unsupported(words) => (format!("\nff: {words}\n"), 34),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::plan::Verdict;

    fn task(domain: &str, problem: &str) -> (Transcript, i32) {
        let read = |name: &str| {
            let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/transcripts/tasks/");
            std::fs::read_to_string(format!("{folder}{name}.pddl")).unwrap()
        };
        let (text, code) = child(&read(domain), &read(problem), Options::default());
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
            ("ndom", "np_unreach", Verdict::GaveUp, 12, Some(0)),
            ("durdom", "durp", Verdict::Plan, 0, Some(2)),
            ("adldom", "adlp", Verdict::Plan, 0, None),
            ("ffbug_dom", "ffbug_p1", Verdict::Plan, 0, None),
            ("ffbug_dom", "ffbug_p2", Verdict::Plan, 0, None),
        ] {
            let (transcript, said) = task(domain, problem);
            assert_eq!((transcript.verdict, said), (verdict, code), "{domain} {problem}: {transcript:?}");
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
    fn the_same_task_has_the_same_text() {
        assert_eq!(task("adldom", "adlp"), task("adldom", "adlp"));
    }
}
