//! What the system says, in plain words.

use std::borrow::Cow;

/// What the system says where a file cannot be used, and the same in plain words.
const SYSTEM: [(&str, &str); 5] = [
    ("No such file or directory (os error 2)", "there is no such file or folder"),
    ("Permission denied (os error 13)", "permission denied"),
    ("Not a directory (os error 20)", "a part of the path is no folder"),
    ("Is a directory (os error 21)", "it is a folder"),
    ("No space left on device (os error 28)", "no space is left on the device"),
];

/// Returns a message with the words of the system in plain ones.
pub(crate) fn words(text: &str) -> Cow<'_, str> {
    if !text.contains("(os error ") {
        return Cow::Borrowed(text);
    }
    Cow::Owned(SYSTEM.iter().fold(text.to_owned(), |text, (system, plain)| text.replace(system, plain)))
}
