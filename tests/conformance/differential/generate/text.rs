//! Searches of words.

use bson::{Bson, Document, doc};
use proptest::collection::vec;
use proptest::prelude::*;

use super::value::{Gen, any_of, document, fields, name, pick};

/// Words that share stems, case folds and accents, stop words, and what is between words.
const WORDS: &[&str] = &[
    "run",
    "running",
    "Runs",
    "runner",
    "the",
    "The",
    "and",
    "is",
    "don't",
    "robot's",
    "cup",
    "Cup",
    "CUPS",
    "café",
    "Cafe",
    "cafe",
    "red-cup",
    "red",
    "blue",
    "x2",
    "3.5",
    "naïve",
    "generously",
    "skies",
    "dying",
    "ﬁne",
    "Straße",
    "a_b",
];

/// The index of all searches.
pub(crate) fn index() -> Document {
    doc! {
        "key": { "s": "text", "l": "text", "o.b": "text" }, "name": "words", "weights": { "s": 2, "o.b": 5 },
    }
}

fn text() -> Gen<String> {
    let between = name(&[" ", " ", " ", "  ", ", ", ".", "-", "\n", "'"]);
    vec((name(WORDS), between), 0..6)
        .prop_map(|words| words.into_iter().flat_map(|(word, between)| [word, between]).collect())
        .boxed()
}

/// A document with texts in some places.
pub(crate) fn texts() -> Gen<Document> {
    let one = || text().prop_map(Bson::from).boxed();
    let some = || vec(one(), 0..3).prop_map(Bson::Array).boxed();
    let inner =
        || any_of(vec![(3, one()), (1, some())]).prop_map(|text| Bson::from(doc! { "b": text, "c": "cup" })).boxed();
    let inners = vec(inner(), 0..3).prop_map(Bson::Array).boxed();
    fields(vec![
        ("s", 90, any_of(vec![(8, one()), (1, pick(&[Bson::Int32(3), Bson::Null]))])),
        ("l", 60, any_of(vec![(3, some()), (1, one())])),
        ("o", 60, any_of(vec![(3, inner()), (1, inners)])),
        ("n", 90, pick(&[1, 2, 3])),
        ("language", 10, pick(&["none", "english"])),
    ])
    .prop_map(document)
    .boxed()
}

/// Words, phrases, and both refused.
fn search() -> Gen<String> {
    let word = || name(WORDS);
    let phrase = || vec(word(), 1..3).prop_map(|words| format!("\"{}\"", words.join(" "))).boxed();
    let refused = |text: Gen<String>| text.prop_map(|text| format!("-{text}")).boxed();
    let part = any_of(vec![
        (8, word()),
        (2, phrase()),
        (2, refused(word())),
        (1, refused(phrase())),
        (
            1,
            name(&[
                "red-cup",
                "-",
                "\"",
                "--cup",
                "- cup",
                "\"\"",
                "\"red",
                "cup\"red\"",
                "-cup\"red\"",
                "-\"cup\"-red",
            ]),
        ),
    ]);
    vec(part, 0..4).prop_map(|parts| parts.join(" ")).boxed()
}

/// What `$text` takes, with other conditions beside it.
fn filter() -> Gen<Document> {
    let options = fields(vec![
        ("$caseSensitive", 25, pick(&[true, false])),
        ("$diacriticSensitive", 25, pick(&[true, false])),
        ("$language", 20, pick(&["none", "english", "en", "", "klingon"])),
    ]);
    (search(), options, 0..8u32)
        .prop_map(|(text, options, beside)| {
            let mut search = doc! { "$search": text };
            search.extend(document(options));
            match beside {
                0 => doc! { "$text": search, "n": 2 },
                1 => doc! { "n": { "$gt": 1 }, "$text": search },
                2 => doc! { "$or": [{ "$text": search }, { "_id": 3 }] },
                _ => doc! { "$text": search },
            }
        })
        .boxed()
}

/// Finding, counting, and pipelines, with and without the score.
pub(crate) fn commands() -> Gen<Document> {
    let score = || doc! { "$meta": "textScore" };
    (filter(), 0..8u32)
        .prop_map(move |(filter, form)| match form {
            0 => doc! { "find": "c", "filter": filter, "projection": { "score": score() }, "sort": { "x": score(), "_id": 1 } },
            1 => doc! { "find": "c", "filter": filter, "projection": { "s": 1, "score": score() }, "sort": { "_id": 1 } },
            2 => doc! { "find": "c", "filter": filter, "sort": { "_id": -1 }, "projection": { "l": 0, "score": score() } },
            3 => doc! { "count": "c", "query": filter },
            4 => doc! {
                "aggregate": "c", "cursor": {},
                "pipeline": [
                    { "$match": filter }, { "$project": { "_id": 1, "twice": { "$multiply": [2, score()] } } },
                    { "$sort": { "_id": 1 } },
                ],
            },
            5 => doc! {
                "aggregate": "c", "cursor": {},
                "pipeline": [{ "$match": filter }, { "$sort": { "by": score(), "_id": 1 } }, { "$limit": 3 }],
            },
            6 => doc! {
                "aggregate": "c", "cursor": {},
                "pipeline": [
                    { "$match": filter }, { "$replaceWith": { "n": "$n" } }, { "$set": { "score": score() } },
                    { "$group": { "_id": "$n", "all": { "$max": "$score" } } }, { "$sort": { "_id": 1 } },
                ],
            },
            _ => doc! { "find": "c", "filter": filter },
        })
        .boxed()
}
