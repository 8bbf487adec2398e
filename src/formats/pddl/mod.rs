//! PDDL domains and problems, 1.2 to 3.1: text ⇄ syntax tree.
//!
//! [`read_domain`] and [`read_problem`] turn text into [`ast`]; its types write
//! themselves with `Display`, and what is written reads back the same. The
//! original spelling is kept; that PDDL compares names without regard to case is
//! the reader's business of the tree. What a tree means is [`crate::pddl`]'s.
//!
//! A text is first cut at its top-level lists ([`outline`]), where brackets are
//! balanced and depth is bounded; then each section goes through the grammar
//! ([`grammar`]) and its pairs become a tree ([`walk`], [`section`], [`init`]).

pub mod ast;
mod foreign;
mod goal;
mod grammar;
mod init;
mod name_set;
mod outline;
pub mod portable;
mod section;
mod seeded;
mod syntax;
mod walk;
mod write;

pub use foreign::{Foreign, other_language, tight_dashes};
pub(crate) use init::RESERVED;
pub use name_set::NameSet;
pub(crate) use outline::{Token, Tokens};
pub use section::{read_domain, read_problem};
pub use seeded::{Seeded, SeededHasher};

/// How deep brackets may nest, counted from `(define`.
pub const MAX_DEPTH: usize = 200;

/// Which spelling is accepted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Dialect {
    /// `//` to the end of the line is a comment; otherwise it is an error.
    pub lenient: bool,
}
