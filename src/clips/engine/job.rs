//! What is run, and how it ended.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use bson::Document;

use crate::formats::Source;
use crate::planner::{Host, Registry};
use crate::store::Namespace;

/// What is to be run.
pub struct Job {
    /// Constructs, loaded in this order.
    pub programs: Vec<Source>,
    /// Where programs find files: the first folder that has one.
    pub folders: Vec<PathBuf>,
    /// The robot's configuration, which programs take values of; a later document changes those before it.
    pub configuration: Vec<Document>,
    /// Facts that are asserted after `(reset)`.
    pub facts: Vec<Source>,
    /// How many rules fire at most.
    pub cycles: Option<u64>,
    /// How long it may take.
    pub timeout: Option<Duration>,
    /// Becomes true on an interrupt.
    pub interrupted: &'static AtomicBool,
    /// The shared world model, which `synced-assert` and its like keep.
    pub world: Namespace,
    /// Whether it is kept from the start, and not only once a program changes it.
    pub is_synced: bool,
    /// What marker sections of templates query.
    pub collection: Namespace,
    /// Where mutexes are.
    pub mutexes: Namespace,
    /// The planners that programs may name.
    pub planners: Registry,
    /// What planners are run with.
    pub host: Host<'static>,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// No rule can fire, or enough did, or the program called `(halt)`.
    Well,
    /// The program called `(exit CODE)`.
    Exited(i32),
    /// An error ended the evaluation; CLIPS has printed it.
    Failed,
    /// The time was over.
    OutOfTime,
    /// It was interrupted.
    Interrupted,
}
