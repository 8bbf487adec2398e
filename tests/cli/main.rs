//! The command line as a user meets it: wiring, messages, exit codes, documentation.

mod lab;

mod clips;
#[cfg(feature = "clips-engine")]
mod clips_plans;
mod computables;
mod damage;
mod docs;
mod documents;
#[cfg(feature = "clips-engine")]
mod engine;
mod executive;
mod exit_codes;
mod indexes;
mod locks;
mod memories;
mod plans;
mod problems;
mod races;
mod reports;
mod scenes;
mod settings;
mod stored;
mod surroundings;
mod terminal;
mod views;
mod watch;
mod worldmodels;
