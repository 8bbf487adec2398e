//! Collations: how strings compare where they do not compare byte by byte.
//!
//! An operation has one collation, and everything that it compares, sorts, groups by or looks up follows it. So it is
//! *in effect* on the thread ([`during`]) while the operation runs, and while its results are read, instead of
//! being handed to every place that compares ([`compare`](super::compare()), the keys of [`key`](super::key)). Indexes have a
//! collation of their own.

#[cfg(feature = "collation")]
mod icu;
#[cfg(not(feature = "collation"))]
#[path = "collation/none.rs"]
mod icu;
mod locale;
mod options;

use std::cell::{Cell, RefCell};
use std::cmp::Ordering;
use std::sync::Arc;

use bson::{Document, doc};

use super::error::Result;
use icu::Collator;
use options::Options;

/// A collation, as MongoDB spells it: `{locale: "en", strength: 2, numericOrdering: true}`.
#[derive(Debug, Clone)]
pub struct Collation {
    /// With all options; `{locale: "simple"}` for comparison byte by byte.
    definition: Document,
    collator: Option<Arc<Collator>>,
}

thread_local! {
    static IS_IN_EFFECT: Cell<bool> = const { Cell::new(false) };
    static IN_EFFECT: RefCell<Option<Arc<Collator>>> = const { RefCell::new(None) };
}

impl Collation {
    /// Reads a collation.
    ///
    /// # Errors
    /// If an option is not known or has another type, or the locale is none of MongoDB's; where this rmem is built
    /// without collations, for all but `{locale: "simple"}`.
    pub fn parse(spec: &Document) -> Result<Self> {
        let options = Options::parse(spec).map_err(|error| error.about("collation"))?;
        if options.locale == "simple" {
            return Ok(Self::simple());
        }
        let collator = Collator::new(&options)?;
        Ok(Self { definition: options.definition(), collator: Some(Arc::new(collator)) })
    }

    /// Comparison byte by byte.
    #[must_use]
    pub fn simple() -> Self {
        Self { definition: doc! { "locale": "simple" }, collator: None }
    }

    /// Returns whether strings compare byte by byte.
    #[must_use]
    pub fn is_simple(&self) -> bool {
        self.collator.is_none()
    }

    /// Returns the collation with all its options, as MongoDB lists it.
    #[must_use]
    pub fn definition(&self) -> &Document {
        &self.definition
    }
}

impl PartialEq for Collation {
    fn eq(&self, other: &Self) -> bool {
        self.definition == other.definition
    }
}

/// Does some work with a collation in effect; without one, strings compare byte by byte.
pub fn during<T>(collation: Option<&Collation>, work: impl FnOnce() -> T) -> T {
    let collator = collation.and_then(|collation| collation.collator.clone());
    if collator.is_none() && !IS_IN_EFFECT.get() {
        return work();
    }
    let _restored = Restored(set(collator));
    work()
}

/// Puts a collator into effect and returns the one before.
fn set(collator: Option<Arc<Collator>>) -> Option<Arc<Collator>> {
    IS_IN_EFFECT.set(collator.is_some());
    IN_EFFECT.replace(collator)
}

/// The collator that is in effect again after some work, also where that panics.
struct Restored(Option<Arc<Collator>>);

impl Drop for Restored {
    fn drop(&mut self) {
        set(self.0.take());
    }
}

/// Returns whether strings do not compare byte by byte at the moment.
#[must_use]
pub fn is_in_effect() -> bool {
    IS_IN_EFFECT.get()
}

/// Compares two strings by the collation in effect.
pub(super) fn compare(a: &str, b: &str) -> Ordering {
    if !IS_IN_EFFECT.get() {
        return a.as_bytes().cmp(b.as_bytes());
    }
    IN_EFFECT.with_borrow(|collator| match collator {
        Some(collator) => collator.compare(a, b),
        None => a.as_bytes().cmp(b.as_bytes()),
    })
}

/// Returns the bytes that compare as a string does by the collation in effect.
pub(super) fn sort_key(text: &str) -> Option<Vec<u8>> {
    IN_EFFECT.with_borrow(|collator| collator.as_ref().map(|collator| collator.sort_key(text)))
}

/// Returns whether a collation is the one in effect.
pub(super) fn is(collation: Option<&Collation>) -> bool {
    let other = collation.and_then(|collation| collation.collator.as_ref());
    IN_EFFECT.with_borrow(|collator| match (collator, other) {
        (None, None) => true,
        (Some(one), Some(other)) => one.options() == other.options(),
        _ => false,
    })
}

#[cfg(all(test, feature = "collation"))]
mod tests {
    use super::*;

    fn order(spec: &Document, words: &[&str]) -> Vec<String> {
        let mut words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
        during(Some(&Collation::parse(spec).unwrap()), || words.sort_by(|a, b| compare(a, b)));
        words
    }

    #[test]
    fn strings_compare_by_strength_numbers_and_locale() {
        let en = |strength: i32| doc! { "locale": "en", "strength": strength };
        for (a, b, least) in [("cafe", "CAFE", 3), ("cafe", "café", 2), ("cafe", "caffe", 1)] {
            for strength in 1..=5 {
                let equal = during(Some(&Collation::parse(&en(strength)).unwrap()), || compare(a, b).is_eq());
                assert_eq!(equal, strength < least, "{a} {b} {strength}");
            }
        }
        let numeric = doc! { "locale": "en", "numericOrdering": true };
        assert_eq!(order(&numeric, &["box10", "box9", "Box1"]), ["Box1", "box9", "box10"]);
        assert_eq!(order(&doc! { "locale": "sv" }, &["ö", "z", "o"]), ["o", "z", "ö"]);
        assert_eq!(order(&doc! { "locale": "de" }, &["ö", "z", "o"]), ["o", "ö", "z"]);
        assert_eq!(order(&doc! { "locale": "fr", "backwards": true }, &["coté", "côte"]), ["côte", "coté"]);
    }

    #[test]
    fn sort_keys_are_in_the_order_of_the_strings() {
        let words = ["", "a", "A", "á", "b", "file2", "file 10", "ß", "ss", "z", "ä", "\u{0}", "日本"];
        for spec in [
            doc! { "locale": "en" },
            doc! { "locale": "en", "strength": 1 },
            doc! { "locale": "de@collation=phonebook", "strength": 2, "numericOrdering": true },
            doc! { "locale": "en", "alternate": "shifted", "strength": 4, "caseFirst": "upper" },
        ] {
            during(Some(&Collation::parse(&spec).unwrap()), || {
                for (a, b) in words.iter().flat_map(|a| words.iter().map(move |b| (a, b))) {
                    assert_eq!(sort_key(a).cmp(&sort_key(b)), compare(a, b), "{a:?} {b:?} {spec}");
                }
            });
        }
    }

    #[test]
    fn what_is_no_collation_is_refused() {
        for (spec, code) in [
            (doc! {}, 40_414),
            (doc! { "strength": 2 }, 40_414),
            (doc! { "locale": 1 }, 14),
            (doc! { "locale": "" }, 2),
            (doc! { "locale": "nowhere" }, 2),
            (doc! { "locale": "en", "strength": 6 }, 51_024),
            (doc! { "locale": "en", "strength": 0.5 }, 2),
            (doc! { "locale": "en", "numericOrdering": 1 }, 14),
            (doc! { "locale": "en", "strength": "2" }, 14),
            (doc! { "locale": "en", "weight": 2 }, 40_415),
        ] {
            assert_eq!(Collation::parse(&spec).unwrap_err().code, code, "{spec}");
        }
        assert!(Collation::parse(&doc! { "locale": "simple", "strength": 1 }).unwrap().is_simple());
    }

    #[test]
    fn a_collation_ends_with_its_work() {
        let collation = Collation::parse(&doc! { "locale": "en", "strength": 1 }).unwrap();
        let equal = || compare("a", "A").is_eq();
        assert!(during(Some(&collation), || equal() && !during(None, equal) && equal()));
        let panicked = std::panic::catch_unwind(|| {
            during(Some(&Collation::parse(&doc! { "locale": "en" }).unwrap()), || panic!())
        });
        assert!(panicked.is_err() && !is_in_effect());
    }
}
