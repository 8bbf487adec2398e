//! `bench`

use std::path::PathBuf;

use clap::Args;

/// `bench`
#[derive(Debug, Args)]
pub struct Bench {
    /// How many documents there are (can be repeated)
    #[arg(long, value_name = "N", default_values_t = [1_000, 10_000, 100_000], value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub documents: Vec<u32>,
    /// How often each kind of work is repeated
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub rounds: u32,
    /// A MongoDB server to compare with; a database rmem_bench_… is made there and removed
    #[arg(long, value_name = "URI")]
    pub against: Option<String>,
    /// Draw the figures into DIR/memory.svg
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
}
