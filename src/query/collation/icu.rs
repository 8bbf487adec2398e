//! The collator, of ICU4X. mongod has ICU 57, whose root order is older: they differ in characters that came later.

use std::cmp::Ordering;

use icu_collator::options::{AlternateHandling, CaseLevel, CollatorOptions, MaxVariable, Strength};
use icu_collator::preferences::{CollationCaseFirst, CollationNumericOrdering};
use icu_collator::{CollatorBorrowed, CollatorPreferences};

use super::locale;
use super::options::Options;
use crate::query::error::{QueryError, Result};

/// Compares strings.
pub(super) struct Collator {
    options: Options,
    collator: CollatorBorrowed<'static>,
}

impl Collator {
    pub(super) fn new(options: &Options) -> Result<Self> {
        let unknown = || QueryError::bad_value(format!("there are no rules for the locale {:?}", options.locale));
        let tag = locale::tag(&options.locale, options.backwards)?;
        let mut preferences =
            CollatorPreferences::from(&tag.parse::<icu_locale_core::Locale>().map_err(|_| unknown())?);
        preferences.case_first = Some(match options.case_first.as_str() {
            "upper" => CollationCaseFirst::Upper,
            "lower" => CollationCaseFirst::Lower,
            _ => CollationCaseFirst::False,
        });
        preferences.numeric_ordering =
            Some(if options.numeric { CollationNumericOrdering::True } else { CollationNumericOrdering::False });
        let mut rules = CollatorOptions::default();
        rules.strength = Some(match options.strength {
            1 => Strength::Primary,
            2 => Strength::Secondary,
            3 => Strength::Tertiary,
            4 => Strength::Quaternary,
            _ => Strength::Identical,
        });
        rules.case_level = Some(if options.case_level { CaseLevel::On } else { CaseLevel::Off });
        rules.alternate_handling =
            Some(if options.shifted { AlternateHandling::Shifted } else { AlternateHandling::NonIgnorable });
        rules.max_variable =
            Some(if options.max_variable == "space" { MaxVariable::Space } else { MaxVariable::Punctuation });
        let collator = CollatorBorrowed::try_new(preferences, rules).map_err(|_| unknown())?;
        Ok(Self { options: options.clone(), collator })
    }

    pub(super) fn options(&self) -> &Options {
        &self.options
    }

    pub(super) fn compare(&self, a: &str, b: &str) -> Ordering {
        self.collator.compare(a, b)
    }

    /// Returns bytes that compare as the string does.
    pub(super) fn sort_key(&self, text: &str) -> Vec<u8> {
        let mut key = Vec::with_capacity(2 * text.len() + 4);
        let Ok(()) = self.collator.write_sort_key_to(text, &mut key);
        key
    }
}

impl std::fmt::Debug for Collator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.options.fmt(f)
    }
}
