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

/// What to write instead of the text that is no value.
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

/// What to write instead of a word that is no value.
pub(super) fn hint_of_word(text: &str) -> String {
    hint(text).unwrap_or_else(|| "strings are written in quotes".to_owned())
}

#[cfg(test)]
mod tests {
    use crate::formats::Source;
    use crate::formats::shell::parse_document;

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
        ] {
            let error = parse_document(&Source::new("<argument>", text)).unwrap_err().to_string();
            assert!(error.starts_with(&format!("<argument>:{place}: ")) && error.contains(hint), "{text}: {error}");
        }
        assert!(parse_document(&Source::new("t", "{'a': 'it is', \"b\": [1, 2.5,], 'c': {},}")).is_ok());
    }
}
