//! The comparisons in the code of a tag, which get their places.
//!
//! minijinja has no hook for its operators, so a filter beside an operand looks at what is compared: `a == 3` becomes
//! `a|_before(n, '==', 3)==3`, and `a == b` becomes `a|_left(n)==b|_right(n, '==')`. What a literal decides is left alone, so
//! that `r.kind == 'block'` costs nothing.

/// The filters: of an operand that stands before a literal, of one behind a literal, and of two that are no literals.
pub(super) const BEFORE: &str = "_before";
/// See [`BEFORE`].
pub(super) const AFTER: &str = "_after";
/// See [`BEFORE`].
pub(super) const LEFT: &str = "_left";
/// See [`BEFORE`].
pub(super) const RIGHT: &str = "_right";

/// Words that end an operand, and are none themselves.
const ENDS: [&str; 6] = ["and", "or", "not", "if", "else", "recursive"];

/// A stretch of the code, as offsets.
pub(super) type Stretch = (usize, usize);

/// A comparison, and what is added to the code for it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Comparison {
    pub(super) left: Stretch,
    pub(super) right: Stretch,
    /// Offsets and what is added there, given the number of the place; in the order of the offsets.
    additions: Vec<(usize, Addition)>,
}

#[derive(Debug, PartialEq, Eq)]
enum Addition {
    Open,
    /// The filter with what follows the number of the place.
    Filter {
        name: &'static str,
        rest: String,
        closes: bool,
    },
}

impl Comparison {
    /// What is added at each offset, where the comparison's place has this number.
    pub(super) fn additions(&self, site: usize) -> impl Iterator<Item = (usize, String)> {
        self.additions.iter().map(move |(at, addition)| match addition {
            Addition::Open => (*at, "(".to_owned()),
            Addition::Filter { name, rest, closes } => {
                (*at, format!("{}|{name}({site}{rest})", if *closes { ")" } else { "" }))
            }
        })
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TokenKind {
    Word,
    Number,
    Text,
    Mark,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Token<'a> {
    pub(super) kind: TokenKind,
    start: usize,
    pub(super) text: &'a str,
}

impl Token<'_> {
    pub(super) fn end(&self) -> usize {
        self.start + self.text.len()
    }
}

/// An open bracket, or the code as a whole.
#[derive(Debug, Default)]
struct Level {
    /// The first token of the operand that is being read.
    from: usize,
    /// The operands before it, as tokens, each with the operator behind it.
    chain: Vec<((usize, usize), &'static str)>,
}

/// The comparisons in the code of a tag, which may have its brackets.
pub(super) fn comparisons(code: &str) -> Vec<Comparison> {
    if !code.contains(['=', '<', '>']) && !code.contains("in") {
        return Vec::new();
    }
    let is_statement = code.starts_with("{%");
    let tokens = tokens(code, is_statement);
    let mut found = Vec::new();
    let mut levels = vec![Level::default()];
    let is_loop = is_statement && tokens.first().is_some_and(|token| token.text == "for");
    let mut has_loop_in = false;
    let mut skipped = false;
    for (at, token) in tokens.iter().enumerate() {
        if std::mem::take(&mut skipped) {
            continue;
        }
        let before = |back: usize| at.checked_sub(back).and_then(|at| tokens.get(at)).map_or("", |token| token.text);
        let is_test = before(1) == "is" || (before(1) == "not" && before(2) == "is");
        let is_attribute = matches!(before(1), "." | "|");
        let next = tokens.get(at + 1).map_or("", |token| token.text);
        let depth = levels.len();
        let Some(level) = levels.last_mut() else { break };
        let operator = match (token.kind, token.text) {
            (TokenKind::Mark, mark) => ["==", "!=", "<=", ">=", "<", ">"].into_iter().find(|known| *known == mark),
            (TokenKind::Word, "not") if !is_attribute && before(1) != "is" && next == "in" => Some("in"),
            (TokenKind::Word, "in") if is_loop && depth == 1 && !has_loop_in => {
                has_loop_in = true;
                level.chain.clear();
                level.from = at + 1;
                continue;
            }
            (TokenKind::Word, "in") if !is_attribute && !is_test => Some("in"),
            _ => None,
        };
        if let Some(operator) = operator {
            level.chain.push(((level.from, at), operator));
            skipped = token.text == "not";
            level.from = at + 1 + usize::from(skipped);
            continue;
        }
        match (token.kind, token.text) {
            (TokenKind::Mark, "(" | "[" | "{") => levels.push(Level { from: at + 1, ..Level::default() }),
            (TokenKind::Mark, ")" | "]" | "}") => {
                finish(level, at, &tokens, code, &mut found);
                if depth > 1 {
                    levels.pop();
                }
            }
            (TokenKind::Mark, "," | ":" | "=") => finish(level, at, &tokens, code, &mut found),
            (TokenKind::Word, word) if !is_attribute && ENDS.contains(&word) && !(word == "not" && is_test) => {
                finish(level, at, &tokens, code, &mut found);
            }
            (TokenKind::Word, _) if is_statement && at == 0 => level.from = 1,
            _ => {}
        }
    }
    if let Some(level) = levels.last_mut() {
        finish(level, tokens.len(), &tokens, code, &mut found);
    }
    found.sort_by_key(|comparison| comparison.left);
    found
}

/// Ends the operand that is being read, and the comparisons that it belongs to.
fn finish(level: &mut Level, at: usize, tokens: &[Token<'_>], code: &str, found: &mut Vec<Comparison>) {
    let chain = std::mem::take(&mut level.chain);
    let last = (std::mem::replace(&mut level.from, at + 1), at);
    let operands: Vec<(usize, usize)> = chain.iter().map(|(operand, _)| *operand).chain([last]).collect();
    let operands: Option<Vec<Operand<'_>>> =
        operands.into_iter().map(|(from, to)| Operand::of(tokens.get(from..to)?, code)).collect();
    let Some(operands) = operands else { return };
    for (pair, (_, operator)) in operands.windows(2).zip(&chain) {
        if let [left, right] = pair {
            found.extend(watched(left, operator, right, chain.len() == 1));
        }
    }
}

/// What one side of a comparison is.
#[derive(Debug, PartialEq, Eq)]
enum Literal {
    /// A number, or a text that reads as one or as an ObjectId.
    Numeric,
    /// A list that has such elements, and none but literals.
    NumericList,
    Text,
    /// Truth values, none, and lists without numbers.
    Other,
}

#[derive(Debug)]
struct Operand<'a> {
    stretch: Stretch,
    text: &'a str,
    /// What it is where it is written in the template itself.
    literal: Option<Literal>,
    /// Whether a filter behind it would be the filter of a part of it.
    needs_brackets: bool,
}

impl<'a> Operand<'a> {
    fn of(tokens: &[Token<'_>], code: &'a str) -> Option<Self> {
        let stretch = (tokens.first()?.start, tokens.last()?.end());
        let is_operator = |token: &Token<'_>| match token.kind {
            TokenKind::Mark => matches!(token.text, "+" | "-" | "*" | "/" | "~" | "%" | "//" | "**"),
            kind => kind == TokenKind::Word && token.text == "is",
        };
        let needs_brackets = tokens.iter().any(is_operator);
        Some(Self { stretch, text: code.get(stretch.0..stretch.1)?, literal: literal(tokens), needs_brackets })
    }

    /// The filter behind it.
    fn filtered(&self, name: &'static str, rest: String) -> Vec<(usize, Addition)> {
        let open = self.needs_brackets.then_some((self.stretch.0, Addition::Open));
        let filter = (self.stretch.1, Addition::Filter { name, rest, closes: self.needs_brackets });
        open.into_iter().chain([filter]).collect()
    }
}

fn literal(tokens: &[Token<'_>]) -> Option<Literal> {
    let is_numeric = |token: &Token<'_>| match token.kind {
        TokenKind::Number => true,
        TokenKind::Text => {
            let text = token.text.trim_matches(['"', '\'']).trim();
            let is_object_id = text.len() == 24 && text.chars().all(|c| c.is_ascii_hexdigit());
            is_object_id || text.parse::<f64>().is_ok()
        }
        _ => false,
    };
    match tokens {
        [one] if is_numeric(one) => Some(Literal::Numeric),
        [sign, one] if sign.text == "-" && one.kind == TokenKind::Number => Some(Literal::Numeric),
        // An escape is not read here.
        [one] if one.kind == TokenKind::Text && !one.text.contains('\\') => Some(Literal::Text),
        [one] if matches!(one.text, "true" | "false" | "none" | "True" | "False" | "None") => Some(Literal::Other),
        [open, elements @ .., close] if matches!((open.text, close.text), ("[", "]") | ("(", ")")) => {
            let is_plain = |token: &Token<'_>| {
                matches!(token.kind, TokenKind::Number | TokenKind::Text) || matches!(token.text, "," | "-")
            };
            let is_list = elements.iter().all(is_plain);
            let has_numbers = elements.iter().any(is_numeric);
            is_list.then_some(if has_numbers { Literal::NumericList } else { Literal::Other })
        }
        _ => None,
    }
}

/// The comparison, unless what is written decides that its sides are alike or need not be.
fn watched(left: &Operand<'_>, operator: &str, right: &Operand<'_>, is_alone: bool) -> Option<Comparison> {
    let is_ordered = operator.starts_with(['<', '>']);
    let may_differ = |literal: &Literal| is_ordered || matches!(literal, Literal::Numeric | Literal::NumericList);
    let additions = match (&left.literal, &right.literal) {
        (Some(_), Some(_)) if !is_ordered => return None,
        (None, Some(literal)) if may_differ(literal) => {
            left.filtered(BEFORE, format!(", '{operator}', {}", right.text))
        }
        (Some(literal), None) if may_differ(literal) => right.filtered(AFTER, format!(", '{operator}', {}", left.text)),
        (None, Some(_)) | (Some(_), None) => return None,
        // In `a < b < c`, minijinja leaves out `c` where the first comparison fails, and with it what was kept for it.
        _ if !is_alone => return None,
        _ => {
            let mut both = left.filtered(LEFT, String::new());
            both.extend(right.filtered(RIGHT, format!(", '{operator}'")));
            both
        }
    };
    Some(Comparison { left: left.stretch, right: right.stretch, additions })
}

/// The tokens of the code, without its brackets.
pub(super) fn tokens(code: &str, is_statement: bool) -> Vec<Token<'_>> {
    let inner = if is_statement { code.strip_suffix("%}").unwrap_or(code) } else { code };
    let inner = if is_statement { inner.trim_end_matches(['-', '+']) } else { inner };
    let mut at = if is_statement { 2 + usize::from(inner[2..].starts_with(['-', '+'])) } else { 0 };
    let mut tokens: Vec<Token<'_>> = Vec::new();
    while let Some(c) = inner.get(at..).and_then(|rest| rest.chars().next()) {
        let rest = &inner[at..];
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let (kind, length) = match c {
            _ if c.is_whitespace() => {
                at += c.len_utf8();
                continue;
            }
            '"' | '\'' => (TokenKind::Text, text_length(rest, c)),
            _ if c.is_ascii_digit() && tokens.last().is_none_or(|token| token.text != ".") => {
                let is_digit = |c: char| is_word(c) || c == '.';
                (TokenKind::Number, rest.find(|c| !is_digit(c)).unwrap_or(rest.len()))
            }
            _ if is_word(c) => (TokenKind::Word, rest.find(|c| !is_word(c)).unwrap_or(rest.len())),
            _ => {
                let is_pair = ["==", "!=", "<=", ">=", "//", "**"].iter().any(|pair| rest.starts_with(pair));
                (TokenKind::Mark, if is_pair { 2 } else { c.len_utf8() })
            }
        };
        tokens.push(Token { kind, start: at, text: &rest[..length] });
        at += length;
    }
    tokens
}

/// How long the text in quotes is with which the code begins.
fn text_length(code: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in code.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            _ if c == quote => return at + 1,
            _ => {}
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The code with what is added to it.
    fn added(code: &str) -> String {
        let all = comparisons(code);
        let mut additions: Vec<_> = all.iter().enumerate().flat_map(|(site, one)| one.additions(site)).collect();
        additions.sort_by_key(|(at, _)| *at);
        let mut text = String::new();
        let mut done = 0;
        for (at, addition) in additions {
            text.push_str(&code[done..at]);
            text.push_str(&addition);
            done = at;
        }
        text + &code[done..]
    }

    #[test]
    fn operands_get_filters_where_their_types_may_differ() {
        for (code, wanted) in [
            ("{% if r.n == 3 %}", "{% if r.n|_before(0, '==', 3) == 3 %}"),
            ("{%- if '3' != r['n'] -%}", "{%- if '3' != r['n']|_after(0, '!=', '3') -%}"),
            ("r.n + 1 > '3' and x", "(r.n + 1)|_before(0, '>', '3') > '3' and x"),
            ("not a.x == b.y", "not a.x|_left(0) == b.y|_right(0, '==')"),
            (
                "{% for r in q('n', {'a': x < y}) if r.n in [1, '2'] %}",
                "{% for r in q('n', {'a': x|_left(0) < y|_right(0, '<')}) if r.n|_before(1, 'in', [1, '2']) in [1, '2'] %}",
            ),
            ("a if b not in c else d", "a if b|_left(0) not in c|_right(0, 'in') else d"),
            ("1 < r.n <= -5", "1 < r.n|_after(0, '<', 1)|_before(1, '<=', -5) <= -5"),
            ("f(a=b == c, d=1)", "f(a=b|_left(0) == c|_right(0, '=='), d=1)"),
            ("(a == b) == c", "(a|_left(1) == b|_right(1, '=='))|_left(0) == c|_right(0, '==')"),
            ("r.kind < 'm'", "r.kind|_before(0, '<', 'm') < 'm'"),
        ] {
            assert_eq!(added(code), wanted);
        }
        for code in [
            "{% if r.kind == 'block' %}",
            "{% for a, b in c %}",
            "x is in [1] and y is not in z",
            "r.kind in ['a', 'b'] or x == none or r.ok != true",
            "3 == '3'",
            "{% set a = 'b == 3' %}",
            "a < b < c",
            "==",
            "{% if == 3 %}",
            "a == )",
            "{%",
        ] {
            assert_eq!(added(code), code);
        }
    }
}
