//! The words of a text, as mongod splits and compares them.

use unicode_normalization::UnicodeNormalization as _;

use super::characters::{is_accent, is_delimiter};
use super::language::Language;

/// What counts when words are compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Sensitivity {
    /// Upper and lower case are different.
    pub(super) case: bool,
    /// Letters with and without accents are different.
    pub(super) diacritics: bool,
}

impl Sensitivity {
    /// Returns whether anything counts: else words compare as they are in the index.
    pub(super) fn is_any(self) -> bool {
        self.case || self.diacritics
    }

    /// Returns a text so that what does not count is gone.
    pub(super) fn fold(self, text: &str) -> String {
        let cased = if self.case { text.to_owned() } else { lowercase(text) };
        if self.diacritics { cased } else { without_diacritics(&cased) }
    }
}

/// Returns the words of a text, without stop words, reduced to their stems.
pub(super) fn words(text: &str, language: Language, sensitivity: Sensitivity) -> impl Iterator<Item = String> {
    text.split(move |c| is_between(c, language)).filter(|word| !word.is_empty()).filter_map(move |word| {
        let lower = lowercase(word);
        if language.is_stop_word(&lower) {
            return None;
        }
        let stem = language.stem(if sensitivity.case { word } else { &lower });
        Some(if sensitivity.diacritics { stem } else { without_diacritics(&stem) })
    })
}

/// Lower case, a character for a character.
fn lowercase(text: &str) -> String {
    text.chars().map(|c| c.to_lowercase().next().unwrap_or(c)).collect()
}

fn without_diacritics(text: &str) -> String {
    if text.is_ascii() {
        return text.to_owned();
    }
    text.nfd().filter(|c| !is_accent(*c)).nfc().collect()
}

/// Returns whether a character is between words.
fn is_between(c: char, language: Language) -> bool {
    is_delimiter(c) && !(c == '\'' && language.has_apostrophes())
}
