//! The modules of the library, one file per module, through their public interface.

mod clips;
mod content;
mod declared;
mod facts;
mod fuzzed;
mod imported;
mod index;
mod layers;
mod marker;
mod mutations;
mod parity;
mod pddl;
mod plan;
mod planner;
mod problem;
mod query;
mod query_places;
mod reachability;
mod repair;
mod scenes;
mod shell;
mod store;
mod transcripts;
mod unsafety;
mod validate;
mod world_file;
