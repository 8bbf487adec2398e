//! rmem: a document-oriented robot memory on the command line.

pub mod formats;

pub mod query;
pub mod store;

pub mod memory;

pub mod pddl;
pub mod problem;

pub mod plan;
pub mod planner;

pub mod commands;
