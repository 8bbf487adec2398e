//! Numbers that operators add to and take from: fuel, places, hands (reservoirs: Laborie 2003, "Algorithms for propagating
//! resource constraints in AI planning and scheduling").
//!
//! Sums do not depend on their order. So operators that share a number may overlap as far as each finds it at its start as
//! it needs it; only the starts that need it so keep the order of the plan.

/// How a number is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Comparison {
    /// It is less.
    Less,
    /// It is less or equal.
    AtMost,
    /// It is equal.
    Equal,
    /// It is more or equal.
    AtLeast,
    /// It is more.
    More,
}

/// How far two numbers may be apart and still be equal.
const TOLERANCE: f64 = 1e-6;

impl Comparison {
    fn holds(self, left: f64, right: f64) -> bool {
        match self {
            Self::Less => left < right - TOLERANCE,
            Self::AtMost => left <= right + TOLERANCE,
            Self::Equal => (left - right).abs() <= TOLERANCE,
            Self::AtLeast => left >= right - TOLERANCE,
            Self::More => left > right + TOLERANCE,
        }
    }
}

/// What an operator needs of a number, and what it does to it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Draw {
    /// Which number.
    pub number: u32,
    /// What holds of it before the operator starts.
    pub tests: Vec<(Comparison, f64)>,
    /// What the start adds to it.
    pub at_start: f64,
    /// What the end adds to it.
    pub at_end: f64,
}

/// A number while a plan is scheduled.
#[derive(Debug, Clone)]
pub(super) struct Reservoir {
    /// What it is with all starts, and with the ends until `since`.
    level: f64,
    /// The last start that read it; later ones do not come before it.
    since: u64,
    /// From when it may be read, and from when it may be changed.
    readable: u64,
    changeable: u64,
    /// What ends will add to it, in order of time.
    coming: Vec<(u64, f64)>,
    /// The last of all ends so far.
    last: u64,
}

impl Reservoir {
    pub(super) fn new(level: f64) -> Self {
        Self { level, since: 0, readable: 0, changeable: 0, coming: Vec::new(), last: 0 }
    }

    /// The first moment from `start` on at which an operator may start; `None` where its tests never hold.
    pub(super) fn earliest(&self, draw: &Draw, start: u64, duration: u64, gap: u64) -> Option<u64> {
        let mut start = start;
        if draw.at_start != 0.0 {
            start = start.max(self.changeable);
        }
        if draw.at_end != 0.0 {
            start = start.max(self.changeable.saturating_sub(duration));
        }
        if draw.tests.is_empty() {
            return Some(start);
        }
        start = start.max(self.since).max(self.readable);
        let holds = |level: f64| draw.tests.iter().all(|(comparison, other)| comparison.holds(level, *other));
        let mut level = self.level;
        for (time, amount) in &self.coming {
            if time + gap > start {
                if start + gap <= *time && holds(level) {
                    return Some(start);
                }
                start = time + gap;
            }
            level += amount;
        }
        holds(level).then_some(start)
    }

    /// Lets an operator start.
    pub(super) fn add(&mut self, draw: &Draw, start: u64, duration: u64, gap: u64) {
        if !draw.tests.is_empty() {
            let past = self.coming.partition_point(|(time, _)| *time <= start);
            self.level += self.coming.drain(..past).map(|(_, amount)| amount).sum::<f64>();
            self.since = start;
            self.changeable = start + gap;
        }
        if draw.at_start != 0.0 {
            self.level += draw.at_start;
            self.readable = self.readable.max(start + gap);
        }
        if draw.at_end != 0.0 {
            let end = start + duration;
            let place = self.coming.partition_point(|(time, _)| *time <= end);
            self.coming.insert(place, (end, draw.at_end));
            self.last = self.last.max(end);
        }
    }

    /// A measure of how long others have to wait for it. No operator makes it less: where one did, a way that comes back to a
    /// state would be taken for a better way to it, and lead to itself.
    pub(super) fn wait(&self) -> u64 {
        self.last + self.readable
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// When operators start, each as early as it may.
    fn starts(level: f64, draws: &[(&Draw, u64)]) -> Vec<Option<u64>> {
        let mut reservoir = Reservoir::new(level);
        let start = |(draw, duration): &(&Draw, u64)| {
            let start = reservoir.earliest(draw, 0, *duration, 1)?;
            reservoir.add(draw, start, *duration, 1);
            Some(start)
        };
        draws.iter().map(start).collect()
    }

    fn draw(tests: &[(Comparison, f64)], at_start: f64, at_end: f64) -> Draw {
        Draw { number: 0, tests: tests.to_vec(), at_start, at_end }
    }

    #[test]
    fn as_many_borrow_as_there_is() {
        let borrow = draw(&[(Comparison::AtLeast, 1.0)], -1.0, 1.0);
        assert_eq!(starts(2.0, &[(&borrow, 30); 3]), [Some(0), Some(1), Some(32)]);
        assert_eq!(starts(1.0, &[(&borrow, 30); 2]), [Some(0), Some(31)]);
        assert_eq!(starts(0.0, &[(&borrow, 30)]), [None]);
    }

    #[test]
    fn what_is_delivered_is_waited_for() {
        let (deliver, take) = (draw(&[], 0.0, 2.0), draw(&[(Comparison::More, 1.0)], -2.0, 0.0));
        assert_eq!(starts(0.0, &[(&deliver, 10), (&take, 5)]), [Some(0), Some(11)]);
        assert_eq!(starts(2.0, &[(&deliver, 10), (&take, 5), (&take, 5)]), [Some(0), Some(0), Some(11)]);
    }

    #[test]
    fn no_operator_makes_the_wait_less() {
        let (deliver, take) = (draw(&[], 0.0, 2.0), draw(&[(Comparison::More, 1.0)], -2.0, 0.0));
        let read = draw(&[(Comparison::AtMost, 0.0)], 0.0, 0.0);
        let mut reservoir = Reservoir::new(0.0);
        let mut before = reservoir.wait();
        for (draw, duration) in [(&read, 2), (&deliver, 10), (&take, 5), (&read, 1), (&deliver, 3), (&take, 1)] {
            let start = reservoir.earliest(draw, 0, duration, 1).unwrap();
            reservoir.add(draw, start, duration, 1);
            assert!(reservoir.wait() >= before, "{draw:?}");
            before = reservoir.wait();
        }
    }

    #[test]
    fn what_was_read_is_not_changed_before() {
        let (read, deliver) = (draw(&[(Comparison::AtMost, 0.0)], 0.0, 0.0), draw(&[], 0.0, 1.0));
        let fill = draw(&[], 1.0, 0.0);
        assert_eq!(starts(0.0, &[(&read, 5), (&deliver, 0), (&fill, 3)]), [Some(0), Some(1), Some(1)]);
        assert_eq!(starts(0.0, &[(&deliver, 20), (&read, 5)]), [Some(0), Some(0)]);
        assert_eq!(starts(0.0, &[(&fill, 20), (&read, 5)]), [Some(0), None]);
        // What ends add is changed at one moment by several.
        assert_eq!(starts(0.0, &[(&deliver, 20), (&deliver, 20)]), [Some(0), Some(0)]);
    }
}
