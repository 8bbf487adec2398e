//! Documents ⇄ CLIPS facts.
//!
//! | fact | document |
//! |---|---|
//! | `(pose (name "r 1") (xy 1.0 2.0))` | `{relation: "pose", name: "r 1", xy: [1.0, 2.0]}` |
//! | `(on a b)` | `{relation: "on", values: ["a", "b"]}` |
//! | `green`, `"a text"` | strings |
//! | `TRUE`, `FALSE` | booleans |
//! | `3`, `3.0` | an integer, a double |
//!
//! A string that CLIPS would read as a symbol is written as one, any other in
//! quotes; slots of which that is not true are recorded when a fact becomes a
//! document, under `_robmem_info.clips` ([`record`]), so that the way back gives the
//! same fact. A [`Schema`] of deftemplates decides types instead, checks values, and
//! fills in defaults. `_id` and metadata are no part of a fact.
//!
//! Without a deftemplate a multislot with one value looks like a slot, and becomes a
//! plain value, unless a remark behind the fact says otherwise, as it does in what rmem
//! writes; and `(on)` is an ordered fact without values.

mod equal;
mod error;
mod export;
mod import;
mod key;
mod keyed;
mod nested;
pub mod record;
mod schema;
mod trigger;

pub use equal::{remove_repeated, remove_stored};
pub use error::FactError;
pub use export::{Exporter, loadable};
pub use import::{Importer, Misfit};
pub use key::{RELATION, VALUES};
pub use keyed::{Found, KeyError, give_ids, spelled};
pub use nested::Nested;
pub use schema::{INITIAL, Schema};
pub use trigger::{TRIGGER, now, trigger};
