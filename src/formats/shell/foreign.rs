//! Values of Python and other languages, and how they are written here.

/// Words at the place of a value, and what to write.
const WORDS: [(&[&str], &str); 8] = [
    (&["True", "TRUE"], "Python's True is written true"),
    (&["False", "FALSE"], "Python's False is written false"),
    (&["None", "nil", "NULL", "Null", "nullptr"], "Python's None is written null"),
    (&["nan", "NAN"], "not a number is written NaN"),
    (&["inf", "infinity", "INFINITY"], "infinity is written Infinity"),
    (
        &["datetime", "datetime.datetime", "datetime.date", "date"],
        "a date is written ISODate(\"2026-01-31T12:00:00Z\")",
    ),
    (
        &["array", "np.array", "numpy.array", "tuple", "set", "frozenset", "list", "deque"],
        "an array is written [1, 2]; in Python, print(json.dumps(document)) writes it so",
    ),
    (
        &["OrderedDict", "defaultdict", "dict", "collections.OrderedDict"],
        "a document is written {key: 'value'}; in Python, print(json.dumps(document)) writes it so",
    ),
];

/// Comparisons of other languages, the longer ones first, and the operators for them.
const COMPARISONS: [(&str, &str); 6] =
    [(">=", "$gte"), ("<=", "$lte"), ("!=", "$ne"), ("<>", "$ne"), (">", "$gt"), ("<", "$lt")];

/// What to write instead of the text that is not a value.
pub(super) fn hint(text: &str) -> Option<String> {
    if text.starts_with('(') {
        return Some("Python's tuple is written as an array: [1, 2]".to_owned());
    }
    let comparison = COMPARISONS.iter().find(|(signs, _)| text.starts_with(signs));
    if let Some((signs, operator)) = comparison {
        return Some(format!("`{signs}` is written {{{operator}: 1}}"));
    }
    let end = text.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '.'))).unwrap_or(text.len());
    let word = text.get(..end).unwrap_or_default();
    let after = text.get(end..).unwrap_or_default();
    if matches!(word.to_lowercase().as_str(), "u" | "b" | "r" | "f" | "rb" | "br") && after.starts_with(['"', '\'']) {
        return Some(format!("leave out the `{word}` before the string"));
    }
    let known = WORDS.iter().find(|(words, _)| words.contains(&word)).map(|(_, hint)| (*hint).to_owned());
    known.or_else(|| {
        let is_numpy = word.starts_with("np.") || word.starts_with("numpy.");
        is_numpy.then(|| "write the plain number; in Python, value.item() gives it".to_owned())
    })
}

/// What to write instead of a word that is not a value.
pub(super) fn hint_of_word(text: &str) -> String {
    hint(text).unwrap_or_else(|| "strings are written in quotes".to_owned())
}

#[cfg(test)]
mod tests {
    use crate::formats::Source;
    use crate::formats::shell::parse_document;

    #[test]
    fn missing_braces_and_values_are_named() {
        for (text, place, hint) in [
            ("{battery: $gt: 0.6}", "1:11", "a key and its value stand in braces: {$gt: 0.6}"),
            ("{a: $in: [1, 2], b: 3}", "1:5", "stand in braces: {$in: [1, 2]}"),
            ("{a: $gt:}", "1:5", "stand in braces: {$gt: …}"),
            ("{a: [b: 1]}", "1:6", "stand in braces: {b: 1}"),
            ("$set: {is: 'open'}", "1:1", "a document is written in braces: {$set: {is: 'open'}}"),
            ("a: 1, b: {c: 2}", "1:1", "a document is written in braces: {a: 1, b: {c: 2}}"),
            ("({relation: 'robot'})", "1:1", "leave out the parentheses: {relation: 'robot'}"),
            ("([{$match: {}}])", "1:1", "leave out the parentheses: [{$match: {}}]"),
            ("(1, 2)", "1:1", "Python's tuple"),
            ("{name}", "1:6", "`name` needs a value: {name: 1}"),
            ("{name, b: 1}", "1:6", "`name` needs a value: {name: 1}"),
        ] {
            let error = parse_document(&Source::new("<argument>", text)).unwrap_err();
            assert!(error.to_string().starts_with(&format!("<argument>:{place}: ")), "{text}: {error}");
            assert!(matches!(error.hints(), [only] if only.contains(hint)), "{text}: {error}");
        }
        let open = parse_document(&Source::new("<argument>", "{name")).unwrap_err();
        assert!(open.to_string().contains("is not closed"), "{open}");
        let pipeline =
            crate::formats::shell::parse_pipeline(&Source::new("<pipeline>", "[$match: {a: 1}]")).unwrap_err();
        assert!(pipeline.to_string().contains("stand in braces: {$match: {a: 1}}"), "{pipeline}");
    }

    #[test]
    fn a_dictionary_of_python_gets_a_hint_that_fits() {
        for (text, place, hint) in [
            ("{'tidied': True}", "1:12", "written true"),
            ("{'tidied': [False]}", "1:13", "written false"),
            ("{'carries': None}", "1:13", "written null"),
            ("{'seen': datetime.datetime(2026, 1, 31)}", "1:10", "ISODate("),
            ("{'pose': (1, 2)}", "1:10", "as an array: [1, 2]"),
            ("{'name': u'A'}", "1:10", "leave out the `u`"),
            ("{'x': np.float64(1.5)}", "1:7", "plain number"),
            ("{'x': nan}", "1:7", "NaN"),
            ("{'x': array([1, 2])}", "1:7", "an array is written [1, 2]"),
            ("{'x': set()}", "1:7", "an array is written [1, 2]"),
            ("{'x': set([1)}", "1:7", "an array is written [1, 2]"),
            ("{'x': >= 2}", "1:7", "`>=` is written {$gte: 1}"),
            ("{'x': red}", "1:7", "strings are written in quotes"),
            ("{url: http://x}", "1:7", "strings are written in quotes"),
        ] {
            let error = parse_document(&Source::new("<argument>", text)).unwrap_err().to_string();
            assert!(error.starts_with(&format!("<argument>:{place}: ")) && error.contains(hint), "{text}: {error}");
        }
        assert!(parse_document(&Source::new("t", "{'a': 'it is', \"b\": [1, 2.5,], 'c': {},}")).is_ok());
    }
}
