//! CLIPS text: facts, `deffacts`, `deftemplate`; ⇄ plain types.
//!
//! Read are what `(save-facts)` writes and the constructs of programs, in any
//! mixture; rules, functions, globals and the like are passed over and named.
//! Source: the CLIPS Basic Programming Guide, versions 6.30 and 6.40, checked
//! against both.
//!
//! Texts are read word by word and lists are kept on explicit stacks, so that
//! no nesting is too deep for the machine and no text too long.

mod expression;
mod lexer;
mod reader;
mod template;
mod writer;

pub use reader::{Item, Reader};
pub use template::{Default, Slot, Template, Types};
pub use writer::{write_fact, write_operand, write_remark, write_value};

use super::Span;

/// A value that a slot can hold.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// `green`
    Symbol(String),
    /// `"a text"`
    Text(String),
    /// `3`
    Integer(i64),
    /// `3.0`; finite.
    Float(f64),
    /// `[name]`, here without the brackets.
    Instance(String),
}

/// A fact and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// The name of its template, or of its relation if it is ordered.
    pub name: String,
    /// What it says.
    pub body: Body,
    /// From its `(` to its `)`.
    pub span: Span,
}

/// What a fact says.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// `(name value …)`
    Ordered(Vec<Value>),
    /// `(name (slot value …) …)`
    Slots(Vec<Filled>),
}

/// A slot of a fact with its values.
#[derive(Debug, Clone, PartialEq)]
pub struct Filled {
    /// The slot's name.
    pub name: String,
    /// One, or for a multislot any number.
    pub values: Vec<Value>,
    /// Whether it is said to be a multislot, by a remark behind the fact.
    pub multiple: bool,
    /// From its `(` to its `)`.
    pub span: Span,
}

/// Whether `text` is read as a symbol when it stands alone, so that it can be written without quotes.
#[must_use]
pub fn is_symbol(text: &str) -> bool {
    lexer::lone(text) == Some(lexer::TokenKind::Symbol)
}

/// Whether `text` in brackets is read as the name of an instance.
#[must_use]
pub fn is_instance(text: &str) -> bool {
    lexer::lone(&format!("[{text}]")) == Some(lexer::TokenKind::Instance)
}

/// Whether a list with this head is a construct and not a fact.
#[must_use]
pub fn is_construct(name: &str) -> bool {
    reader::is_reserved(name)
}
