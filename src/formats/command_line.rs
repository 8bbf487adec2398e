//! Words of a shell's command line, for commands that can be pasted.

/// Returns a text as one word: as it is where nothing in it means something to a POSIX shell, else in quotes.
#[must_use]
pub fn word(text: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    // What means something inside of double quotes; `!` does to an interactive bash.
    let is_special = |c: char| matches!(c, '$' | '`' | '"' | '\\' | '!');
    if !text.is_empty() && text.chars().all(is_plain) {
        text.to_owned()
    } else if text.contains(is_special) && (text.contains('!') || !text.contains('\'')) {
        format!("'{}'", text.replace('\'', "'\\''"))
    } else {
        let escape = |c: char| is_special(c).then_some('\\').into_iter().chain([c]);
        format!("\"{}\"", text.chars().flat_map(escape).collect::<String>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_a_shell_would_change_them() {
        for (text, wanted) in [
            ("robmem.orders", "robmem.orders"),
            ("", "\"\""),
            ("my robots", "\"my robots\""),
            ("{}", "\"{}\""),
            ("bob's #1", "\"bob's #1\""),
            ("{n: {$gt: 3}}", "'{n: {$gt: 3}}'"),
            ("{$set: {n: 'x'}}", "\"{\\$set: {n: 'x'}}\""),
            ("it's! $5", "'it'\\''s! $5'"),
            ("~", "\"~\""),
        ] {
            assert_eq!(word(text), wanted);
        }
    }
}
