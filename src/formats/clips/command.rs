//! Lists at the top of a text that are no facts: constructs, and commands, which CLIPS runs when it reads a batch file.

use super::top_level::top_level;
use crate::formats::nearest;

/// All constructs.
const CONSTRUCTS: [&str; 11] = [
    "defclass",
    "deffacts",
    "deffunction",
    "defgeneric",
    "defglobal",
    "definstances",
    "defmessage-handler",
    "defmethod",
    "defmodule",
    "defrule",
    "deftemplate",
];

/// Functions that no fact would be named after.
const UNMISTAKABLE: [&str; 29] = [
    "any-factp",
    "any-instancep",
    "assert-string",
    "batch*",
    "bload",
    "delayed-do-for-all-facts",
    "delayed-do-for-all-instances",
    "do-for-all-facts",
    "do-for-all-instances",
    "do-for-fact",
    "do-for-instance",
    "dribble-off",
    "dribble-on",
    "find-all-facts",
    "find-fact",
    "foreach",
    "load*",
    "load-facts",
    "loop-for-count",
    "path-add",
    "path-add-subst",
    "path-load",
    "printout",
    "println",
    "progn",
    "progn$",
    "save-facts",
    "set-strategy",
    "unwatch",
];

/// Functions that facts could be named after: they are commands where the text holds constructs.
const COMMANDS: [&str; 31] = [
    "agenda",
    "batch",
    "bind",
    "build",
    "clear",
    "close",
    "duplicate",
    "eval",
    "exit",
    "facts",
    "focus",
    "format",
    "halt",
    "if",
    "load",
    "matches",
    "modify",
    "open",
    "print",
    "refresh",
    "reset",
    "retract",
    "rules",
    "run",
    "save",
    "seed",
    "set",
    "system",
    "unmake-instance",
    "watch",
    "while",
];

/// What a text consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Content {
    /// Facts alone.
    Facts,
    /// Also constructs, but no code.
    Constructs,
    /// Also rules or functions, so that CLIPS would evaluate whatever else stands at its top.
    Program,
}

impl Content {
    /// Of a text.
    pub(super) fn of(text: &str) -> Self {
        let content = |head: &str| match head {
            "defrule" | "deffunction" | "defgeneric" | "defmethod" | "defmessage-handler" => Self::Program,
            head if is_known(head) => Self::Constructs,
            _ => Self::Facts,
        };
        let mut most = Self::Facts;
        for list in top_level(text) {
            most = most.max(content(list.head));
            if most == Self::Program {
                break;
            }
        }
        most
    }
}

fn is_known(head: &str) -> bool {
    CONSTRUCTS.contains(&head)
}

/// Whether a list with this head is a command, wherever it stands.
pub(super) fn is_unmistakable(head: &str) -> bool {
    let starts = ["undef", "ppdef", "list-def"].iter().any(|start| head.starts_with(start));
    starts || UNMISTAKABLE.contains(&head)
}

/// Whether a list with this head is a command in a text with constructs.
pub(super) fn is_command(head: &str) -> bool {
    COMMANDS.contains(&head)
}

/// Whether the first argument of a command says what it is about: a file, say.
pub(super) fn is_named(head: &str) -> bool {
    ["batch", "batch*", "load", "load*", "load-facts", "path-load"].contains(&head)
}

/// The construct that a misspelt head was meant to be.
pub(super) fn meant(head: &str) -> Option<&'static str> {
    if is_known(head) || !head.to_ascii_lowercase().starts_with("def") {
        return None;
    }
    // Facts may be called `default`, which is as near to `defrule` as two letters.
    let most = if head.len() < 10 { 1 } else { 2 };
    nearest(head, CONSTRUCTS).filter(|construct| strsim::osa_distance(&head.to_ascii_lowercase(), construct) <= most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_construct_is_told_from_a_fact() {
        for (head, construct) in [
            ("defffunction", "deffunction"),
            ("deffact", "deffacts"),
            ("Defrule", "defrule"),
            ("deftemplte", "deftemplate"),
        ] {
            assert_eq!(meant(head), Some(construct), "{head}");
        }
        for head in ["defrule", "default", "defrost", "defect", "rule", "def", "default-pose"] {
            assert_eq!(meant(head), None, "{head}");
        }
    }
}
