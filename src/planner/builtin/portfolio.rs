//! A task without times that rmem's own search has refused or not solved, by several searches of ferroplan in turn.
//!
//! Where one search finds a plan in a blink, another may not find any: so each gets a
//! slice, and where none has a plan, a slice four times as large. Slices are numbers of states,
//! so that the winner depends on the task alone, and what was spent in vain is at
//! most a part of what the winner needs. One search works at a time, and what it remembers is
//! forgotten with its slice: the memory of all is that of the largest.
//!
//! In the first slice, in this order:
//!
//! 1. search by novelty, partitioned by the facts that matter to the goal: it makes no estimates,
//!    and is quick where they mislead;
//! 2. enforced hill-climbing, greedy search by landmarks, and best-first search, ferroplan's ladder; its last
//!    rung is complete, and proves;
//! 3. search by novelty and the number of goals.
//!
//! In later slices greedy search by landmarks comes first, and best-first search stands for the ladder: what
//! hill-climbing does not find soon it finds late, and the landmarks lead to shorter plans. Searches by novelty, which
//! find soon or hardly, are not asked again before the slices of the others are as large as their last one.
//!
//! Search by novelty makes detours, so that a plan of its is worth a look for a shorter one, as long as another
//! search would have had in the slice in which it was found.

use std::ops::Range;

use ferroplan::ground::{Outcome, ground};
use ferroplan::novelty::{self, DriverCfg};
use ferroplan::packed::PackedTask;
use ferroplan::search::{self, PlanResult, SearchCfg};
use ferroplan::types::{Domain, Problem};
use ferroplan::{Plan, SolveError, Step, costs, derived, lama, par};

use super::ff_output::NoPlan;
use super::options::Options;
use super::proof;

/// How many states each search may look at in its first slice; fewer where there are many
/// operators, each of which is looked at in each state.
const FIRST: Range<usize> = 200..2_000;

/// As [`FIRST`], times operators.
const FIRST_WORK: usize = 5_000_000;

/// How much larger the next slice is.
const GROWTH: usize = 4;

/// How many states a search that makes no estimates may look at where others look at one.
const CHEAP: usize = 4;

/// How many first slices such a search gets for itself.
const SOON: usize = 64;

/// The most states that are looked at to straighten a plan.
const POLISH: usize = 30_000;

/// The weights of the estimate, from greedy to cautious, with which better plans are looked for.
const WEIGHTS: [f64; 3] = [3.0, 2.0, 1.0];

/// The action that ferroplan adds to reach a goal that is not a conjunction.
const PSEUDO_ACTION: &str = "REACH-GOAL";

/// Finds a plan, and with [`Options::anytime`] better and better ones; says why there is none.
///
/// After the slices of a size it is the turn of another search, `beside`, which says whether it has found and told plans.
pub(super) fn plan(
    domain: &Domain,
    problem: &Problem,
    options: Options,
    beside: &mut dyn FnMut() -> bool,
    found: &mut dyn FnMut(&Plan),
) -> Result<Option<NoPlan>, SolveError> {
    let doubt = proof::doubt(domain, problem);
    let proven = |reason: NoPlan| Ok(Some(doubt.map_or(reason, |doubt| NoPlan::Doubted { doubt })));
    let (domain, problem) = derived::compile(domain, problem).map_err(SolveError::Derived)?;
    let threads = par::num_threads();
    let task = match ground(&domain, &problem, threads) {
        Outcome::Task(task) => task,
        Outcome::GoalTrue => {
            found(&Plan { steps: Vec::new(), length: 0, metric: None, makespan: None });
            return Ok(None);
        }
        Outcome::GoalFalse(_) | Outcome::GoalUndefinedFluent(_) => return proven(NoPlan::GoalFalse),
        Outcome::WallExhausted(why) => return Ok(Some(NoPlan::GaveUp(why))),
        Outcome::EmptyType { kind, pred, ty } => {
            return Err(SolveError::EmptyType { kind: kind.to_owned(), pred, ty });
        }
    };
    let portfolio = Portfolio { task: &task, threads };
    let (ops, spent, detours) = match portfolio.first(beside) {
        First::Plan { ops, spent, detours } => (ops, spent, detours),
        First::Beside => return Ok(None),
        First::Exhausted => return proven(NoPlan::Exhausted),
        First::Full => return Ok(Some(NoPlan::GaveUp("its memory is full of states".to_owned()))),
    };
    let cost = costs::metric_fluent(&problem).and_then(|fluent| task.fluent_id(&fluent));
    match cost.and_then(|fluent| Some((fluent, costs::plan_cost(&task, fluent, &ops)?))) {
        Some((fluent, cost)) => portfolio.cheapen(fluent, ops, cost, spent, options, found),
        None => {
            let ops = match detours {
                Some(states) if options.optimize => portfolio.straighten(ops, states),
                _ => ops,
            };
            portfolio.shorten(ops, options, found);
        }
    }
    Ok(None)
}

/// What became of the search for a first plan.
enum First {
    Plan {
        ops: Vec<usize>,
        /// How many states were looked at by the search that found it, in states with estimates.
        spent: usize,
        /// The states of the slice, where it was found by a search that makes detours.
        detours: Option<usize>,
    },
    /// Another search has found a plan.
    Beside,
    /// There is nothing left to look at.
    Exhausted,
    /// No search can remember more states.
    Full,
}

/// What became of a slice.
enum Slice {
    Plan(Vec<usize>, usize),
    Exhausted,
    /// Its states were looked at.
    Spent(usize),
}

struct Portfolio<'t> {
    task: &'t PackedTask,
    threads: usize,
}

impl Portfolio<'_> {
    fn first(&self, beside: &mut dyn FnMut() -> bool) -> First {
        let first = self.affordable(FIRST_WORK).clamp(FIRST.start, FIRST.end);
        let (mut states, mut looked) = (first, 0);
        loop {
            let cheap = states.saturating_mul(CHEAP).min(first.saturating_mul(SOON)).max(states);
            let (driver, light) = (|| self.driver(cheap), || self.light(cheap));
            let landmarks = || self.landmarks(states);
            let estimates = || self.estimates(states, states == first);
            let mut searches: Vec<(&dyn Fn() -> Slice, bool)> = Vec::new();
            if states > first {
                searches.push((&landmarks, false));
            }
            // Asked to look at as much as before, they find nothing new.
            let is_novel = cheap > looked;
            if is_novel {
                searches.push((&driver, true));
            }
            searches.push((&estimates, false));
            if is_novel {
                searches.push((&light, true));
            }
            let mut is_full = false;
            for (search, makes_detours) in searches {
                match search() {
                    Slice::Plan(ops, spent) if makes_detours => {
                        return First::Plan { ops, spent: spent / CHEAP, detours: Some(states) };
                    }
                    Slice::Plan(ops, spent) => return First::Plan { ops, spent, detours: None },
                    Slice::Exhausted => return First::Exhausted,
                    // A search that stops before its time has explored all it can.
                    Slice::Spent(spent) => is_full |= spent < states,
                }
            }
            if beside() {
                return First::Beside;
            }
            if is_full {
                return First::Full;
            }
            looked = cheap;
            states = states.saturating_mul(GROWTH);
        }
    }

    /// How many states can be looked at for so much work.
    fn affordable(&self, work: usize) -> usize {
        work / self.task.n_ops.max(1)
    }

    /// Best-first search, at the end of ferroplan's whole ladder where that is wanted.
    fn estimates(&self, states: usize, ladder: bool) -> Slice {
        let settings = SearchCfg::from_weights(1.0, 5.0, Some(states));
        let found = search::plan(self.task, self.threads, settings, ladder, None);
        match found.ops {
            Some(ops) => Slice::Plan(ops, found.evaluated),
            None if !found.capped => Slice::Exhausted,
            None => Slice::Spent(found.evaluated),
        }
    }

    fn landmarks(&self, states: usize) -> Slice {
        sliced(lama::search(self.task, self.threads, states, &[], None), states)
    }

    fn driver(&self, states: usize) -> Slice {
        sliced(novelty::search_driver(self.task, states, &[], None, &DriverCfg::default()), states)
    }

    fn light(&self, states: usize) -> Slice {
        sliced(novelty::search_light(self.task, states, &[]), states)
    }

    /// Finds cheaper plans: by a bounded search, or as long as there may be one.
    fn cheapen(
        &self,
        fluent: usize,
        mut ops: Vec<usize>,
        mut cost: f64,
        mut spent: usize,
        options: Options,
        found: &mut dyn FnMut(&Plan),
    ) {
        found(&self.report(&ops, Some(cost)));
        if !(options.anytime || options.optimize) {
            return;
        }
        loop {
            let settings = SearchCfg { max_eval: usize::MAX >> 2, ..SearchCfg::default() };
            let better = costs::improve(self.task, fluent, ops, cost, self.threads, settings, spent, None);
            (ops, cost) = (better.ops, better.cost);
            if better.improved {
                found(&self.report(&ops, Some(cost)));
            }
            // Without a proof, less work than was allowed means that there is no room for more.
            if !options.anytime || better.proven || better.evaluated < spent {
                return;
            }
            spent = spent.max(POLISH).saturating_mul(2);
        }
    }

    /// Looks once for a shorter plan.
    fn straighten(&self, ops: Vec<usize>, states: usize) -> Vec<usize> {
        let states = states.min(POLISH);
        let settings = SearchCfg { g_bound: ops.len(), ..SearchCfg::from_weights(1.0, 5.0, Some(states)) };
        match search::plan(self.task, self.threads, settings, false, None).ops {
            Some(better) if better.len() < ops.len() => better,
            _ => ops,
        }
    }

    /// Finds shorter plans where that is asked for, as long as there may be one.
    fn shorten(&self, mut ops: Vec<usize>, options: Options, found: &mut dyn FnMut(&Plan)) {
        found(&self.report(&ops, None));
        let mut states = POLISH;
        while options.anytime && !ops.is_empty() {
            let mut is_full = true;
            for weight in WEIGHTS {
                let settings = SearchCfg { g_bound: ops.len(), ..SearchCfg::from_weights(1.0, weight, Some(states)) };
                match search::search(self.task, self.threads, settings) {
                    PlanResult::Plan { ops: better, .. } if better.len() < ops.len() => {
                        ops = better;
                        is_full = false;
                        found(&self.report(&ops, None));
                    }
                    PlanResult::Unsolvable { capped: false, .. } => return,
                    PlanResult::Plan { evaluated, .. } | PlanResult::Unsolvable { evaluated, .. } => {
                        is_full &= evaluated < states;
                    }
                }
            }
            if is_full {
                return;
            }
            states = states.saturating_mul(2);
        }
    }

    /// A plan of ferroplan's operators as one of actions.
    fn report(&self, ops: &[usize], metric: Option<f64>) -> Plan {
        let names = ops.iter().filter_map(|op| self.task.op_display.get(*op));
        let words = names.filter_map(|name| {
            let mut words = name.split_whitespace().map(str::to_owned);
            Some((words.next()?, words.collect()))
        });
        let words = words.filter(|(action, _)| action != PSEUDO_ACTION).enumerate();
        let steps: Vec<Step> =
            words.map(|(index, (action, args))| Step { index, action, args, time: None, duration: None }).collect();
        Plan { length: steps.len(), steps, metric, makespan: None }
    }
}

fn sliced(found: Option<(Vec<usize>, usize)>, states: usize) -> Slice {
    match found {
        Some((ops, spent)) => Slice::Plan(ops, spent),
        None => Slice::Spent(states),
    }
}
