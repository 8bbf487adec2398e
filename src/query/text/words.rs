//! The words of a text, as mongod splits and compares them.

use std::borrow::Cow;

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
    tokens(text, language)
        .filter(move |token| !token.is_stop_word(language))
        .map(move |token| token.stem(language, sensitivity))
}

/// Returns the words of a text, with stop words, as they stand there.
pub(super) fn tokens(text: &str, language: Language) -> impl Iterator<Item = Token<'_>> {
    let words = text.split(move |c| is_between(c, language)).filter(|word| !word.is_empty());
    words.map(|word| Token { word, lower: lowercase_of(word) })
}

/// A word as it stands in a text.
pub(super) struct Token<'t> {
    word: &'t str,
    lower: Cow<'t, str>,
}

impl Token<'_> {
    pub(super) fn is_stop_word(&self, language: Language) -> bool {
        language.is_stop_word(&self.lower)
    }

    /// Returns the word reduced to its stem.
    pub(super) fn stem(&self, language: Language, sensitivity: Sensitivity) -> String {
        let stem = language.stem(if sensitivity.case { self.word } else { &self.lower });
        if sensitivity.diacritics { stem } else { without_diacritics(&stem) }
    }

    /// Returns the letter that the stem begins with, where that is known without it.
    fn initial(&self, sensitivity: Sensitivity) -> Option<u8> {
        let word = if sensitivity.case { self.word } else { &self.lower };
        // Stems of English lose an apostrophe in front.
        word.bytes().next().filter(u8::is_ascii_alphanumeric)
    }
}

/// The letters that words begin with: most words of a text need no stem to be known for others.
#[derive(Debug)]
pub(super) struct Initials([bool; 128]);

impl Initials {
    pub(super) fn of<'w>(words: impl Iterator<Item = &'w String>) -> Self {
        let mut letters = [false; 128];
        for letter in words.filter_map(|word| word.bytes().next()) {
            if let Some(place) = letters.get_mut(usize::from(letter)) {
                *place = true;
            }
        }
        Self(letters)
    }

    /// Returns whether the stem of a word may be one of the words.
    pub(super) fn allow(&self, token: &Token<'_>, sensitivity: Sensitivity) -> bool {
        let initial = token.initial(sensitivity);
        initial.is_none_or(|letter| self.0.get(usize::from(letter)).copied().unwrap_or(true))
    }
}

fn lowercase_of(word: &str) -> Cow<'_, str> {
    let is_lower = word.bytes().all(|byte| byte.is_ascii() && !byte.is_ascii_uppercase());
    if is_lower { Cow::Borrowed(word) } else { Cow::Owned(lowercase(word)) }
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
