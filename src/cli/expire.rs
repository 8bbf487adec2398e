//! `expire`

use clap::Args;

/// `expire`
#[derive(Debug, Args)]
pub struct Expire {
    /// Also what was stored with `_robmem_info: {persistent: false}`: the robot was restarted
    #[arg(long)]
    pub restart: bool,
}
