//! The goal: the one PDDL text that enters a problem from outside.

use super::names;
use crate::formats::{Diagnostic, Source, Span};

/// Checks that the text is one or more expressions in parentheses and nothing
/// else. One stays as it is; several are joined by `and`. Comments are dropped. Names may be the memory's own.
pub(super) fn parse(text: &str) -> Result<String, Diagnostic> {
    let source = Source::new("<goal>", text);
    let complain = |offset: usize, message: &str| Err(Diagnostic::new(&source, Span::at(offset), message));
    let is_forbidden = |c: char| !c.is_whitespace() && (c.is_control() || ('\u{FDD0}'..='\u{FDEF}').contains(&c));
    let (mut depth, mut expressions) = (0_usize, 0);
    let mut goal = String::with_capacity(text.len());
    for (offset, token) in names::tokens(text).filter(|(_, token)| !token.starts_with(';')) {
        match token {
            "(" => {
                expressions += usize::from(depth == 0);
                depth += 1;
            }
            ")" if depth == 0 => return complain(offset, "`)` closes what is not open"),
            ")" => depth -= 1,
            _ if token.trim().is_empty() => {}
            _ if depth == 0 => return complain(offset, "expected a goal in parentheses, like `(on A B)`"),
            _ => {}
        }
        if names::is_open(token) {
            return complain(offset, "this text has no closing `\"`");
        }
        if let Some(at) = token.find(is_forbidden) {
            return complain(offset + at, "a goal cannot hold this character");
        }
        goal.push_str(&names::spell_token(token));
    }
    if depth > 0 {
        return complain(text.len(), "expected `)`, found the end of the goal");
    }
    match expressions {
        0 => complain(0, "expected a goal in parentheses, like `(on A B)`"),
        1 => Ok(goal.trim().to_owned()),
        _ => Ok(format!("(and {})", goal.trim())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_expression_stays_and_several_are_joined() {
        assert_eq!(parse(" (on A B)\n").unwrap(), "(on A B)");
        assert_eq!(parse("(on A B) (on B C)").unwrap(), "(and (on A B) (on B C))");
        assert_eq!(parse("(and (a) ; b)\n (c))").unwrap(), "(and (a) \n (c))");
    }

    #[test]
    fn what_is_not_balanced_is_refused_at_its_place() {
        for (text, place) in [
            ("(on A B", "1:8"),
            ("(on \"A B)", "1:5"),
            ("(on \"A\\\" B)", "1:5"),
            ("(on \"", "1:5"),
            ("(on A))", "1:7"),
            ("", "1:1"),
            ("on A B", "1:1"),
            ("(a) b", "1:5"),
            ("(a) ; b", ""),
        ] {
            match parse(text) {
                Err(error) => assert!(error.to_string().starts_with(&format!("<goal>:{place}: ")), "{text}: {error}"),
                Ok(goal) => assert_eq!((goal.as_str(), place), ("(a)", "")),
            }
        }
    }
}
