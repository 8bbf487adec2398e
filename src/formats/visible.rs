//! Text for a terminal, in which control characters are visible.
//!
//! Names and values come from documents that anyone may have stored. Printed as they are, escape
//! sequences could change what a terminal shows, or what it does, and bidirectional controls the
//! order in which a line reads (Unicode Technical Report 36, section 2.5).

use std::borrow::Cow;

use unicode_width::{UnicodeWidthChar as _, UnicodeWidthStr as _};

/// Whether a character changes how a terminal shows the text around it.
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(text: &str, is_kept: impl Fn(char) -> bool) -> Cow<'_, str> {
    let is_escaped = |c: char| is_hidden(c) && !is_kept(c);
    if !text.contains(is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut visible = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_escaped(c) { visible.extend(c.escape_default()) } else { visible.push(c) }
    }
    Cow::Owned(visible)
}

/// Returns a text of several lines, with all control characters but line breaks and tabs as escapes.
#[must_use]
pub fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| matches!(c, '\n' | '\t'))
}

/// Returns a text for one line or one cell of a table, with all control characters as escapes.
#[must_use]
pub fn line(text: &str) -> Cow<'_, str> {
    escaped(text, |_| false)
}

/// Returns the text with `…` at its end where it takes more than so many columns of a terminal.
#[must_use]
pub fn cut(text: &str, width: usize) -> String {
    if text.width() <= width {
        return text.to_owned();
    }
    let mut used = 1;
    let fits = |c: &char| {
        used += c.width().unwrap_or_default();
        used <= width
    };
    text.chars().take_while(fits).collect::<String>() + "…"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escape_sequences_and_bidirectional_controls_are_visible() {
        assert_eq!(lines("a\u{1b}[31mb\n\tc\u{9b}d"), "a\\u{1b}[31mb\n\tc\\u{9b}d");
        assert_eq!(line("a\nb\u{202e}c"), "a\\nb\\u{202e}c");
        assert!(matches!(lines("plain, größe, 日本\n"), Cow::Borrowed(_)));
    }
}
