//! What a program consists of: constructs, commands, and the functions that it defines.

use std::collections::BTreeSet;

use crate::formats::clips::{is_construct, top_level};
use crate::formats::{Source, Span};

/// Functions that CLIPS 6.40 has and 6.30 has not. Programs for 6.30 define some of them.
pub(super) const NEW: [&str; 19] = [
    "chdir",
    "clear-error",
    "difference$",
    "flush",
    "get-error",
    "gm-time",
    "intersection$",
    "local-time",
    "print",
    "println",
    "rewind",
    "seek",
    "set-error",
    "str-byte-length",
    "str-replace",
    "tell",
    "unget-char",
    "union$",
    "void",
];

/// A part of a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Constructs, and whatever stands between them.
    Constructs(Span),
    /// One command, like `(load* "rules.clp")`.
    Command(Span),
}

/// The parts of a program, in order.
pub(super) fn parts(text: &str) -> Vec<Part> {
    let (mut parts, mut start) = (Vec::new(), 0);
    for list in top_level(text) {
        let is_command =
            !list.head.is_empty() && !list.head.starts_with("def") && !is_construct(list.head) || list.head == "assert";
        // What is not closed is no command, and CLIPS says where it began.
        if is_command && text.get(..list.span.end).is_some_and(|text| text.ends_with(')')) {
            parts.push(Part::Constructs(Span::new(start, list.span.start)));
            parts.push(Part::Command(list.span));
            start = list.span.end;
        }
    }
    parts.push(Part::Constructs(Span::new(start, text.len())));
    let is_blank = |part: &Part| match part {
        Part::Constructs(span) => text.get(span.start..span.end).unwrap_or_default().trim().is_empty(),
        Part::Command(_) => false,
    };
    parts.retain(|part| !is_blank(part));
    parts
}

/// The names of the functions that programs define, each with the program's name.
pub(super) fn functions(programs: &[Source]) -> BTreeSet<(String, String)> {
    let defined = |source: &Source| {
        let lists =
            top_level(source.text()).filter(|list| matches!(list.head, "deffunction" | "defgeneric" | "defmethod"));
        let local = |name: &str| name.rsplit_once("::").map_or(name, |(_, name)| name).to_owned();
        lists.map(|list| (local(list.name), source.name().to_owned())).collect::<Vec<_>>()
    };
    programs.iter().flat_map(defined).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_parts_of_their_own() {
        let text =
            "; a (remark)\n(defrule r => )\n(printout t \"(x)\")\n(defrule s => )(reset)\n(assert (a))\n(defule t";
        let parts: Vec<_> = parts(text)
            .into_iter()
            .map(|part| match part {
                Part::Constructs(span) => text.get(span.start..span.end).unwrap().trim().to_owned(),
                Part::Command(span) => format!("! {}", text.get(span.start..span.end).unwrap()),
            })
            .collect();
        assert_eq!(
            parts,
            [
                "; a (remark)\n(defrule r => )",
                "! (printout t \"(x)\")",
                "(defrule s => )",
                "! (reset)",
                "! (assert (a))",
                "(defule t"
            ]
        );
    }
}
