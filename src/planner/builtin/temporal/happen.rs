//! Timed initial literals as actions (Edelkamp and Hoffmann 2004): each happens once, after those before it, and the goal
//! asks for them, as also those behind the last action of a plan happen before the goal is looked at.

use std::collections::{HashMap, HashSet};

use ferroplan::types::{Action, Domain, Effect, Formula, Problem, Term, TimedLiteral};

use super::windows::{SAME_MOMENT, UNITS, entangled};

/// A task some of whose timed literals are actions.
pub(super) struct World {
    pub(super) domain: Domain,
    pub(super) problem: Problem,
    /// When these actions happen.
    pub(super) moments: HashMap<String, u64>,
}

impl World {
    /// The task whose timed literals are actions where they are about what is more than a condition of actions: what actions
    /// change or the goal asks for. None where there are no such literals, or some are at no time of a plan.
    pub(super) fn new(domain: &Domain, problem: &Problem) -> Option<Self> {
        let entangled: HashSet<String> = entangled(domain, problem).into_iter().map(str::to_owned).collect();
        let is_in_time = |literal: &TimedLiteral| (0.0..1e12).contains(&literal.time);
        if entangled.is_empty() || !problem.til.iter().all(is_in_time) {
            return None;
        }
        let (mut domain, mut problem) = (domain.clone(), problem.clone());
        let rest = problem.til.extract_if(.., |literal| !entangled.contains(&literal.pred)).collect();
        // What comes before a literal ends a thousandth before this, and what comes after it starts a thousandth later.
        let moment = |time: f64| (time * UNITS - SAME_MOMENT).ceil().max(0.0);
        let moments = happen(&mut domain, &mut problem, moment, |_| true);
        problem.til = rest;
        let moments = moments.into_iter().map(|(name, time)| (name, time as u64)).collect();
        Some(Self { domain, problem, moments })
    }
}

/// Makes actions of timed initial literals, those of one `moment` together, and lets the goal ask for the last one that is
/// awaited; returns their names and moments.
pub(super) fn happen(
    domain: &mut Domain,
    problem: &mut Problem,
    moment: impl Fn(f64) -> f64,
    is_awaited: impl Fn(&TimedLiteral) -> bool,
) -> Vec<(String, f64)> {
    let mut literals = std::mem::take(&mut problem.til);
    // Of what is taken away and brought at once, it holds that it was brought.
    literals.sort_by(|one, other| one.time.total_cmp(&other.time).then(one.add.cmp(&other.add)));
    // Names of tasks have no blanks.
    let clock = |count: usize| format!("CLOCK {count}");
    let now = |count: usize| Formula::Atom(clock(count), Vec::new());
    let awaited = "AWAITED LITERALS".to_owned();
    let last = literals.iter().rfind(|literal| is_awaited(literal)).map(|literal| moment(literal.time));
    let mut moments = Vec::new();
    for at_once in literals.chunk_by(|one, other| moment(one.time) == moment(other.time)) {
        let count = moments.len();
        let is_last = |place: &usize| {
            let is_same =
                |later: &TimedLiteral| (&later.pred, &later.args) == (&at_once[*place].pred, &at_once[*place].args);
            !at_once[place + 1..].iter().any(is_same)
        };
        let mut effects: Vec<Effect> =
            (0..at_once.len()).filter(is_last).map(|place| effect(&at_once[place])).collect();
        effects.extend([Effect::Del(clock(count), Vec::new()), Effect::Add(clock(count + 1), Vec::new())]);
        if last == Some(moment(at_once[0].time)) {
            effects.push(Effect::Add(awaited.clone(), Vec::new()));
        }
        let name = format!("HAPPEN {count}");
        domain.actions.push(Action {
            name: name.clone(),
            params: Vec::new(),
            precond: now(count),
            effect: Effect::And(effects),
            monitored: false,
        });
        domain.predicates.push((clock(count), Vec::new()));
        moments.push((name, moment(at_once[0].time)));
    }
    domain.predicates.push((clock(moments.len()), Vec::new()));
    problem.init_atoms.push((clock(0), Vec::new()));
    if last.is_some() {
        domain.predicates.push((awaited.clone(), Vec::new()));
        problem.goal = Formula::And(vec![problem.goal.clone(), Formula::Atom(awaited, Vec::new())]);
    }
    moments
}

fn effect(literal: &TimedLiteral) -> Effect {
    let terms = literal.args.iter().map(|name| Term::Const(name.clone())).collect();
    match literal.add {
        true => Effect::Add(literal.pred.clone(), terms),
        false => Effect::Del(literal.pred.clone(), terms),
    }
}
