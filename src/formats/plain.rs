//! What the system says, in plain words.

use std::borrow::Cow;

/// What the system says where a file cannot be used, and the same in plain words.
const SYSTEM: [(&str, &str); 6] = [
    ("No such file or directory (os error 2)", "there is no such file or folder"),
    ("Permission denied (os error 13)", "permission denied"),
    ("Not a directory (os error 20)", "a part of the path is not a folder"),
    ("Is a directory (os error 21)", "it is a folder"),
    ("Too many levels of symbolic links (os error 40)", "it is a symbolic link that leads back to itself; name a file"),
    ("No space left on device (os error 28)", "the disk is full"),
];

/// Returns a message with the words of the system in plain ones.
pub(crate) fn words(text: &str) -> Cow<'_, str> {
    // The words of the standard library, where the name of a temporary file was left out.
    if let Some(doing) = text.strip_suffix("no storage space") {
        return Cow::Owned(format!("{doing}the disk is full"));
    }
    if !text.contains("(os error ") {
        return Cow::Borrowed(text);
    }
    Cow::Owned(SYSTEM.iter().fold(text.to_owned(), |text, (system, plain)| text.replace(system, plain)))
}

/// What the readers of TOML and JSON expect, and the same in plain words.
const KINDS: [(&str, &str); 14] = [
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number, not negative"),
    ("u64", "a whole number, not negative"),
    ("usize", "a whole number, not negative"),
    ("i32", "a whole number"),
    ("i64", "a whole number"),
    ("f32", "a number"),
    ("f64", "a number"),
    ("a boolean", "true or false"),
    ("a sequence", "an array"),
    ("sequence", "an array"),
    ("unit value", "null"),
    ("a Bson", "an object"),
];

/// Returns a message of the reader of TOML or JSON in plain words: `expected an array, found "x"`. `map` is what has keys
/// there.
pub(crate) fn kinds(message: &str, map: &str) -> String {
    let article = if map.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
    let plain = |word: &str| {
        let is_map = ["map", "a map"].contains(&word) || word.starts_with("struct ");
        let known = || KINDS.iter().find(|(kind, _)| *kind == word).map(|(_, plain)| (*plain).to_owned());
        if is_map { Some(format!("{article} {map}")) } else { known() }
    };
    // `string "x"`, `integer `3``: the value says what it is.
    let value = |found: &str| {
        let kinds = ["string ", "integer ", "floating point ", "boolean ", "character "];
        let value = kinds.iter().find_map(|kind| found.strip_prefix(kind)).map(str::to_owned);
        value.or_else(|| plain(found)).unwrap_or_else(|| found.to_owned())
    };
    let typed = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "));
    match typed.and_then(|typed| typed.rsplit_once(", expected ")) {
        Some((found, expected)) => {
            let expected = plain(expected).unwrap_or_else(|| expected.to_owned());
            format!("expected {expected}, found {}", value(found))
        }
        None => message.replace("unknown variant `", "unknown value `"),
    }
}

#[cfg(test)]
mod tests {
    use super::{kinds, words};

    #[test]
    fn a_full_disk_has_one_name() {
        let full = std::io::Error::from_raw_os_error(28);
        let unnamed = std::io::Error::from(full.kind());
        for error in [full, unnamed] {
            assert_eq!(words(&format!("cannot write x: {error}")), "cannot write x: the disk is full");
        }
    }

    #[test]
    fn no_word_of_the_programming_language_is_left() {
        for (message, plain) in [
            ("invalid type: string \"x\", expected u16", "expected a whole number from 0 to 65535, found \"x\""),
            ("invalid value: integer `-1`, expected u64", "expected a whole number, not negative, found `-1`"),
            ("invalid type: floating point `1.5`, expected i64", "expected a whole number, found `1.5`"),
            ("invalid type: map, expected a sequence", "expected an array, found a table"),
            (
                "invalid type: string \"a, expected b\", expected struct Table",
                "expected a table, found \"a, expected b\"",
            ),
            ("invalid type: sequence, expected a string", "expected a string, found an array"),
            ("invalid type: integer `3`, expected a boolean", "expected true or false, found `3`"),
            ("unknown variant `lpg`, expected `ff` or `auto`", "unknown value `lpg`, expected `ff` or `auto`"),
            ("missing field `name`", "missing field `name`"),
        ] {
            assert_eq!(kinds(message, "table"), plain);
        }
        assert_eq!(kinds("invalid type: null, expected a map", "object"), "expected an object, found null");
    }
}
