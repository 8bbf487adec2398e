//! `rmem clips run PROGRAM…`: CLIPS with the memory's functions inside it.

mod args;
#[cfg_attr(not(feature = "clips-engine"), path = "without.rs")]
mod engine;

pub(super) use args::RunArgs;
pub(super) use engine::run;
