//! How far the other steps of a plan with times have to be when a step begins or ends.
//!
//! A durative step happens twice: at its start and at its end. A happening waits for those before it that give what it
//! needs, need what it takes, or change the same facts in opposite ways (Bäckström 1998, deordering; the happenings
//! are those of Fox & Long 2003). What holds over all of a step is needed at its start and at its end.

use std::cmp::Reverse;

use super::Step;
use super::domain::Domain;
use super::structure::{Ground, Structure};
use crate::formats::pddl::ast::Moment;

/// How many parts of a unit of time planners tell apart.
const PARTS: f64 = 1e6;

/// How far a step has to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reach {
    /// It has begun.
    Begun,
    /// It has ended.
    Ended,
}

/// The start of a step, its end, or both where it takes no time.
struct Event {
    step: usize,
    /// None where the step takes no time.
    moment: Option<Moment>,
    time: f64,
}

impl Domain {
    /// Returns how far each step has to be before one of them, counted from 0, can have begun or have ended; none for
    /// those that it does not wait for.
    #[must_use]
    pub fn waits(&self, steps: &[Step], step: usize, reach: Reach) -> Vec<Option<Reach>> {
        let events = events(steps);
        let ground: Vec<Ground> =
            events.iter().filter_map(|event| Some(self.ground(steps.get(event.step)?, event.moment))).collect();
        let order = Structure::order_of(&ground);
        let mut waits = vec![None; steps.len()];
        // Each event is behind those that it waits for.
        let mut is_before = vec![false; events.len()];
        let mut has_ended = vec![false; steps.len()];
        for (index, event) in events.iter().enumerate().rev() {
            let is_own = event.step == step;
            let is_aim = is_own && (reach == Reach::Ended || event.moment != Some(Moment::End));
            let is_begun = has_ended.get(event.step) == Some(&true);
            let leads = order.iter().any(|(first, last)| *first == index && is_before.get(*last) == Some(&true));
            if let Some(before) = is_before.get_mut(index) {
                *before = is_aim || leads || is_begun;
            }
            if let Some(ended) = has_ended.get_mut(event.step) {
                *ended |= leads;
            }
            if let Some(wait) = waits.get_mut(event.step).filter(|_| leads && !is_own) {
                let reach = if event.moment == Some(Moment::Start) { Reach::Begun } else { Reach::Ended };
                *wait = (*wait).max(Some(reach));
            }
        }
        waits
    }
}

/// The events of all steps in the order of time; at one time, ends before starts.
fn events(steps: &[Step]) -> Vec<Event> {
    let mut events = Vec::new();
    for (index, step) in steps.iter().enumerate() {
        let start = step.start.unwrap_or_default();
        match step.duration.filter(|duration| *duration > 0.0) {
            Some(duration) => {
                events.push(Event { step: index, moment: Some(Moment::Start), time: start });
                events.push(Event { step: index, moment: Some(Moment::End), time: start + duration });
            }
            None => events.push(Event { step: index, moment: None, time: start }),
        }
    }
    let time = |event: &Event| (event.time * PARTS).round();
    events.sort_by(|a, b| {
        let is_end = |event: &Event| Reverse(event.moment == Some(Moment::End));
        time(a).total_cmp(&time(b)).then_with(|| is_end(a).cmp(&is_end(b)))
    });
    events
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::Source;
    use crate::formats::pddl::Dialect;

    #[test]
    fn a_step_waits_for_the_start_or_for_the_end_of_others() {
        let text =
            "(define (domain m) (:requirements :durative-actions) (:predicates (light) (fuse ?f) (mended ?f) (hand))
          (:durative-action burn :parameters () :duration (= ?duration 8)
            :effect (and (at start (light)) (at end (not (light)))))
          (:durative-action mend :parameters (?f) :duration (= ?duration 5)
            :condition (and (over all (light)) (at start (hand)))
            :effect (and (at start (not (hand))) (at end (hand)) (at end (mended ?f))))
          (:action show :parameters (?f) :precondition (mended ?f) :effect (fuse ?f)))";
        let domain = Domain::read(&Source::new("d", text), Dialect::default()).unwrap();
        let step = |start: f64, line: &str, duration: f64| {
            let mut words = line.split(' ').map(str::to_owned);
            let duration = Some(duration).filter(|duration| *duration > 0.0);
            Step { action: words.next().unwrap(), arguments: words.collect(), start: Some(start), duration }
        };
        let steps =
            [step(0.0, "burn", 12.0), step(0.01, "mend f", 5.0), step(5.02, "mend g", 5.0), step(10.03, "show g", 0.0)];
        let (begun, ended) = (Some(Reach::Begun), Some(Reach::Ended));
        let to_end = |step| domain.waits(&steps, step, Reach::Ended);
        assert_eq!(to_end(1), [begun, None, None, None]);
        assert_eq!(to_end(2), [begun, ended, None, None], "one hand mends one fuse");
        assert_eq!(to_end(3), [begun, ended, ended, None]);
        assert_eq!(to_end(0), [None, ended, ended, None], "the light is needed to the end");
        assert_eq!(to_end(9), [None; 4]);
        let to_start = |step| domain.waits(&steps, step, Reach::Begun);
        assert_eq!(to_start(0), [None; 4]);
        assert_eq!(to_start(1), [begun, None, None, None], "the light that it needs is still burning");
        assert_eq!(to_start(2), [begun, ended, None, None]);
        assert_eq!(to_start(3), to_end(3));
    }
}
