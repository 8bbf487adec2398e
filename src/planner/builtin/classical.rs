//! A classical task, by the search of rmem's own.

use ferroplan::types::{Domain, Expr, MetricDir, Problem};
use ferroplan::{Plan, SolveError, Step};
use rustix::process::{Resource, getrlimit};

use super::convert::convert;
use super::ff_output::NoPlan;
use super::measure::Measure;
use super::options::Options;
use super::search::lifted::Lifted;
use super::search::task::{OperatorId, Task};
use super::search::{End, Event, Ground, Improvement, Refusal, Settings, ground, prove, solve};

/// The bytes for states where this process has no limit.
const MEMORY: usize = 4 << 30;

/// The work after which ferroplan gets its turn with a task with numbers.
pub(super) const NUMERIC_WORK: u64 = 10_000_000;

/// The work for a proof that a task has no plan, where no search has found one: a few seconds.
pub(super) const PROOF_WORK: u64 = 200_000_000;

/// What a search reports while it runs.
pub(super) enum Message<'p> {
    /// A plan, better than those before.
    Plan(&'p Plan),
    /// How far it is.
    Progress(String),
}

/// How far a grounding is, in words.
pub(super) fn grounding(of: &str, instances: usize) -> String {
    format!("grounding: {of} has {instances} instances so far")
}

/// What becomes of a task.
pub(super) enum Answer {
    /// Its plans were reported.
    Solved,
    /// It has none, or none was found.
    None(NoPlan),
    /// It is not for this search.
    Declined,
    /// It has numbers, and no plan was found so far.
    Open(Box<Task>),
}

/// Finds a plan, and better and better ones where they are wanted.
///
/// # Errors
///
/// For axioms that have no order.
pub(super) fn plan(
    domain: &Domain,
    problem: &Problem,
    options: Options,
    send: &mut dyn FnMut(Message<'_>),
) -> Result<Answer, SolveError> {
    if let Some(lifted) = weighted(domain, problem) {
        let answer = search(&lifted, memory(), options, send);
        options.free(lifted);
        if !matches!(answer, Ok(Answer::Declined)) {
            return answer;
        }
    }
    match convert(domain, problem) {
        Ok(lifted) => {
            let answer = search(&lifted, memory(), options, send);
            options.free(lifted);
            answer
        }
        Err(_) => Ok(Answer::Declined),
    }
}

/// The task with costs that stand for its metric, where that is a weighted sum and not a single number already.
fn weighted(domain: &Domain, problem: &Problem) -> Option<Lifted> {
    if matches!(&problem.metric, Some((MetricDir::Minimize, Expr::Fluent(_, terms))) if terms.is_empty()) {
        return None;
    }
    let measure = Measure::new(domain, problem).filter(|measure| measure.rate == 0.0)?;
    let (mut domain, mut problem) = (domain.clone(), problem.clone());
    measure.apply(&mut domain, &mut problem);
    convert(&domain, &problem).ok()
}

fn search(
    lifted: &Lifted,
    memory: usize,
    options: Options,
    send: &mut dyn FnMut(Message<'_>),
) -> Result<Answer, SolveError> {
    let grounded = &mut |action: &str, instances| send(Message::Progress(grounding(action, instances)));
    let task = match ground(lifted, memory, grounded) {
        Ok(Ground::Task(task)) => task,
        Err(Refusal::Explosion { .. }) if lifted.has_numbers => return Ok(Answer::Declined),
        Ok(Ground::GoalFalse) => return Ok(Answer::None(NoPlan::GoalFalse)),
        Err(Refusal::Wide) => return Ok(Answer::Declined),
        Err(Refusal::Circular) => {
            return Err(SolveError::Derived("a derived predicate depends on its own negation".to_owned()));
        }
        Err(Refusal::Explosion { of, instances }) => {
            return Ok(Answer::None(NoPlan::Full(format!("{of} has more than {instances} instances"))));
        }
    };
    // The search knows no gains: it goes without the metric then.
    if task.is_weighted && task.has_gains() {
        return Ok(Answer::Declined);
    }
    if lifted.has_numbers || task.numbers.count > 0 {
        return Ok(match numeric(&task, memory, NUMERIC_WORK, options, send) {
            Numeric::Solved => Answer::Solved,
            Numeric::None(reason) => Answer::None(reason),
            Numeric::Open => Answer::Open(task),
        });
    }
    let mut search = Search { task: &task, states: 0, obstacle: None, send };
    let answer = match search.solve(memory, u64::MAX, options) {
        End::Solved => Answer::Solved,
        End::Unsolvable => Answer::None(NoPlan::Exhausted),
        End::Full | End::Spent => {
            Answer::None(NoPlan::Full(format!("it had found more than {} states", search.states)))
        }
    };
    options.free(task);
    Ok(answer)
}

/// What becomes of a task with numbers after some work.
#[derive(Debug, PartialEq)]
pub(super) enum Numeric {
    /// Its plans were reported.
    Solved,
    /// It has none.
    None(NoPlan),
    /// Neither a plan nor a proof was found.
    Open,
}

/// Looks for a plan of a task with numbers for a while, and for a proof that there is none.
pub(super) fn numeric(
    task: &Task,
    memory: usize,
    work: u64,
    options: Options,
    send: &mut dyn FnMut(Message<'_>),
) -> Numeric {
    let mut search = Search { task, states: 0, obstacle: None, send };
    let end = search.solve(memory, work, options);
    search.ended(end)
}

/// Looks only for a proof that a task has no plan, for a while.
pub(super) fn refuted(task: &Task, memory: usize, work: u64, send: &mut dyn FnMut(Message<'_>)) -> Numeric {
    let mut search = Search { task, states: 0, obstacle: None, send };
    let settings = Settings { improvement: Improvement::Brief, memory, work };
    let end = prove(task, settings, &mut |event| search.event(event));
    search.ended(end)
}

struct Search<'s> {
    task: &'s Task,
    states: usize,
    /// What stands in the way of every plan.
    obstacle: Option<String>,
    send: &'s mut dyn FnMut(Message<'_>),
}

impl Search<'_> {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Plan(plan) => (self.send)(Message::Plan(&report(self.task, plan))),
            Event::States(count) => {
                self.states = count;
                (self.send)(Message::Progress(format!("{count} states")));
            }
            Event::Obstacle(text) => self.obstacle = Some(text.to_owned()),
        }
    }

    fn ended(&mut self, end: End) -> Numeric {
        match (end, self.obstacle.take()) {
            (End::Solved, _) => Numeric::Solved,
            (End::Unsolvable, Some(why)) => Numeric::None(NoPlan::Bounded(why)),
            (End::Unsolvable, None) => Numeric::None(NoPlan::Exhausted),
            (End::Full | End::Spent, _) => Numeric::Open,
        }
    }

    /// Finds plans, and says how the search ended.
    fn solve(&mut self, memory: usize, work: u64, options: Options) -> End {
        let improvement = match options {
            Options { anytime: true, .. } => Improvement::Unbounded,
            Options { optimize: true, .. } if self.task.has_costs => Improvement::Bounded,
            _ => Improvement::Brief,
        };
        solve(self.task, Settings { improvement, memory, work }, &mut |event| self.event(event))
    }
}

/// The bytes that states may take: about half of what this process may have, as lists that grow are copied.
pub(super) fn memory() -> usize {
    let limit = getrlimit(Resource::As).current.and_then(|bytes| usize::try_from(bytes).ok());
    limit.map_or(MEMORY, |bytes| (bytes / 2).min(MEMORY))
}

/// A plan of operators as one of actions.
fn report(task: &Task, plan: &[OperatorId]) -> Plan {
    let step = |(index, operator): (usize, &OperatorId)| {
        let mut words = task.name(*operator).map(str::to_owned);
        Step { index, action: words.next().unwrap_or_default(), args: words.collect(), time: None, duration: None }
    };
    let steps = plan.iter().enumerate().map(step).collect();
    let metric = (task.has_costs && !task.is_weighted).then(|| task.cost(plan));
    Plan { length: plan.len(), steps, metric, makespan: None }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use ferroplan::parser::{parse_domain, parse_problem};

    use super::super::search::{refutes, simulate::check};
    use super::*;

    fn read(folder: &Path, name: &str) -> String {
        std::fs::read_to_string(folder.join(name).with_extension("pddl")).unwrap()
    }

    fn lifted(domain: &str, problem: &str) -> Option<Lifted> {
        convert(&parse_domain(domain).ok()?, &parse_problem(problem).ok()?).ok()
    }

    fn grounded(domain: &str, problem: &str) -> Task {
        match ground(&lifted(domain, problem).unwrap(), 1 << 26, &mut |_, _| {}) {
            Ok(Ground::Task(task)) => *task,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_plan_for_the_fixtures_is_right_for_the_task_as_it_was_written() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/transcripts/tasks");
        let mut checked = 0;
        for (domain, problem) in [
            ("dom", "p_plan"),
            ("dom", "p_disj"),
            ("dom", "p_neg"),
            ("acdom", "acp"),
            ("adldom", "adlp"),
            ("ffbug_dom", "ffbug_p1"),
        ] {
            let task = lifted(&read(&fixtures, domain), &read(&fixtures, problem)).unwrap();
            let mut has_plan = false;
            search(&task, 1 << 26, Options::default(), &mut |message| {
                let Message::Plan(plan) = message else { return };
                let steps: Vec<_> = plan.steps.iter().map(|step| (step.action.clone(), step.args.clone())).collect();
                assert_eq!(check(&task, &steps), Ok(()), "{domain} {problem}");
                has_plan = true;
            })
            .unwrap();
            checked += usize::from(has_plan);
        }
        assert_eq!(checked, 6);
    }

    #[test]
    fn no_fixture_that_has_a_plan_is_refuted() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
        let mut folders: Vec<_> =
            std::fs::read_dir(fixtures.join("tasks")).unwrap().map(|entry| entry.unwrap()).collect();
        folders.retain(|folder| folder.path().is_dir());
        let mut tasks: Vec<_> = folders.iter().map(|folder| (folder.path(), "domain", "problem")).collect();
        for (domain, problem) in [("dom", "p_plan"), ("acdom", "acp"), ("adldom", "adlp"), ("ffbug_dom", "ffbug_p1")] {
            tasks.push((fixtures.join("transcripts/tasks"), domain, problem));
        }
        let (mut refuted, mut solved) = (Vec::new(), 0);
        for (folder, domain, problem) in tasks {
            let Some(lifted) = lifted(&read(&folder, domain), &read(&folder, problem)) else { continue };
            let Ok(Ground::Task(task)) = ground(&lifted, 1 << 22, &mut |_, _| {}) else { continue };
            if refutes(&task) {
                refuted.push(folder.file_name().unwrap().to_str().unwrap().to_owned());
                continue;
            }
            let settings = Settings { improvement: Improvement::Brief, memory: 1 << 20, work: 0 };
            solved += usize::from(solve(&task, settings, &mut |_| {}) == End::Solved);
        }
        refuted.sort();
        assert!(refuted.contains(&"fuel".to_owned()), "{refuted:?}");
        refuted.retain(|name| !["fuel", "unsolvable", "adl-no-proof", "tiles", "pigeons"].contains(&name.as_str()));
        assert!(refuted.is_empty() && solved >= 7, "{refuted:?} {solved}");
    }

    /// A tank of three litres: each road takes two, and the station fills it up.
    const CAN: &str = "(define (domain can) (:requirements :typing :numeric-fluents) (:types place)
        (:predicates (at ?p - place) (road ?a ?b - place)) (:functions (fuel) (tank) (length ?a ?b - place) (trips))
        (:action drive :parameters (?a ?b - place)
          :precondition (and (at ?a) (road ?a ?b) (>= (fuel) (length ?a ?b)))
          :effect (and (not (at ?a)) (at ?b) (decrease (fuel) (length ?a ?b)) (increase (trips) 1)))
        (:action fill :parameters (?a - place) :precondition (and (at ?a) (< (fuel) (tank)))
          :effect (assign (fuel) (tank))))";

    const FAR: &str = "(define (problem far) (:domain can) (:objects a b c - place)
        (:init (at a) (road a b) (road b c) (= (fuel) 2) (= (tank) 3) (= (trips) 0)
          (= (length a b) 2) (= (length b c) 2)) (:goal (and (at c) (>= (trips) 2))))";

    #[test]
    fn numbers_that_do_not_change_are_no_variables() {
        let task = grounded(CAN, FAR);
        // The fuel and the trips; that there is fuel for a road of two, that the tank is not full, that there were trips.
        assert_eq!((task.numbers.count, task.numbers.comparisons.len()), (2, 3));
    }

    #[test]
    fn plans_with_numbers_are_right() {
        let task = lifted(CAN, FAR).unwrap();
        let mut plans = Vec::new();
        let answer = search(&task, 1 << 26, Options::default(), &mut |message| {
            let Message::Plan(plan) = message else { return };
            let steps: Vec<_> = plan.steps.iter().map(|step| (step.action.clone(), step.args.clone())).collect();
            assert_eq!(check(&task, &steps), Ok(()));
            plans.push(steps.into_iter().map(|(name, _)| name).collect::<Vec<_>>());
        });
        assert!(matches!(answer, Ok(Answer::Solved)));
        assert_eq!(plans.last().unwrap(), &["DRIVE", "FILL", "DRIVE"]);
        // Nothing is filled up before something is missing.
        let fill = ("FILL".to_owned(), vec!["A".to_owned()]);
        assert_eq!(check(&task, std::slice::from_ref(&fill)), Err("the goal is not reached".to_owned()));
        assert!(check(&task, &[fill.clone(), fill]).unwrap_err().contains("not applicable"));
    }

    #[test]
    fn what_numbers_rule_out_is_proven() {
        // There are two roads and no way back.
        let task = lifted(CAN, &FAR.replace("(>= (trips) 2)", "(>= (trips) 3)")).unwrap();
        let answer = search(&task, 1 << 26, Options::default(), &mut |_| {});
        assert!(matches!(answer, Ok(Answer::None(NoPlan::Exhausted))));
        // The tank is too small for the first one.
        let problem = FAR.replace("(= (tank) 3)", "(= (tank) 1)").replace("(= (fuel) 2)", "(= (fuel) 1)");
        let task = lifted(CAN, &problem.replace("(and (at c) (>= (trips) 2))", "(at c)"));
        let Ok(Answer::None(reason)) = search(&task.unwrap(), 1 << 26, Options::default(), &mut |_| {}) else {
            panic!()
        };
        let why = "(>= (fuel) 2) can never hold: (fuel) is always 1; (< (fuel) 1) can never hold: (fuel) is always 1";
        assert_eq!(reason, NoPlan::Bounded(why.to_owned()));
    }

    #[test]
    fn what_is_not_proven_stays_open() {
        // There and back, again and again, with a number that grows without end and is never a half.
        let back = FAR.replace("(road a b)", "(road a b) (road b a) (= (length b a) 2)");
        let task = lifted(CAN, &back.replace("(>= (trips) 2)", "(= (trips) 2.5)"));
        let Ok(Answer::Open(task)) = search(&task.unwrap(), 1 << 26, Options::default(), &mut |_| {}) else { panic!() };
        assert_eq!(refuted(&task, 1 << 26, NUMERIC_WORK, &mut |_| {}), Numeric::Open);
    }

    #[test]
    fn a_number_without_a_value_cannot_grow() {
        let task = lifted(CAN, &FAR.replace("(= (trips) 0)", "")).unwrap();
        let Ok(Answer::None(reason)) = search(&task, 1 << 26, Options::default(), &mut |_| {}) else { panic!() };
        assert_eq!(reason, NoPlan::Bounded("(>= (trips) 2) can never hold: (trips) never has a value".to_owned()));
    }

    /// The plan for a task with the numbers `f` and `g`, of which only `f` is 0 at first: `u` by this condition and this
    /// effect, and `v`, which adds a half to `f`, and `w`, which sets `g` to 1.
    fn plan_of(condition: &str, effect: &str, goal: &str) -> Vec<String> {
        let domain = format!(
            "(define (domain numbers) (:requirements :adl :fluents) (:predicates (z)) (:functions (f) (g))
            (:action u :parameters () :precondition {condition} :effect {effect})
            (:action v :parameters () :precondition () :effect (increase (f) 0.5))
            (:action w :parameters () :precondition () :effect (assign (g) 1)))"
        );
        let problem = format!("(define (problem p) (:domain numbers) (:init (= (f) 0)) (:goal {goal}))");
        let mut steps = Vec::new();
        let task = lifted(&domain, &problem).unwrap();
        let answer = search(&task, 1 << 22, Options::default(), &mut |message| {
            if let Message::Plan(plan) = message {
                steps = plan.steps.iter().map(|step| step.action.clone()).collect();
            }
        });
        assert!(answer.is_ok());
        steps
    }

    #[test]
    fn what_cannot_be_computed_is_neither_true_nor_false() {
        assert_eq!(plan_of("(not (< (/ 1 (f)) 1))", "(z)", "(z)"), ["V", "U"]);
        assert_eq!(plan_of("(not (> (g) 1))", "(z)", "(z)"), ["W", "U"]);
        assert_eq!(plan_of("(< (/ 1 (f)) 1.5)", "(z)", "(z)"), ["V", "V", "U"]);
        assert_eq!(plan_of("()", "(assign (g) (/ 1 (f)))", "(> (g) 1.5)"), ["V", "U"]);
    }

    #[test]
    fn an_action_whose_numbers_cannot_be_computed_is_not_applicable_even_where_nothing_reads_them() {
        assert_eq!(plan_of("()", "(and (z) (assign (g) (/ 1 (f))))", "(z)"), ["V", "U"]);
        assert_eq!(plan_of("()", "(and (z) (scale-down (f) (f)))", "(z)"), ["V", "U"]);
        assert_eq!(plan_of("()", "(and (z) (increase (g) 1))", "(z)"), ["W", "U"]);
        assert_eq!(plan_of("()", "(and (z) (increase (f) 1) (increase (f) 1))", "(z)"), ["U"]);
        assert_eq!(plan_of("()", "(and (z) (increase (f) 1) (assign (f) 1))", "(z)").len(), 0);
        // Only where the condition holds.
        assert_eq!(plan_of("()", "(and (z) (when (< (f) 0.2) (increase (g) 1)))", "(z)").len(), 2);
    }

    const ROADS: &str = "(define (domain roads) (:requirements :adl) (:types truck place)
        (:predicates (at ?t - truck ?p - place) (road ?a ?b - place) (open ?a - place))
        (:action drive :parameters (?t - truck ?a ?b - place)
          :precondition (and (at ?t ?a) (road ?a ?b) (open ?b)) :effect (and (not (at ?t ?a)) (at ?t ?b))))";

    const TRIP: &str = "(define (problem trip) (:domain roads) (:objects t - truck a b c d - place)
        (:init (at t a) (road a b) (road b c) (road c d) (open b) (open c)) (:goal (at t c)))";

    #[test]
    fn only_what_is_reachable_is_grounded() {
        // From a to b to c: there is no way back, and d is closed.
        let task = grounded(ROADS, TRIP);
        let names: Vec<String> =
            (0..task.operators.len()).map(|number| task.name(number as u32).collect::<Vec<_>>().join(" ")).collect();
        assert_eq!(names, ["DRIVE T A B", "DRIVE T B C"]);
    }

    #[test]
    fn a_truck_is_one_variable_whose_values_are_places() {
        let task = grounded(ROADS, TRIP);
        assert_eq!((task.len(), task.facts()), (1, 3));
        assert_eq!(task.operators[0].condition, [task.init[0]]);
    }

    #[test]
    fn a_goal_that_is_not_reachable_is_false() {
        let task = lifted(ROADS, &TRIP.replace("(:goal (at t c))", "(:goal (at t d))")).unwrap();
        assert!(matches!(ground(&task, 1 << 26, &mut |_, _| {}), Ok(Ground::GoalFalse)));
    }

    #[test]
    fn two_places_at_once_are_a_goal_that_is_false() {
        let task = lifted(ROADS, &TRIP.replace("(:goal (at t c))", "(:goal (and (at t c) (at t b)))")).unwrap();
        assert!(matches!(ground(&task, 1 << 26, &mut |_, _| {}), Ok(Ground::GoalFalse)));
    }

    #[test]
    fn too_many_instances_are_refused_with_their_action() {
        let objects: Vec<String> = (0..60).map(|number| format!("o{number}")).collect();
        let domain = "(define (domain many) (:requirements :strips) (:predicates (p ?x) (q ?x ?y ?z))
            (:action connect :parameters (?x ?y ?z) :precondition (and (p ?x) (p ?y) (p ?z)) :effect (q ?x ?y ?z)))";
        let problem = format!(
            "(define (problem all) (:domain many) (:objects {}) (:init {}) (:goal (q o1 o2 o3)))",
            objects.join(" "),
            objects.iter().map(|name| format!("(p {name})")).collect::<Vec<_>>().join(" ")
        );
        let task = lifted(domain, &problem).unwrap();
        match ground(&task, 1 << 20, &mut |_, _| {}) {
            Err(Refusal::Explosion { of, instances }) => {
                assert!(of == "the action CONNECT" && instances > 1000, "{instances}")
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn quantifiers_conditional_effects_and_axioms_are_kept() {
        // All lamps are off, or the switch is: a lamp is lit by an axiom, and an effect depends on it.
        let domain = "(define (domain lamps) (:requirements :adl :derived-predicates) (:types lamp)
            (:predicates (on ?l - lamp) (power) (lit ?l - lamp) (seen ?l - lamp))
            (:derived (lit ?l - lamp) (and (on ?l) (power)))
            (:action press :parameters (?l - lamp) :precondition (not (on ?l)) :effect (on ?l))
            (:action plug :parameters () :precondition (forall (?l - lamp) (not (lit ?l))) :effect (power))
            (:action look :parameters () :precondition (exists (?l - lamp) (lit ?l))
              :effect (forall (?l - lamp) (when (lit ?l) (seen ?l)))))";
        let problem = "(define (problem see) (:domain lamps) (:objects a b - lamp) (:init)
            (:goal (forall (?l - lamp) (seen ?l))))";
        let task = lifted(&domain.replace(":derived-predicates", ""), problem).unwrap();
        let mut plans = Vec::new();
        search(&task, 1 << 26, Options::default(), &mut |message| {
            if let Message::Plan(plan) = message {
                plans.push(plan.clone());
            }
        })
        .unwrap();
        let steps: Vec<_> = plans[0].steps.iter().map(|step| (step.action.clone(), step.args.clone())).collect();
        assert_eq!((steps.len(), check(&task, &steps)), (4, Ok(())), "{steps:?}");
    }
}
