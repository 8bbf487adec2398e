//! The function that the text of a predicate is.
//!
//! As in mongod, a text that is not a function is the body of one. Where it has no `return` of its own, the value of its last
//! statement is the function's, if that is an expression. What a statement is, is asked of the engine: it says of a text
//! whether it is a program.

use super::source::{function, words};

/// The most places where a statement may end that are looked at, and the largest text in which they are.
const MOST_PLACES: usize = 500;
const LARGEST_TEXT: usize = 64 << 10;

/// Returns an expression whose value is the function that a predicate is. `parses` says whether a text is a program, in which
/// there is no `return` but in functions.
pub(super) fn predicate(text: &str, parses: &dyn Fn(&str) -> bool) -> String {
    let text = text.trim();
    let engine = Engine { parses };
    if is_arrow_function(text) {
        return function(text);
    }
    if !parses(text) {
        return if is_function(text) { function(text) } else { body(text) };
    }
    let (before, last) = text.split_at(engine.last_statement(text));
    if before.is_empty() && is_function(last) {
        return function(text);
    }
    match engine.is_expression(last) {
        true => format!("(function() {{ {before}\nreturn ({}\n) \n}})", unended(last)),
        false => body(text),
    }
}

fn body(text: &str) -> String {
    format!("(function() {{ {text}\n}})")
}

/// A statement without the `;` at its end.
fn unended(statement: &str) -> &str {
    statement.trim().trim_end_matches([';', ' ', '\n', '\t', '\r'])
}

/// Returns whether a text begins as a function, behind comments.
fn is_function(text: &str) -> bool {
    words(without_comments(text)).next().is_some_and(|(word, at)| at == 0 && word == "function")
}

/// A text without the comments that it begins with.
fn without_comments(text: &str) -> &str {
    let text = text.trim_start();
    let end = if text.starts_with("//") {
        text.find('\n').map(|end| end + 1)
    } else if text.starts_with("/*") {
        text.find("*/").map(|end| end + 2)
    } else {
        None
    };
    end.map_or(text, |end| without_comments(&text[end..]))
}

/// Returns whether a text begins as an arrow function.
fn is_arrow_function(text: &str) -> bool {
    let Some((parameters, _)) = text.split_once("=>") else { return false };
    let parameters = parameters.trim();
    let inner = parameters.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')).unwrap_or(parameters);
    inner.chars().all(|c| c.is_alphanumeric() || " ,_$".contains(c))
}

struct Engine<'a> {
    parses: &'a dyn Fn(&str) -> bool,
}

impl Engine<'_> {
    fn parses(&self, parts: &[&str]) -> bool {
        (self.parses)(&parts.concat())
    }

    /// Where the last statement of a program begins.
    fn last_statement(&self, text: &str) -> usize {
        if text.len() > LARGEST_TEXT {
            return 0;
        }
        let places = text.char_indices().rev().filter(|(_, c)| matches!(c, ';' | '}' | '\n'));
        let ends = places.take(MOST_PLACES).filter(|(place, c)| self.ends_statement(text, *place, *c));
        ends.map(|(place, _)| place + 1).find(|start| !self.is_blank(&text[*start..])).unwrap_or_default()
    }

    /// Whether a statement of a program ends with the sign at a place, and another one, or nothing, follows it.
    fn ends_statement(&self, text: &str, place: usize, sign: char) -> bool {
        let (before, after) = text.split_at(place + 1);
        if !self.parses(&[before]) || !self.parses(&[after]) {
            return false;
        }
        // Within a comment or a string, anything may stand.
        if self.parses(&[before, ")", after]) {
            return false;
        }
        match sign {
            // A block, and not an object or the body of a function that is a value: another statement may follow it.
            '}' => self.parses(&[before, " 0"]),
            // Where the next line could go on with this one, it does.
            '\n' => !self.parses(&[self.without_comment(&text[..place]), " ", after]),
            _ => true,
        }
    }

    /// A program without the comment at the end of its last line.
    fn without_comment<'t>(&self, text: &'t str) -> &'t str {
        let line = text.rfind('\n').map_or(0, |newline| newline + 1);
        let starts = text[line..].match_indices("//").map(|(at, _)| line + at);
        starts.map(|start| &text[..start]).find(|before| self.parses(&[before])).unwrap_or(text)
    }

    /// Whether a program has no statement but empty ones: white space, comments and `;`.
    fn is_blank(&self, program: &str) -> bool {
        let program = unended(program);
        program.is_empty() || self.parses(&["(", program, "\n0)"])
    }

    fn is_expression(&self, statement: &str) -> bool {
        let begins = |word: &str| {
            let rest = statement.trim_start().strip_prefix(word);
            rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$'))
        };
        let is_declaration = ["function", "class", "async function"].into_iter().any(begins);
        !statement.trim_start().starts_with('{') && !is_declaration && self.parses(&["(", unended(statement), "\n)"])
    }
}
