//! Temporal plans whose actions touch.
//!
//! Planners let an action start at the moment at which another ends, or at which the world changes by itself, and
//! print fewer digits of their times than they planned with. What happens at one moment must not interfere (PDDL 2.1),
//! and nothing can build on what happens with it, so that such a plan is not valid, though its order is right.

use super::{Plan, Step};

/// How far apart planners set moments that are to come one after the other.
const APART: f64 = 0.001;

/// Times that are closer were meant to be one, but for what rounding left.
const TOUCHING: f64 = 0.9 * APART;

/// How many moments are gone through at most before it is given up that the actions have room for each other.
const WORK: usize = 100_000_000;

/// A moment of a plan. At one time they come in this order, those of a kind in the order of the plan.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Moment {
    /// A step ends.
    End(usize),
    /// The world changes by itself, whatever the plan does.
    Input,
    /// A step starts.
    Start(usize),
}

impl Plan {
    /// The same plan with each start and each end at a moment of its own, in the order they have; where they touch,
    /// ends come first. `given` are the times of timed initial literals, which stay where they are. No action is
    /// earlier than it was, and each takes as long. None for a plan without times, and where the actions have no room.
    #[must_use]
    pub fn spaced(&self, given: &[f64]) -> Option<Self> {
        let mut plan = self.clone();
        let mut starts = self.steps.iter().map(|step| step.start).collect::<Option<Vec<f64>>>()?;
        let lengths: Vec<f64> = self.steps.iter().map(|step| step.duration.unwrap_or_default()).collect();
        let order = order(&starts, &lengths, given);
        // Each time settles one action more, or there is no room.
        for _ in 0..=order.len().min(WORK / order.len().max(1)) {
            let mut earliest = f64::NEG_INFINITY;
            let mut is_settled = true;
            for (time, moment) in &order {
                let (step, offset) = match moment {
                    Moment::Input => {
                        earliest = earliest.max(time + APART);
                        continue;
                    }
                    Moment::Start(step) => (*step, 0.0),
                    Moment::End(step) => (*step, *lengths.get(*step)?),
                };
                let start = starts.get_mut(step)?;
                if *start + offset < earliest {
                    *start = earliest - offset;
                    // What started before starts at another moment now.
                    is_settled &= !matches!(moment, Moment::End(_));
                }
                earliest = *start + offset + APART;
            }
            if is_settled {
                for (step, start) in plan.steps.iter_mut().zip(&starts) {
                    // Sums of thousandths, without what adding them up left.
                    step.start = Some((start * 1e6).round() / 1e6);
                }
                let start = |step: &Step| step.start.unwrap_or_default();
                plan.steps.sort_by(|one, other| start(one).total_cmp(&start(other)));
                return Some(plan);
            }
        }
        None
    }
}

/// The moments of a plan, one after the other.
fn order(starts: &[f64], lengths: &[f64], given: &[f64]) -> Vec<(f64, Moment)> {
    let mut moments: Vec<(f64, Moment)> = given.iter().map(|time| (*time, Moment::Input)).collect();
    for (step, (start, length)) in starts.iter().zip(lengths).enumerate() {
        moments.push((*start, Moment::Start(step)));
        // What takes no time is one moment.
        if *length > TOUCHING {
            moments.push((start + length, Moment::End(step)));
        }
    }
    moments.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    for touching in moments.chunk_by_mut(|(one, _), (other, _)| other - one <= TOUCHING) {
        touching.sort_by_key(|(_, moment)| *moment);
    }
    moments
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spaced(times: &[(f64, f64)]) -> Option<Vec<f64>> {
        spaced_with(times, &[])
    }

    fn spaced_with(times: &[(f64, f64)], given: &[f64]) -> Option<Vec<f64>> {
        let step = |(start, duration): &(f64, f64)| Step {
            action: "go".to_owned(),
            arguments: Vec::new(),
            start: Some(*start),
            duration: Some(*duration),
        };
        let plan = Plan { steps: times.iter().map(step).collect(), cost: None };
        Some(plan.spaced(given)?.steps.iter().filter_map(|step| step.start).collect())
    }

    #[test]
    fn actions_that_touch_come_one_after_the_other() {
        assert_eq!(
            spaced(&[(0.0, 69.0), (69.0, 47.0), (116.0, 0.0), (116.0, 61.0)]).unwrap(),
            [0.0, 69.001, 116.002, 116.003]
        );
        // Rounded times, the end a hair behind the start that waits for it.
        assert_eq!(spaced(&[(16.67, 1.6674), (18.337, 1.0)]).unwrap(), [16.67, 18.3384]);
    }

    #[test]
    fn actions_that_do_not_touch_stay() {
        assert_eq!(spaced(&[(0.0, 5.0), (1.0, 2.0), (5.001, 1.0)]).unwrap(), [0.0, 1.0, 5.001]);
        assert_eq!(spaced(&[]).unwrap(), [0.0; 0]);
    }

    #[test]
    fn an_end_is_moved_by_moving_its_start() {
        // Both start and end together.
        assert_eq!(spaced(&[(0.0, 5.0), (0.0, 5.0), (5.0, 1.0)]).unwrap(), [0.0, 0.001, 5.002]);
        // The second ends with the first, which is longer.
        assert_eq!(spaced(&[(0.0, 5.0), (2.0, 3.0)]).unwrap(), [0.0, 2.001]);
    }

    #[test]
    fn what_touches_all_along_a_plan_is_set_apart() {
        let actions = (0..1000).map(f64::from).flat_map(|start| [(start, 5.0), (start + 5.0, 3.0)]);
        let starts = spaced(&actions.collect::<Vec<_>>()).unwrap();
        assert!(starts.windows(2).all(|pair| pair[1] - pair[0] > 0.9 * APART), "{starts:?}");
    }

    #[test]
    fn what_waits_for_the_world_starts_after_it_changed() {
        assert_eq!(spaced_with(&[(0.0, 5.0), (10.0, 1.0)], &[5.0, 10.0]).unwrap(), [0.0, 10.001]);
    }

    #[test]
    fn a_plan_without_times_has_no_moments() {
        let step = Step { action: "go".to_owned(), arguments: Vec::new(), start: None, duration: None };
        assert_eq!(Plan { steps: vec![step], cost: None }.spaced(&[]), None);
    }
}
