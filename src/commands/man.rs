//! `rmem man [COMMAND]`: the manual page of rmem or of a command, or all of them into a folder.

use std::path::{Path, PathBuf};

use clap::{Args, Command};

use super::{Context, UsageError};
use crate::error::{Context as _, Result};
use crate::exit::Exit;

/// What stands below the help of `man`.
const HELP: &str = "\
Examples:
  rmem man | man -l -
  rmem man clips export > rmem-clips-export.1
  rmem man --out /usr/local/share/man/man1";

/// Print a manual page, or write all of them
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct ManArgs {
    /// Command the page is about (default: rmem itself)
    #[arg(value_name = "COMMAND")]
    pub command: Vec<String>,
    /// Write the pages of all commands to files in DIR
    #[arg(short, long = "out", value_name = "DIR", conflicts_with = "command")]
    pub folder: Option<PathBuf>,
}

pub(super) fn run(args: &ManArgs, context: &mut Context<'_>) -> Result<Exit> {
    let mut command = (context.command_line)();
    command.build();
    match &args.folder {
        Some(folder) => write_all(&command, folder, context)?,
        None => context.output.stdout().write_all(&page(named(&command, &args.command)?)?)?,
    }
    Ok(Exit::Done)
}

/// Returns the command that words name.
fn named<'c>(command: &'c Command, words: &[String]) -> Result<&'c Command, UsageError> {
    words.iter().try_fold(command, |command, word| {
        let found = command.find_subcommand(word);
        found.ok_or_else(|| UsageError::new(format!("unknown command `{word}`; `rmem help` lists the commands")))
    })
}

/// Writes the pages of a command and of those below it.
fn write_all(command: &Command, folder: &Path, context: &mut Context<'_>) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    context.output.write_file(&folder.join(format!("{name}.1")), &page(command)?)?;
    let inner = command.get_subcommands().filter(|inner| inner.get_name() != "help" && !inner.is_hide_set());
    inner.into_iter().try_for_each(|inner| write_all(inner, folder, context))
}

fn page(command: &Command) -> std::io::Result<Vec<u8>> {
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page)?;
    Ok(page)
}
