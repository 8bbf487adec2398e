//! The trace that CLIPS prints where an error ends calls that are nested deeply: some lines for each of them.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;

/// The line behind the trace of a rule.
const END: &[u8] = b"[PRCCODE4] Execution halted during the actions of defrule";
/// The lines of rmem's own functions, which are no part of a trace.
const OWN: &[u8] = b"[RMEM";
/// How many times a line is printed …
const REPEATED: u64 = 10;
/// … and how many lines there are at most.
const SHOWN: u64 = 100;

/// Lets the first lines of a trace pass, and counts the others.
#[derive(Debug, Default)]
pub(super) struct Trace {
    /// What was printed of a line so far, while it may be one of a trace.
    held: RefCell<Vec<u8>>,
    /// Whether the line was found to be another one, and goes on.
    passing: Cell<bool>,
    /// How often each line came.
    seen: RefCell<HashMap<Vec<u8>, u64>>,
    shown: Cell<u64>,
    hidden: Cell<u64>,
}

impl Trace {
    /// Takes what CLIPS prints, in pieces of any size; returns what of it is to be printed now.
    pub(super) fn pass(&self, bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            let ends = piece.ends_with(b"\n");
            if self.passing.get() {
                out.extend_from_slice(piece);
                self.passing.set(!ends);
                continue;
            }
            self.held.borrow_mut().extend_from_slice(piece);
            if !is_message(&self.held.borrow()) {
                out.append(&mut self.held.borrow_mut());
                self.passing.set(!ends);
            } else if ends {
                let line = self.held.take();
                self.line(line, &mut out);
            }
        }
        out
    }

    /// Takes a line with a message.
    fn line(&self, line: Vec<u8>, out: &mut Vec<u8>) {
        if line.starts_with(END) || line.starts_with(OWN) {
            if line.starts_with(END) {
                out.extend(self.summary());
            }
            out.extend(line);
            return;
        }
        let mut seen = self.seen.borrow_mut();
        let count = seen.get(&line).copied().unwrap_or_default();
        if count >= REPEATED || self.shown.get() >= SHOWN {
            self.hidden.set(self.hidden.get() + 1);
            return;
        }
        self.shown.set(self.shown.get() + 1);
        out.extend_from_slice(&line);
        seen.insert(line, count + 1);
    }

    /// What is left at the end.
    pub(super) fn finish(&self) -> Vec<u8> {
        let mut out = self.summary();
        out.append(&mut self.held.borrow_mut());
        out
    }

    /// How many lines of a trace were left out; the next trace is another one.
    fn summary(&self) -> Vec<u8> {
        self.seen.borrow_mut().clear();
        self.shown.set(0);
        match self.hidden.take() {
            0 => Vec::new(),
            hidden => format!("… and {hidden} more lines like these\n").into_bytes(),
        }
    }
}

/// Whether a line begins, as far as it goes, as CLIPS' messages do: `[PRCCODE4] `.
fn is_message(line: &[u8]) -> bool {
    let Some(rest) = line.strip_prefix(b"[") else { return false };
    let name = rest.iter().take_while(|byte| byte.is_ascii_uppercase() || byte.is_ascii_digit()).count();
    rest.get(name).is_none_or(|byte| *byte == b']')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(pieces: &[&str]) -> String {
        let trace = Trace::default();
        let mut out: Vec<u8> = pieces.iter().flat_map(|piece| trace.pass(piece.as_bytes())).collect();
        out.extend(trace.finish());
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn a_long_trace_is_cut() {
        let frame =
            ["[ARGACCES2] no number\n", "[", "PRCCODE", "4", "] Execution halted during the ", "actions of f.\n"];
        let mut pieces = vec!["[y/n] ", "no\n"];
        pieces.extend(frame.repeat(25));
        pieces.extend(["[PRCCODE4] Execution halted during the actions of defrule 'r'.\n", "[RMEM2] deep\n", "["]);
        let text = passed(&pieces);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[..3],
            ["[y/n] no", "[ARGACCES2] no number", "[PRCCODE4] Execution halted during the actions of f."]
        );
        let end = [
            "… and 30 more lines like these",
            "[PRCCODE4] Execution halted during the actions of defrule 'r'.",
            "[RMEM2] deep",
            "[",
        ];
        assert_eq!((lines.len(), &lines[21..]), (25, &end[..]));
    }

    #[test]
    fn other_lines_pass_as_often_as_they_come() {
        let lines = "[RMEM5] Function 'rm-insert': the key is taken\nplain\n[note] x\n".repeat(200);
        assert_eq!(passed(&[&lines]), lines);
        let many: String = (0..150).map(|n| format!("[X{n}] y\n")).collect();
        assert_eq!(passed(&[&many]).lines().count(), 101);
    }
}
