//! PDDL rewritten word by word, as it is written.

use std::fmt::{self, Display, Write as _};
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};

use super::names::{Head, Names, is_added, is_plain_but_for_case};

/// How much text is rewritten at once, in bytes.
pub(super) const PIECE: usize = 1 << 16;

/// The text of a domain or a problem in the names that are sent; nothing where `interrupted` becomes true before it is done.
pub(super) fn rewrite(names: &mut Names<'_>, tree: &impl Display, interrupted: &AtomicBool) -> Option<String> {
    let mut rewrite = Rewrite {
        names,
        interrupted,
        pending: String::with_capacity(2 * PIECE),
        written: String::new(),
        heads: Vec::new(),
    };
    write!(rewrite, "{tree}").ok()?;
    Some(rewrite.finish())
}

/// Rewrites a text as it comes, without ever having it as a whole.
struct Rewrite<'n, 'a> {
    names: &'n mut Names<'a>,
    interrupted: &'n AtomicBool,
    /// What has come and is not rewritten yet.
    pending: String,
    written: String,
    /// The lists that are open.
    heads: Vec<Head>,
}

impl fmt::Write for Rewrite<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.pending.push_str(text);
        if self.pending.len() < PIECE {
            return Ok(());
        }
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(fmt::Error);
        }
        // The last word may go on.
        let whole = self.pending.rfind(is_delimiter).unwrap_or(0);
        let mut text = mem::take(&mut self.pending);
        self.rewrite(text.get(..whole).unwrap_or_default());
        text.drain(..whole);
        self.pending = text;
        Ok(())
    }
}

impl Rewrite<'_, '_> {
    fn finish(mut self) -> String {
        let rest = mem::take(&mut self.pending);
        self.rewrite(&rest);
        self.written
    }

    fn rewrite(&mut self, mut rest: &str) {
        while let Some(first) = rest.chars().next() {
            let length = match first {
                '(' | ')' => 1,
                c if c.is_whitespace() => rest.len() - rest.trim_start().len(),
                _ => word_length(rest),
            };
            let (word, after) = rest.split_at(length);
            rest = after;
            match first {
                '(' => self.heads.push(Head::Missing),
                ')' => {
                    if self.heads.pop() == Some(Head::Requirements) && self.written.ends_with(":requirements") {
                        self.written.push_str(" :strips");
                    }
                }
                c if c.is_whitespace() => {}
                _ => {
                    self.word(word);
                    continue;
                }
            }
            self.written.push_str(word);
        }
    }

    fn word(&mut self, word: &str) {
        let head = self.heads.last().copied().unwrap_or(Head::Missing);
        if head == Head::Requirements && !self.names.is_known(word) {
            self.written.truncate(self.written.trim_end().len());
            return;
        }
        if head == Head::Missing
            && let Some(slot) = self.heads.last_mut()
        {
            *slot = self.names.head(word);
        }
        if head == Head::Metric
            && let Some(slot) = self.heads.last_mut()
        {
            *slot = Head::Counting;
        } else if self.names.is_bare(word, head) {
            let _ = write!(self.written, "({})", self.names.word(word, Head::Other));
            return;
        }
        let start = self.written.len();
        if is_plain_but_for_case(word) && !is_added(word, head) {
            self.written.push_str(word);
            if let Some(written) = self.written.get_mut(start..) {
                written.make_ascii_lowercase();
            }
        } else {
            self.written.push_str(&self.names.word(word, head));
        }
    }
}

/// How long the word is that a text begins with, in bytes.
fn word_length(text: &str) -> usize {
    let ends = |byte: &u8| matches!(byte, b'(' | b')' | b' ' | b'\t'..=b'\r') || !byte.is_ascii();
    match text.bytes().position(|byte| ends(&byte)) {
        // Other white space has several bytes.
        Some(end) if !text.as_bytes()[end].is_ascii() => text.find(is_delimiter).unwrap_or(text.len()),
        Some(end) => end,
        None => text.len(),
    }
}

fn is_delimiter(c: char) -> bool {
    c == '(' || c == ')' || c.is_whitespace()
}
