//! The languages of a text index: which words are searched, and what they are reduced to.

use rust_stemmers::{Algorithm, Stemmer};

use super::english;
use crate::query::error::{QueryError, Result};

/// A language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Language {
    /// Every word as it is.
    None,
    /// Without stop words; words are reduced to their stems.
    English,
}

/// Languages of MongoDB, by their names and codes, that rmem has no stop words of.
const OTHERS: [&str; 28] = [
    "da",
    "danish",
    "de",
    "dutch",
    "es",
    "fi",
    "finnish",
    "fr",
    "french",
    "german",
    "hu",
    "hungarian",
    "it",
    "italian",
    "nb",
    "nl",
    "norwegian",
    "portuguese",
    "pt",
    "ro",
    "romanian",
    "ru",
    "russian",
    "spanish",
    "sv",
    "swedish",
    "tr",
    "turkish",
];

impl Language {
    /// Reads the name of a language, or its code. `code` is MongoDB's for a language that is none.
    ///
    /// # Errors
    /// If there is no such language, or rmem does not support it.
    pub(super) fn parse(name: &str, code: i32) -> Result<Self> {
        match name.to_ascii_lowercase().as_str() {
            "none" => Ok(Self::None),
            "english" | "en" => Ok(Self::English),
            other if OTHERS.contains(&other) => {
                let mut refusal = QueryError::unsupported("$language");
                refusal.message =
                    format!("the language `{name}` is not supported by the embedded store; take english or none");
                Err(refusal)
            }
            _ => Err(QueryError::invalid(code, format!("unsupported language: `{name}`; take english or none"))),
        }
    }

    /// Returns its name in the definition of an index.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::English => "english",
        }
    }

    /// Returns whether a lower-case word is too common to be searched.
    pub(super) fn is_stop_word(self, word: &str) -> bool {
        self == Self::English && english::STOP_WORDS.binary_search(&word).is_ok()
    }

    /// Returns the stem of a word.
    pub(super) fn stem(self, word: &str) -> String {
        match self {
            Self::None => word.to_owned(),
            Self::English => Stemmer::create(Algorithm::English).stem(word).into_owned(),
        }
    }

    /// Returns whether an apostrophe is part of a word.
    pub(super) fn has_apostrophes(self) -> bool {
        self == Self::English
    }
}
