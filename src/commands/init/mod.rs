//! `rmem init [DIR]`: a project to begin with.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use bson::doc;
use clap::Args;

use super::{Context, WrongInput, formats};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::formats::command_line;

/// The files, by their names.
const FILES: [(&str, &str); 4] = [
    ("rmem.toml", include_str!("project/rmem.toml")),
    ("domain.pddl", include_str!("project/domain.pddl")),
    ("problem.pddl.j2", include_str!("project/problem.pddl.j2")),
    ("world.json", include_str!("project/world.json")),
];

/// What stands below the help of `init`.
const HELP: &str = "\
Examples:
  rmem init delivery
  cd delivery
  rmem restore world.json
  rmem plan --domain domain.pddl --template problem.pddl.j2

Makes rmem.toml (the settings), domain.pddl, problem.pddl.j2 (a template whose queries ask the memory) and world.json \
(documents to begin with) of a robot that brings things from room to room. Files that are there are never overwritten.";

/// Make a project: settings, domain, template, world
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::TEXT))]
pub struct InitArgs {
    /// Folder of the project, made if it is missing
    #[arg(value_name = "DIR", default_value = ".")]
    pub folder: PathBuf,
}

pub(super) fn run(args: &InitArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::TEXT)?;
    let folder = &args.folder;
    refuse(folder)?;
    let is_new = !folder.exists();
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut made = Vec::new();
    for (name, text) in FILES {
        let path = folder.join(name);
        if let Err(error) = create(&path, text) {
            // A project is made as a whole or not at all.
            made.iter().for_each(|path: &PathBuf| drop(fs::remove_file(path)));
            if is_new {
                let _ = fs::remove_dir(folder);
            }
            return Err(error).with_context(|| format!("cannot write {}", path.display()));
        }
        made.push(path);
    }
    let made: Vec<String> = made.iter().map(|path| path.display().to_string()).collect();
    context.print_report(made.clone(), doc! { "files": made })?;
    let enter = if folder == Path::new(".") {
        String::new()
    } else {
        format!("cd {} && ", command_line::word(&folder.display().to_string()))
    };
    context.output.note(&format!(
        "a plan: {enter}rmem restore world.json && rmem plan --domain domain.pddl --template problem.pddl.j2"
    ));
    Ok(Exit::Done)
}

/// Refuses a folder that has one of the files.
fn refuse(folder: &Path) -> Result<()> {
    let present: Vec<&str> =
        FILES.iter().map(|(name, _)| *name).filter(|name| folder.join(name).symlink_metadata().is_ok()).collect();
    if folder.exists() && !folder.is_dir() {
        return Err(WrongInput::new(format!("{} is not a folder; name another", folder.display())).into());
    }
    match present.as_slice() {
        [] => Ok(()),
        names => {
            let message = format!(
                "{} has {} already, and nothing is overwritten; name another folder",
                folder.display(),
                names.join(", ")
            );
            Err(WrongInput::new(message).into())
        }
    }
}

fn create(path: &Path, text: &str) -> std::io::Result<()> {
    let mut file = File::create_new(path)?;
    // A disk that is full has room for a name, and none for a text.
    file.write_all(text.as_bytes()).inspect_err(|_| drop(fs::remove_file(path)))
}
