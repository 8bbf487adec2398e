//! Strings, numbers and regular expressions of the shell spelling as values.

use bson::raw::CString;
use bson::{Bson, Regex};

/// What a string token stands for, its quotes removed and its escapes decoded.
/// The error is the offset in the token and what is wrong there.
pub(super) fn string(token: &str) -> Result<String, (usize, String)> {
    let inner = token.get(1..token.len().saturating_sub(1)).unwrap_or_default();
    if !inner.contains('\\') {
        return Ok(inner.to_owned());
    }
    let mut text = String::with_capacity(inner.len());
    let mut rest = inner;
    while let Some(slash) = rest.find('\\') {
        text.push_str(&rest[..slash]);
        let at = 1 + inner.len() - rest.len() + slash;
        rest = escape(&rest[slash + 1..], &mut text).map_err(|message| (at, message))?;
    }
    text.push_str(rest);
    Ok(text)
}

/// Decodes the escape at the start of `rest`, after its backslash; returns what follows.
fn escape<'a>(rest: &'a str, text: &mut String) -> Result<&'a str, String> {
    let mut chars = rest.chars();
    let Some(kind) = chars.next() else { return Err("an escape is cut off".to_owned()) };
    let after = chars.as_str();
    let plain = match kind {
        'n' => '\n',
        't' => '\t',
        'r' => '\r',
        'b' => '\u{8}',
        'f' => '\u{c}',
        'v' => '\u{b}',
        '0' if !after.starts_with(|c: char| c.is_ascii_digit()) => '\0',
        '0'..='9' => return Err("octal escapes are not allowed".to_owned()),
        'x' => {
            let (code, after) = hex(after, 2)?;
            text.push(char::from_u32(code).unwrap_or('\u{FFFD}'));
            return Ok(after);
        }
        'u' => return unicode(after, text),
        '\r' => return Ok(after.strip_prefix('\n').unwrap_or(after)),
        '\n' => return Ok(after),
        other => other,
    };
    text.push(plain);
    Ok(after)
}

/// `XXXX`, a pair of them, or `{X…}`.
fn unicode<'a>(rest: &'a str, text: &mut String) -> Result<&'a str, String> {
    if let Some(rest) = rest.strip_prefix('{') {
        let (digits, after) = rest.split_once('}').ok_or("expected `}` after `\\u{`")?;
        let code = u32::from_str_radix(digits, 16).ok().and_then(char::from_u32);
        text.push(code.ok_or_else(|| format!("`\\u{{{digits}}}` is not a character"))?);
        return Ok(after);
    }
    let (first, after) = hex(rest, 4)?;
    if let Some(plain) = char::from_u32(first) {
        text.push(plain);
        return Ok(after);
    }
    let lone = || format!("`\\u{first:04x}` is half of a character; its other half must follow");
    let (second, after) = after.strip_prefix("\\u").and_then(|after| hex(after, 4).ok()).ok_or_else(lone)?;
    let pair = char::decode_utf16([first as u16, second as u16]).next().and_then(Result::ok);
    text.push(pair.ok_or_else(lone)?);
    Ok(after)
}

fn hex(text: &str, width: usize) -> Result<(u32, &str), String> {
    let digits = text.get(..width).filter(|digits| digits.bytes().all(|byte| byte.is_ascii_hexdigit()));
    let digits = digits.ok_or_else(|| format!("expected {width} hexadecimal digits"))?;
    let code = u32::from_str_radix(digits, 16).map_err(|error| error.to_string())?;
    Ok((code, text.get(width..).unwrap_or_default()))
}

/// An integer becomes the smallest type that holds it exactly.
pub(super) fn integer(value: i64) -> Bson {
    i32::try_from(value).map_or(Bson::Int64(value), Bson::Int32)
}

/// What a number token stands for.
pub(super) fn number(token: &str) -> Result<Bson, String> {
    let (sign, digits) = match token.as_bytes().first() {
        Some(b'-') => ("-", &token[1..]),
        Some(b'+') => ("", &token[1..]),
        _ => ("", token),
    };
    if let Some(hex) = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        let value = i64::from_str_radix(&format!("{sign}{hex}"), 16);
        return value.map(integer).map_err(|_| "the number does not fit into 64 bits".to_owned());
    }
    match digits {
        "Infinity" if sign.is_empty() => return Ok(Bson::Double(f64::INFINITY)),
        "Infinity" => return Ok(Bson::Double(f64::NEG_INFINITY)),
        "NaN" => return Ok(Bson::Double(f64::NAN)),
        _ => {}
    }
    let text = format!("{sign}{digits}");
    if let Ok(value) = text.parse::<i64>() {
        return Ok(integer(value));
    }
    let value: f64 = text.parse().map_err(|_| format!("`{token}` is not a number"))?;
    if value.is_infinite() {
        return Err("the number is too large for a double; write `Infinity` if that is meant".to_owned());
    }
    Ok(Bson::Double(value))
}

/// A regular expression with the options MongoDB knows.
pub(super) fn regex(pattern: &str, options: &str) -> Result<Bson, String> {
    if let Some(odd) = options.chars().find(|option| !"imsxul".contains(*option)) {
        return Err(format!("MongoDB knows no regular expression option `{odd}`, only i, l, m, s, u and x"));
    }
    any_regex(pattern, options)
}

/// A regular expression as it comes; only the NUL that BSON cannot hold is refused.
pub(super) fn any_regex(pattern: &str, options: &str) -> Result<Bson, String> {
    let mut sorted: Vec<char> = options.chars().collect();
    sorted.sort_unstable();
    let options: String = sorted.into_iter().collect();
    match (CString::try_from(pattern.to_owned()), CString::try_from(options)) {
        (Ok(pattern), Ok(options)) => Ok(Bson::RegularExpression(Regex { pattern, options })),
        _ => Err("a regular expression cannot hold a NUL".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decodes_the_escapes_of_javascript() {
        assert_eq!(string(r#"'\x41\u00e9\u{1F600}\ud83d\ude00\0\q\'\n'"#).unwrap(), "A\u{e9}😀😀\0q'\n");
    }

    #[test]
    fn names_the_place_of_a_bad_escape() {
        for token in [r"'ab\ud800'", r"'ab\x4'", r"'ab\u{110000}'", r"'ab\012'"] {
            assert_eq!(string(token).unwrap_err().0, 3, "{token}");
        }
    }

    #[test]
    fn keeps_integers_exact_and_gives_them_the_smallest_type() {
        assert_eq!(number("2147483647"), Ok(Bson::Int32(i32::MAX)));
        assert_eq!(number("2147483648"), Ok(Bson::Int64(2_147_483_648)));
        assert_eq!(number("9007199254740993"), Ok(Bson::Int64(9_007_199_254_740_993)));
        assert_eq!(number("-9223372036854775808"), Ok(Bson::Int64(i64::MIN)));
        assert_eq!(number("9223372036854775808"), Ok(Bson::Double(9_223_372_036_854_775_808.0)));
        assert_eq!(number("0x1F"), Ok(Bson::Int32(31)));
        assert_eq!(number("+.5"), Ok(Bson::Double(0.5)));
        assert_eq!(number("1."), Ok(Bson::Double(1.0)));
        assert_eq!(number("1e3"), Ok(Bson::Double(1000.0)));
        assert!(number("1e999").is_err());
    }
}
