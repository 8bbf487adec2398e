//! Credentials in texts that may be URIs of stores: never shown.

use std::borrow::Cow;
use std::ops::Range;

/// Returns which part of a text may be credentials: what lies between the scheme and the last `@`.
fn secret(text: &str) -> Option<Range<usize>> {
    let end = text.rfind('@')?;
    let before = &text[..end];
    let start = match (before.find(':'), before.find("//")) {
        (Some(colon), Some(slashes)) if colon + 1 < slashes => colon + 1,
        (_, Some(slashes)) => slashes + 2,
        (Some(colon), None) => colon + 1,
        (None, None) => 0,
    };
    Some(start..end)
}

/// Returns a text that may be a URI with `…` for its credentials and for the options of a server:
/// for messages about a text that is no URI.
#[must_use]
pub fn masked(text: &str) -> String {
    let shown = match secret(text) {
        None => without_secret_port(text),
        Some(Range { start, end }) => format!("{}…{}", &text[..start], &text[end..]),
    };
    match shown.split_once('?') {
        Some((front, _)) if names_server(&shown) => format!("{front}?…"),
        _ => shown,
    }
}

/// Whether a text has the scheme of a server, in letters of any case.
fn names_server(text: &str) -> bool {
    text.to_ascii_lowercase().contains("mongodb")
}

/// A text without `@`, in which what stands where a port would, and is none, may be a password.
fn without_secret_port(text: &str) -> String {
    match secret_port(text) {
        None => text.to_owned(),
        Some(Range { start, end }) => format!("{}…{}", &text[..start], &text[end..]),
    }
}

/// Which part of the URI of a server without `@` stands where a port would, and is none.
fn secret_port(text: &str) -> Option<Range<usize>> {
    let start = text.find("//").filter(|_| names_server(text))? + 2;
    let hosts = hosts(&text[start..]);
    let colon = hosts.find(':').filter(|_| !has_ports(hosts))?;
    Some(start + colon + 1..start + hosts.len())
}

/// What lies between credentials and path or options.
pub(crate) fn hosts(rest: &str) -> &str {
    let behind = rest.rsplit_once('@').map_or(rest, |(_, behind)| behind);
    behind.split(['/', '?']).next().unwrap_or_default()
}

/// Whether every host has a number for a port, or none.
pub(crate) fn has_ports(hosts: &str) -> bool {
    let is_port = |port: &str| port.parse::<u16>().is_ok();
    hosts.split(',').all(|host| match host.rsplit_once(':') {
        // An IPv6 address in brackets has colons of its own.
        Some((_, port)) if !host.ends_with(']') => is_port(port),
        _ => true,
    })
}

/// Returns a text of the same length with `*` for the credentials of each URI in it: for excerpts of files,
/// in which positions have to stay.
#[must_use]
pub fn masked_excerpt(text: &str) -> String {
    let in_word = |word: &str| secret(word).filter(|range| range.start > 0).or_else(|| secret_port(word));
    starred(text, |c| c.is_whitespace() || "\"'".contains(c), in_word)
}

/// A text of the same length with `*` for what `secret` finds in each of its words, which end as `is_end` says.
fn starred(text: &str, is_end: fn(char) -> bool, secret: impl Fn(&str) -> Option<Range<usize>>) -> String {
    let mut shown = String::with_capacity(text.len());
    for part in text.split_inclusive(is_end) {
        let Range { start, end } = secret(part.strip_suffix(is_end).unwrap_or(part)).unwrap_or_default();
        shown.extend([&part[..start], &"*".repeat(end - start), &part[end..]]);
    }
    shown
}

/// Returns a text of the same length with `*` for the credentials of each URI in it that names its scheme: for messages and
/// commands, which may repeat what a user wrote anywhere.
#[must_use]
pub fn masked_message(text: &str) -> Cow<'_, str> {
    if !text.contains("://") {
        return Cow::Borrowed(text);
    }
    Cow::Owned(starred(text, |c| c.is_whitespace() || "\"'`".contains(c), user_info))
}

/// How messages write the credentials that a URI may have.
const FORM: &str = "USER:PASSWORD";

/// Which part of a word is the user and the password of a URI. Those of MongoDB may have signs in them that a URI has not.
fn user_info(word: &str) -> Option<Range<usize>> {
    let start = word.find("://")? + 3;
    let rest = &word[start..];
    let end = if names_server(word) { rest.rfind('@') } else { rest.split('/').next()?.rfind('@') };
    end.filter(|end| rest[..*end] != *FORM).map(|end| start..start + end)
}

/// Returns a URI without its credentials.
#[cfg(any(feature = "mongodb", test))]
#[must_use]
pub(crate) fn removed(uri: &str) -> String {
    match secret(uri) {
        None => uri.to_owned(),
        Some(Range { start, end }) => format!("{}{}", &uri[..start], &uri[end + 1..]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_no_uri_is_shown_without_what_may_be_a_password() {
        for (text, shown) in [
            ("mongodb://robot:s3cret@host/?tls=true", "mongodb://…@host/?…"),
            ("mongodb:robot:s3cret@host", "mongodb:…@host"),
            ("robot:s3cret//x@host", "robot:…@host"),
            ("s3cret@host", "…@host"),
            ("file:robot.rmem", "file:robot.rmem"),
            ("MongoDB://robot:s3cret@host/?w=1", "MongoDB://…@host/?…"),
            ("mongodb://robot:s3cret", "mongodb://robot:…"),
        ] {
            assert_eq!(masked(text), shown);
        }
    }

    #[test]
    fn a_message_shows_no_user_and_no_password_of_a_uri() {
        for (text, shown) in [
            ("cannot read mongodb://u:s3cret@h:1: it", "cannot read mongodb://********@h:1: it"),
            ("`mongodb://u:a/b@h` is not", "`mongodb://*****@h` is not"),
            ("sh -c x http://u:p@h/a@b {plan}", "sh -c x http://***@h/a@b {plan}"),
            ("package://robot/mesh@2.dae", "package://robot/mesh@2.dae"),
            ("(at box:1@room)", "(at box:1@room)"),
            ("mongodb://h/?w=1", "mongodb://h/?w=1"),
            ("expected mongodb://USER:PASSWORD@HOST:PORT", "expected mongodb://USER:PASSWORD@HOST:PORT"),
        ] {
            assert_eq!(masked_message(text), shown);
        }
    }

    #[test]
    fn an_excerpt_keeps_its_length() {
        for (text, shown) in [
            ("memory = \"mongodb://u:s3cret@h\"  x", "memory = \"mongodb://********@h\"  x"),
            ("['mongodb://u:a,b@h', 'x@y']", "['mongodb://*****@h', 'x@y']"),
            ("http://a/b // c@d e", "http://a/b // c@d e"),
            ("memory = 'mongodb://u:s3cret' # x", "memory = 'mongodb://u:******' # x"),
            ("memory = 'mongodb://h:27017/?w=1'", "memory = 'mongodb://h:27017/?w=1'"),
        ] {
            assert_eq!(masked_excerpt(text), shown);
        }
    }

    #[test]
    fn a_uri_without_credentials_names_the_same_hosts() {
        assert_eq!(removed("mongodb://u:p@a:1,b:2/?w=1"), "mongodb://a:1,b:2/?w=1");
        assert_eq!(removed("mongodb://a"), "mongodb://a");
    }
}
