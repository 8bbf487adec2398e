//! Values and facts, whatever they are written as.

use crate::formats::Span;

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
    /// Whether a remark behind the fact declares it a multislot.
    pub multiple: bool,
    /// Whether a function or a global variable gave some of the values.
    pub computed: bool,
    /// From its `(` to its `)`.
    pub span: Span,
}
