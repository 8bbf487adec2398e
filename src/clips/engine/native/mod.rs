//! CLIPS 6.40 itself, behind an interface that cannot be used wrongly. The only module with `unsafe`.
//!
//! The bindings are the crate `clips-sys`, made from CLIPS' own headers when it is built, so
//! that the layout of every structure is the compiler's. What the rest relies on:
//!
//! - One thread uses an environment. The only thing another one does is to set the two flags
//!   that end an evaluation, as CLIPS' own handler of Ctrl-C does ([`halt`]).
//! - A [`Running`] owns its environment with everything that CLIPS has pointers to, and
//!   destroys it before that. An [`Environment`] and a [`FactRef`] that outlive it find out.
//! - A fact that Rust knows is retained, so that it can be asked after its retraction.
//! - What Rust gives to CLIPS as an external address is a number, never a pointer.
//! - No panic crosses into C ([`call`]), and C never jumps over Rust: what would end the
//!   process asks the routers first, and they refuse.
//! - CLIPS may call back into Rust from nearly every function, so nothing here is borrowed
//!   mutably while CLIPS works.
#![allow(unsafe_code)]

mod call;
mod conversion;
mod environment;
mod fact;
mod halt;
mod handle;
mod host;
mod router;
mod running;
mod text;
mod value;

pub(crate) use call::CallError;
pub(crate) use environment::Environment;
pub(crate) use handle::FactRef;
pub(crate) use host::{Host, Stream};
pub(crate) use running::Running;
pub(crate) use value::Value;
