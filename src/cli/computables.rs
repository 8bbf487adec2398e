//! `computables`

use clap::Args;

/// `computables`
#[derive(Debug, Args)]
pub struct Computables {
    /// Say which would run for a query on a namespace, and why
    #[arg(long, num_args = 2, value_names = ["NS", "QUERY"])]
    pub check: Vec<String>,
}
