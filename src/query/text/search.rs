//! A search: words, phrases, and what must not be there.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::{Arc, OnceLock};

use bson::{Bson, RawDocument};

use super::index::TextIndex;
use super::language::Language;
use super::words::{Initials, Sensitivity, tokens, words};
use crate::query::error::{BAD_VALUE, QueryError, Result};
use crate::query::view::Fields;

/// MongoDB's code for a field that is missing.
const MISSING: i32 = 4;
/// MongoDB's code for an index that is not there.
const NO_INDEX: i32 = 27;

/// A search: what `$text` takes.
#[derive(Debug)]
pub struct Search {
    text: String,
    language: Option<Language>,
    sensitivity: Sensitivity,
    question: OnceLock<Question>,
}

/// A search on an index.
#[derive(Debug)]
struct Question {
    index: Arc<TextIndex>,
    sensitivity: Sensitivity,
    /// Words of which one must be there, as they are in the index.
    terms: BTreeSet<String>,
    /// The same, where case or accents count.
    exact: BTreeSet<String>,
    /// Words of which none may be there.
    refused: BTreeSet<String>,
    /// What the words begin with: those in the index, and the others.
    initials: Initials,
    other_initials: Initials,
    /// What must be there, character by character, and what must not.
    phrases: Vec<String>,
    refused_phrases: Vec<String>,
}

impl Search {
    /// Reads what `$text` takes.
    ///
    /// # Errors
    /// If MongoDB refuses it.
    pub(in crate::query) fn parse(value: &Bson) -> Result<Self> {
        const KNOWN: [&str; 4] = ["$search", "$language", "$caseSensitive", "$diacriticSensitive"];
        let Bson::Document(spec) = value else {
            return Err(QueryError::bad_value("$text takes an object, like {$search: 'red cup'}"));
        };
        if let Some(name) = spec.keys().find(|name| !KNOWN.contains(&name.as_str())) {
            return Err(QueryError::bad_value(format!("$text takes {}, not {name}", KNOWN.join(", "))).about(name));
        }
        let text = match spec.get("$search") {
            Some(Bson::String(text)) => text.clone(),
            Some(_) => return Err(QueryError::type_mismatch("$search must be a string").about("$search")),
            None => return Err(QueryError::invalid(MISSING, "$text needs $search, a string")),
        };
        let language = match spec.get("$language") {
            None => None,
            Some(Bson::String(name)) if name.is_empty() => None,
            Some(Bson::String(name)) => {
                Some(Language::parse(name, BAD_VALUE).map_err(|error| error.about("$language"))?)
            }
            Some(_) => return Err(QueryError::type_mismatch("$language must be a string").about("$language")),
        };
        let flag = |name: &str| match spec.get(name) {
            None => Ok(false),
            Some(Bson::Boolean(flag)) => Ok(*flag),
            Some(_) => Err(QueryError::type_mismatch(format!("{name} must be true or false")).about(name)),
        };
        let sensitivity = Sensitivity { case: flag("$caseSensitive")?, diacritics: flag("$diacriticSensitive")? };
        Ok(Self { text, language, sensitivity, question: OnceLock::new() })
    }

    /// Searches what an index searches, from now on.
    pub fn bind(&self, index: &Arc<TextIndex>) {
        self.question.get_or_init(|| Question::new(self, index));
    }

    fn question(&self) -> Result<&Question> {
        self.question.get().ok_or_else(no_index)
    }

    /// Returns whether a document is found.
    ///
    /// # Errors
    /// If no index says what is searched.
    pub(in crate::query) fn matches(&self, fields: Fields<'_>) -> Result<bool> {
        Ok(self.question()?.scores(fields)?.is_some())
    }

    /// Returns the score of a document, word by word, in the order of words; nothing where another part of the filter
    /// found it.
    ///
    /// # Errors
    /// If no index says what is searched.
    pub fn scores(&self, document: &RawDocument) -> Result<Option<BTreeMap<String, f64>>> {
        self.question()?.scores(document.into())
    }
}

/// The refusal of a search where there is no text index.
#[must_use]
pub fn no_index() -> QueryError {
    let message = "text index required for $text query: make one, like `rmem index NS \"{name: 'text'}\"`";
    QueryError::invalid(NO_INDEX, message).about("$text")
}

impl Question {
    fn new(search: &Search, index: &Arc<TextIndex>) -> Self {
        let language = search.language.unwrap_or(index.language());
        let plain = Sensitivity::default();
        let parts = Parts::of(&search.text);
        let sensitivity = search.sensitivity;
        let of = |text: &str, sensitivity| -> BTreeSet<String> { words(text, language, sensitivity).collect() };
        let fold = |phrases: Vec<&str>| phrases.into_iter().map(|phrase| sensitivity.fold(phrase)).collect();
        let terms: BTreeSet<String> = of(&parts.wanted, plain);
        let (exact, refused) = (of(&parts.wanted, sensitivity), of(&parts.refused, sensitivity));
        Self {
            index: Arc::clone(index),
            sensitivity,
            initials: Initials::of(terms.iter()),
            other_initials: Initials::of(exact.iter().chain(&refused)),
            terms,
            exact,
            refused,
            phrases: fold(parts.phrases),
            refused_phrases: fold(parts.refused_phrases),
        }
    }

    /// mongod's formula: each further occurrence of a word in a string counts half as much as the one before, words of
    /// short strings count more, and a string that is the word itself counts a tenth more.
    ///
    /// Stop words are not in the index, but a word that is refused, or whose case or accents count, may be one.
    fn scores(&self, fields: Fields<'_>) -> Result<Option<BTreeMap<String, f64>>> {
        let mut scores = BTreeMap::new();
        let (mut is_exact, mut is_refused) = (!self.sensitivity.is_any(), false);
        let mut left: Vec<&String> = self.phrases.iter().collect();
        let phrased = !self.phrases.is_empty() || !self.refused_phrases.is_empty();
        self.index.each(fields, &mut |text, language, weight| {
            if is_refused {
                return;
            }
            let (mut all, mut found) = (0.0, HashMap::<String, Occurrences>::new());
            for token in tokens(text, language) {
                let may_count = !is_exact || !self.refused.is_empty();
                if may_count && self.other_initials.allow(&token, self.sensitivity) {
                    let word = token.stem(language, self.sensitivity);
                    is_exact = is_exact || self.exact.contains(&word);
                    is_refused = is_refused || self.refused.contains(&word);
                }
                if token.is_stop_word(language) {
                    continue;
                }
                all += 1.0;
                if self.initials.allow(&token, Sensitivity::default()) {
                    let word = token.stem(language, Sensitivity::default());
                    if self.terms.contains(&word) {
                        found.entry(word).or_default().add();
                    }
                }
            }
            for (word, occurrences) in found {
                let density = 0.5 * occurrences.count / all + 0.5;
                let whole = if text.eq_ignore_ascii_case(&word) { 1.1 } else { 1.0 };
                *scores.entry(word).or_insert(0.0) += weight * occurrences.weight * density * whole;
            }
            if phrased {
                let text = self.sensitivity.fold(text);
                left.retain(|phrase| !text.contains(phrase.as_str()));
                is_refused = is_refused || self.refused_phrases.iter().any(|phrase| text.contains(phrase.as_str()));
            }
        })?;
        Ok(Some(scores).filter(|scores| !scores.is_empty() && is_exact && !is_refused && left.is_empty()))
    }
}

/// How often a word is in a string, and what that counts.
#[derive(Default)]
struct Occurrences {
    weight: f64,
    count: f64,
}

impl Occurrences {
    fn add(&mut self) {
        self.weight += 0.5_f64.powf(self.count);
        self.count += 1.0;
    }
}

/// The parts of a search's text.
#[derive(Debug, Default)]
struct Parts<'t> {
    wanted: String,
    refused: String,
    phrases: Vec<&'t str>,
    refused_phrases: Vec<&'t str>,
}

impl<'t> Parts<'t> {
    /// Reads words, phrases in quotes, and both behind `-`, which refuses up to the next blank.
    fn of(text: &'t str) -> Self {
        let mut parts = Self::default();
        let (mut phrase, mut is_refused, mut after_blank) = (None, false, true);
        for (place, c) in text.char_indices() {
            match c {
                '"' => match phrase.take() {
                    None => {
                        phrase = Some(place + 1);
                        parts.add(' ', is_refused);
                    }
                    Some(start) => {
                        let quoted = text.get(start..place).unwrap_or_default();
                        if is_refused {
                            parts.refused_phrases.push(quoted)
                        } else {
                            parts.phrases.push(quoted)
                        }
                        parts.add(' ', is_refused);
                    }
                },
                '-' if phrase.is_none() && after_blank => is_refused = true,
                c if c.is_whitespace() && phrase.is_none() => {
                    parts.add(' ', is_refused);
                    is_refused = false;
                }
                // The words of a refused phrase may be there, one by one.
                _ if phrase.is_some() && is_refused => {}
                c => parts.add(c, is_refused),
            }
            after_blank = c.is_whitespace();
        }
        parts
    }

    fn add(&mut self, c: char, is_refused: bool) {
        if is_refused { self.refused.push(c) } else { self.wanted.push(c) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Document, RawDocumentBuf, doc};

    fn search(index: (Document, Document), search: Document, document: Document) -> Option<f64> {
        let index = Arc::new(TextIndex::parse(&index.0, &index.1).unwrap());
        let search = Search::parse(&search.into()).unwrap();
        search.bind(&index);
        let scores = search.scores(&RawDocumentBuf::try_from(&document).unwrap()).unwrap();
        scores.map(|scores| scores.values().sum())
    }

    fn found(text: &str, search_for: Document) -> bool {
        search((doc! { "s": "text" }, doc! {}), search_for, doc! { "s": text }).is_some()
    }

    #[test]
    fn scores_are_those_of_mongod() {
        let plain = || (doc! { "s": "text" }, doc! {});
        let score = |text: &str, words: &str| search(plain(), doc! { "$search": words }, doc! { "s": text });
        assert_eq!(score("coffee", "coffee"), Some(1.0));
        assert_eq!(score("cup", "cup"), Some(1.1), "the whole string is the word");
        assert_eq!(score("coffee coffee coffee", "coffee"), Some(1.75));
        assert_eq!(score("coffee database system", "coffee"), Some(2.0 / 3.0));
        assert_eq!(score("hello world", "world, hello!"), Some(1.5));
        let weighted = (doc! { "s": "text", "o.t": "text" }, doc! { "weights": { "s": 10 } });
        let document = doc! { "s": "red cup", "o": [{ "t": ["a cup", 3] }], "t": "cup" };
        assert_eq!(search(weighted, doc! { "$search": "cups" }, document), Some(0.75 * 10.0 + 1.0));
        let whole = (doc! { "$**": "text" }, doc! {});
        assert_eq!(search(whole, doc! { "$search": "cup" }, doc! { "a": { "b": [["cup"]] }, "c": 1 }), Some(1.1));
    }

    #[test]
    fn words_phrases_and_what_is_refused_are_told_apart() {
        let found = |text: &str, words: &str| found(text, doc! { "$search": words });
        assert!(found("he runs", "running walking") && !found("he runs", "walking") && !found("he runs", "he"));
        assert!(found("the brown fox", "\"brown fox\"") && !found("the brown red fox", "\"brown fox\""));
        assert!(!found("brown fox", "fox -brown") && found("red fox", "fox -brown") && !found("red fox", "-brown"));
        assert!(!found("brown fox", "fox -\"brown fox\"") && found("fox, brown", "fox -\"brown fox\""));
        let unstopped = |words: &str| doc! { "$search": words, "$language": "none" };
        assert!(
            super::tests::found("a cup", unstopped("cup -the"))
                && !super::tests::found("the cup", unstopped("cup -the"))
        );
        assert!(found("red-cup", "cup") && found("pre-market", "pre-market") && !found("", "\""));
        assert!(found("the robot's arm", "robots") && found("数据库", "数据库") && found("CAFÉ", "cafe"));
    }

    #[test]
    fn case_and_accents_count_where_it_is_asked_for() {
        let cased = |words: &str| doc! { "$search": words, "$caseSensitive": true };
        assert!(
            found("Red cup", cased("Red")) && !found("Red cup", cased("red")) && !found("red", cased("\"Red\" red"))
        );
        let accented = |words: &str| doc! { "$search": words, "$diacriticSensitive": true };
        assert!(found("Café", accented("café")) && !found("Cafe", accented("café")));
        assert!(!found("the end", doc! { "$search": "the", "$language": "none" }), "the index has no stop words");
        let none = (doc! { "s": "text" }, doc! { "default_language": "none" });
        assert_eq!(search(none, doc! { "$search": "the" }, doc! { "s": "the end" }), Some(0.75));
    }

    #[test]
    fn what_mongod_refuses_is_refused() {
        let index = |keys: Document, options: Document| TextIndex::parse(&keys, &options).map(drop).unwrap_err().code;
        assert_eq!(index(doc! { "a": "text", "b": 1, "c": "text" }, doc! {}), 67);
        assert_eq!(index(doc! { "a": "text" }, doc! { "weights": { "a": 0 } }), 67);
        assert_eq!(index(doc! { "a": "text" }, doc! { "default_language": "klingon" }), 67);
        assert_eq!(index(doc! { "a": "text" }, doc! { "default_language": 3 }), 14);
        assert_eq!(index(doc! { "a": "text" }, doc! { "default_language": "german" }), 115);
        assert_eq!(index(doc! { "a": "text" }, doc! { "textIndexVersion": 4 }), 67);
        let refused = |spec: Document| Search::parse(&spec.into()).map(drop).unwrap_err().code;
        assert_eq!(refused(doc! {}), 4);
        assert_eq!(refused(doc! { "$search": 3 }), 14);
        assert_eq!(refused(doc! { "$search": "a", "$language": "klingon" }), 2);
        let unbound = Search::parse(&doc! { "$search": "a" }.into()).unwrap();
        assert_eq!(unbound.scores(&bson::rawdoc! {}).unwrap_err().code, NO_INDEX);
    }

    #[test]
    fn stored_keys_are_those_of_mongod_and_are_read_again() {
        let index =
            TextIndex::parse(&doc! { "n": 1, "b": "text", "a": "text" }, &doc! { "weights": { "b": 3 } }).unwrap();
        let (keys, options) = index.stored(&doc! { "weights": { "b": 3 }, "hidden": true });
        assert_eq!(keys, doc! { "n": 1, "_fts": "text", "_ftsx": 1 });
        let stored = doc! {
            "hidden": true, "weights": { "a": 1, "b": 3 }, "default_language": "english", "language_override": "language",
            "textIndexVersion": 3,
        };
        assert_eq!(options, stored);
        assert_eq!(TextIndex::parse(&keys, &options).unwrap().stored(&options), (keys, stored));
    }
}
