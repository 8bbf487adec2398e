//! `index`

use std::time::Duration;

use clap::Args;

use super::quantity;
use crate::store::Namespace;

/// `index`
#[derive(Debug, Args)]
pub struct Index {
    /// Where: DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Paths with 1, -1, '2d' or '2dsphere'; where they are left out, the indexes are listed
    #[arg(value_name = "KEYS")]
    pub keys: Option<String>,
    /// No two documents may have the same key
    #[arg(long)]
    pub unique: bool,
    /// Leave out documents that have none of the fields
    #[arg(long)]
    pub sparse: bool,
    /// Remove documents so long after the date they have there
    #[arg(long, value_name = "DURATION", value_parser = quantity::duration)]
    pub ttl: Option<Duration>,
    /// What the index is called; else after its keys, like a_1_b_-1
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Remove the index with these keys, or of this name
    #[arg(long, conflicts_with_all = ["unique", "sparse", "ttl"])]
    pub drop: bool,
}
