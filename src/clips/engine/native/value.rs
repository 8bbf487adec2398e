//! Values of CLIPS as values of Rust.

use super::handle::FactRef;

/// A value that an expression can have.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    /// `green`
    Symbol(String),
    /// `"a text"`
    Text(String),
    /// `3`
    Integer(i64),
    /// `3.0`
    Float(f64),
    /// `[name]`
    Instance(String),
    /// An external address that rmem gave out.
    Address(u64),
    /// A fact.
    Fact(FactRef),
    /// A multifield.
    Many(Vec<Value>),
    /// Nothing.
    Void,
    /// What rmem has no use for: addresses of instances and of others.
    Foreign,
}

impl Value {
    /// TRUE or FALSE.
    pub(crate) fn truth(is: bool) -> Self {
        Self::Symbol(if is { "TRUE" } else { "FALSE" }.to_owned())
    }

    /// What kind it is, as CLIPS says it.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Symbol(_) => "symbol",
            Self::Text(_) => "string",
            Self::Integer(_) => "integer",
            Self::Float(_) => "float",
            Self::Instance(_) => "instance name",
            Self::Address(_) | Self::Foreign => "address",
            Self::Fact(_) => "fact address",
            Self::Many(_) => "multifield",
            Self::Void => "nothing",
        }
    }
}
