//! CLIPS text: facts, `deffacts`, `deftemplate`; ⇄ plain types.
//!
//! Read are what `(save-facts)` writes and the constructs of programs, in any
//! mixture; rules, functions and the like are passed over and named. Globals are passed over too, but facts behind
//! them may use their values.
//! Source: the CLIPS Basic Programming Guide, versions 6.30 and 6.40, checked
//! against both.
//!
//! Texts are read word by word and lists are kept on explicit stacks, so that
//! no nesting is too deep for the machine and no text too long.

mod command;
mod defglobal;
mod deftemplate;
mod expression;
mod function;
mod global;
mod lexer;
mod reader;
mod template;
mod top_level;
mod value;
mod writer;

pub use global::Globals;
pub use lexer::{is_instance, is_symbol};
pub use reader::{Item, Reader, is_construct};
pub use template::{Default, Slot, Template, Types};
pub use top_level::{TopLevel, top_level};
pub use value::{Body, Fact, Filled, Value};
pub use writer::{write_fact, write_operand, write_remark, write_value};
