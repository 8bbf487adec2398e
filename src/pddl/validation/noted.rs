//! What is noted of a moment, where someone wants to see what a plan does.

use super::change::Changes;
use super::point::{Instance, Point, text};
use super::state::{Ground, State};
use super::trace::{Event, Happening};

/// A moment that is noted, and the numbers that it changes.
pub(super) struct Noted {
    happening: Happening,
    values: Vec<Ground>,
}

impl State<'_> {
    /// What happens now, and what it is about to change.
    pub(super) fn noted(&self, changes: &Changes, instances: &[Instance<'_>], now: &[(f64, Point)]) -> Noted {
        let texts = |facts: Vec<&Ground>| {
            let mut texts: Vec<String> = facts.into_iter().map(|fact| self.fact_text(fact)).collect();
            texts.sort();
            texts
        };
        let event = |(_, point): &(f64, Point)| match point {
            Point::Whole(step) => Event::Action(text(instances, *step)),
            Point::Start(step) => Event::Start(text(instances, *step)),
            Point::End(step) => Event::End(text(instances, *step)),
            Point::Literal(_) => Event::Literal,
        };
        let adds = changes.adds.iter().filter(|fact| !self.facts.contains(fact.as_ref())).collect();
        let is_gone = |fact: &&Ground| self.facts.contains(fact.as_ref()) && !changes.adds.contains(*fact);
        let mut values: Vec<(String, Ground)> =
            changes.values.keys().map(|fluent| (self.ground_function_text(fluent), fluent.clone())).collect();
        values.sort();
        let before = |fluent: &Ground| self.values.get(fluent).copied();
        Noted {
            happening: Happening {
                time: self.time,
                events: now.iter().map(event).collect(),
                becomes_true: texts(adds),
                becomes_false: texts(changes.deletes.iter().filter(is_gone).collect()),
                values: values.iter().map(|(text, fluent)| (text.clone(), before(fluent), 0.0)).collect(),
            },
            values: values.into_iter().map(|(_, fluent)| fluent).collect(),
        }
    }

    /// The moment with the values that numbers have after it.
    pub(super) fn with_values(&self, noted: Noted) -> Happening {
        let Noted { mut happening, values } = noted;
        for (entry, fluent) in happening.values.iter_mut().zip(&values) {
            entry.2 = self.values.get(fluent).copied().unwrap_or_default();
        }
        happening
    }
}
