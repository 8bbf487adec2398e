//! Whether what happens at one time is about the same facts.

use std::collections::{HashMap, HashSet};

use super::change::{Changes, Update};
use super::reads::function_key;
use super::state::Ground;

/// One point with what it reads and changes.
pub(super) struct Effects {
    pub(super) step: Option<usize>,
    pub(super) reads: HashSet<Ground>,
    pub(super) changes: Changes,
}

/// The steps that read, add and delete each fact, and that read and change each number, at one time.
#[derive(Default)]
struct Uses<'e> {
    reads: HashMap<&'e Ground, Vec<usize>>,
    changes: HashMap<Ground, Vec<(usize, Touch)>>,
}

/// How a fact is touched.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Touch {
    Added,
    Deleted,
    /// A number is increased or decreased, which several may do at once.
    Shifted,
    /// A number gets a value or a multiple of its value, which nothing else may do at the same time.
    Computed,
}

impl Touch {
    fn interferes(self, other: Self) -> bool {
        matches!((self, other), (Self::Added, Self::Deleted) | (Self::Deleted, Self::Added))
            || matches!(
                (self, other),
                (Self::Computed, Self::Computed | Self::Shifted) | (Self::Shifted, Self::Computed)
            )
    }
}

/// Two of those that happen at one time which are about the same facts, where not all only look; of several, the first
/// in the plan.
pub(super) fn interfering(effects: &[Effects]) -> Option<(usize, usize)> {
    let mut uses = Uses::default();
    for (place, Effects { reads, changes, .. }) in effects.iter().enumerate() {
        for fact in reads {
            uses.reads.entry(fact).or_default().push(place);
        }
        let adds = changes.adds.iter().map(|fact| (fact.clone(), Touch::Added));
        let deletes = changes.deletes.iter().map(|fact| (fact.clone(), Touch::Deleted));
        let values = changes.values.iter().map(|(fluent, update)| match update {
            Update::Shift(_) => (function_key(fluent), Touch::Shifted),
            Update::Assign(_) | Update::Scale(_) => (function_key(fluent), Touch::Computed),
        });
        for (fact, touch) in adds.chain(deletes).chain(values) {
            uses.changes.entry(fact).or_default().push((place, touch));
        }
    }
    let mut worst: Option<(usize, usize)> = None;
    let mut note = |one: usize, other: usize| {
        let pair = (one.min(other), one.max(other));
        let has_step =
            [pair.0, pair.1].iter().any(|place| effects.get(*place).is_some_and(|effect| effect.step.is_some()));
        if has_step && worst.is_none_or(|worst| pair < worst) {
            worst = Some(pair);
        }
    };
    for (fact, touches) in &uses.changes {
        let readers = uses.reads.get(fact).map_or(&[][..], Vec::as_slice);
        // A pair is enough: one of the first that touch it, which are two at least, with another that reads or undoes it.
        for (place, touch) in touches.iter().take(3) {
            if let Some(reader) = readers.iter().find(|reader| *reader != place) {
                note(*place, *reader);
            }
            let undoes = |(other, how): &&(usize, Touch)| other != place && touch.interferes(*how);
            if let Some((other, _)) = touches.iter().find(undoes) {
                note(*place, *other);
            }
        }
    }
    worst
}
