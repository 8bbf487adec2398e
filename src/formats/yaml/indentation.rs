//! Lists and mappings in brackets, and texts in quotes, that go on in a line which is not indented. YAML's grammar wants
//! such a line to be indented more than the key that the value belongs to; PyYAML and ruamel do not, and files of ROS are
//! written so. Blanks at the beginning of such a line say nothing, so these lines are read as if they had more of them.

use std::borrow::Cow;

use saphyr_parser::{Parser, ScanError};

/// What the parser says of such a line, and whether that is at the line itself; else it is at the text's first quote.
const LINE: [&str; 2] = ["invalid indentation", "invalid indentation in flow construct"];
const QUOTED: &str = "invalid indentation in quoted scalar";
/// At most so many bytes are read again to find further lines.
const MOST_REREAD: usize = 32 << 20;
/// At most so many blanks are put in front of a line: no key stands further to the right.
const MOST_BLANKS: usize = 200;

/// Returns what to do where the parser complains about such a line.
pub(super) fn hint(message: &str) -> Option<&'static str> {
    let is_known = message == QUOTED || LINE.contains(&message);
    is_known.then_some("indent a line in which a value goes on by one more blank than its key")
}

/// A text with these lines indented.
pub(super) struct Indented<'t> {
    pub(super) text: Cow<'t, str>,
    /// Where blanks were put, as offsets in the text, and how many; in this order.
    added: Vec<(usize, usize)>,
}

impl<'t> Indented<'t> {
    /// The text as it is, where there is no such line; or too many of them.
    pub(super) fn of(text: &'t str) -> Self {
        let written = Self { text: text.into(), added: Vec::new() };
        if !goes_on(text) {
            return written;
        }
        let mut indented = Self { text: text.into(), added: Vec::new() };
        let mut left = MOST_REREAD;
        while let Some(lines) = unindented(&indented.text) {
            let is_new = |line: &usize| indented.added.iter().all(|(at, _)| at != line);
            match left.checked_sub(indented.text.len()) {
                Some(less) if lines.iter().all(is_new) => left = less,
                _ => return written,
            }
            indented.indent(&lines);
        }
        indented
    }

    /// The offset in the text as it was written.
    pub(super) fn original(&self, offset: usize) -> usize {
        let before = self.added.iter().take_while(|(at, _)| *at < offset);
        let added: usize = before.map(|(at, length)| (*length).min(offset - at)).sum();
        offset - added
    }

    /// Puts blanks in front of lines, which are offsets in ascending order.
    fn indent(&mut self, lines: &[usize]) {
        let until = lines.last().copied().unwrap_or_default();
        let before = self.text.get(..until).unwrap_or_default();
        let blanks = before.lines().map(str::len).max().unwrap_or_default().clamp(1, MOST_BLANKS);
        let mut text = String::with_capacity(self.text.len() + lines.len() * blanks);
        let mut copied = 0;
        for line in lines {
            text.push_str(self.text.get(copied..*line).unwrap_or_default());
            text.extend(std::iter::repeat_n(' ', blanks));
            copied = *line;
        }
        text.push_str(self.text.get(copied..).unwrap_or_default());
        let moved = |at: usize| at + blanks * lines.iter().filter(|line| **line <= at).count();
        let mut added: Vec<(usize, usize)> = self.added.iter().map(|(at, length)| (moved(*at), *length)).collect();
        added.extend(lines.iter().enumerate().map(|(nth, line)| (line + nth * blanks, blanks)));
        added.sort_unstable();
        *self = Self { text: text.into(), added };
    }
}

/// Whether a bracket or a quote may be open at the end of a line.
fn goes_on(text: &str) -> bool {
    let count = |line: &str, mark: &[char]| line.matches(mark).count();
    text.lines().any(|line| {
        count(line, &['[', '{']) > count(line, &[']', '}'])
            || count(line, &['"']) % 2 == 1
            || count(line, &['\'']) % 2 == 1
    })
}

/// The beginnings of the lines to indent that come first.
fn unindented(text: &str) -> Option<Vec<usize>> {
    let mut parser = Parser::new_from_str(text);
    let error: ScanError = loop {
        match parser.next_event()? {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    let at = text.char_indices().nth(error.marker().index()).map_or(text.len(), |(at, _)| at);
    match error.info() {
        QUOTED => quoted(text, at),
        message if LINE.contains(&message) => Some(in_brackets(text, at)),
        _ => None,
    }
}

/// The lines, from that of a place in brackets on, up to where the brackets close.
fn in_brackets(text: &str, at: usize) -> Vec<usize> {
    let mut lines = vec![text.get(..at).and_then(|before| before.rfind('\n')).map_or(0, |end| end + 1)];
    let (mut depth, mut quote, mut before) = (0_usize, None, ' ');
    let mut characters = text.get(at..).unwrap_or_default().char_indices().peekable();
    while let Some((offset, character)) = characters.next() {
        match (quote, character) {
            (_, '\n') => lines.push(at + offset + 1),
            (Some('"'), '\\') => drop(characters.next_if(|(_, next)| *next != '\n')),
            (Some(open), _) if open == character => quote = None,
            (Some(_), _) => {}
            // A quote inside of a word is a character of it.
            (None, '"' | '\'') if !before.is_alphanumeric() => quote = Some(character),
            (None, '#') if before.is_whitespace() => while characters.next_if(|(_, next)| *next != '\n').is_some() {},
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') if depth == 0 => break,
            (None, ']' | '}') => depth -= 1,
            (None, _) => {}
        }
        before = character;
    }
    lines
}

/// The lines, behind the first, of the text in quotes that begins at a place.
fn quoted(text: &str, at: usize) -> Option<Vec<usize>> {
    let mut characters = text.get(at..)?.char_indices();
    let (_, quote) = characters.next()?;
    let (mut lines, mut is_escaped) = (Vec::new(), false);
    for (offset, character) in characters {
        match character {
            '\n' => lines.push(at + offset + 1),
            _ if character == quote && !is_escaped => break,
            _ => {}
        }
        is_escaped = character == '\\' && quote == '"' && !is_escaped;
    }
    (!lines.is_empty()).then_some(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_lead_back_to_the_text_as_it_was_written() {
        let text = "p:\n  a: [\"x\",\n  \"y\",\n\"z\"]\nb: {c: 1,\nd: 2}\n";
        let indented = Indented::of(text);
        assert!(indented.text.len() > text.len());
        let mut last = 0;
        for (offset, character) in indented.text.char_indices() {
            let original = indented.original(offset);
            assert!(original >= last && original <= offset);
            if character != ' ' {
                assert_eq!(text[original..].chars().next(), Some(character), "{offset}");
            }
            last = original;
        }
        for text in ["a: [1,\n  2]\n", "a: 1\nb: 2\n", "a: [1\nb: 2\n", "a: \"x\n  y\"\n"] {
            assert_eq!(Indented::of(text).text, text);
        }
    }
}
