//! `rmem scene export`: the scene of a memory, in a format of motion planners.

use std::path::PathBuf;

use clap::Args;

use super::selection::{FORMATS, Selection, spelling};
use crate::commands::{Context, UsageError};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::scene::message::write_operations;
use crate::formats::scene::{Operation, Scene};
use crate::output::Format;

const HELP: &str = "\
Examples:
  rmem scene export robmem.objects --frame map -o world.json
  rmem scene export robmem.objects \"{room: 'kitchen'}\" --frame map --format mjcf -o kitchen.xml
  rmem scene export --frame base_link --format moveit-msg --diff

Formats (--format): json, moveit (.scene), moveit-msg (moveit_msgs/PlanningScene as JSON, which is YAML,
too), mjcf (MuJoCo), sdf (Gazebo, Drake), urdf, openrave. All lengths are in metres.

An object is a document with `name`, `frame`, `translation: [x, y, z]`, `rotation: [x, y, z, w]` and
`geometry`; documents with neither `translation` nor `geometry`, and frames, are none. [[scene.object]] in
rmem.toml says what documents leave out: the key of the name, a geometry, a model. Poses are resolved
through the frames {frame, parent, translation, rotation}.

An invalid object, or one that the format cannot express, is an error; see --skip-invalid.
Other properties that a format lacks (such as attachments in mjcf) are left out with a warning.";

/// Write the scene, every pose resolved into one frame
#[derive(Debug, Args)]
#[command(after_help = HELP)]
#[command(arg = crate::commands::formats::argument(&crate::commands::formats::SCENE))]
pub struct ExportArgs {
    #[command(flatten)]
    pub(super) selection: Selection,
    /// File to write (default: stdout)
    #[arg(short, long, value_name = "FILE", default_value = "-", hide_default_value = true)]
    output: PathBuf,
    /// The scene's name
    #[arg(long, value_name = "NAME", value_parser = scene_name)]
    name: Option<String>,
    /// For moveit-msg: add to what the planner knows instead of replacing it (`is_diff`)
    #[arg(long)]
    diff: bool,
}

/// A name that every format can have.
fn scene_name(text: &str) -> std::result::Result<String, String> {
    match text.chars().find(|c| c.is_control() || ('\u{fffe}'..='\u{ffff}').contains(c)) {
        Some(c) => Err(format!("the character {} cannot be in a name of a scene", c.escape_default())),
        None => Ok(text.to_owned()),
    }
}

pub(super) fn run(args: &ExportArgs, context: &mut Context<'_>) -> Result<Exit> {
    let format = context.format(&FORMATS)?;
    if args.diff && format != Format::MOVEIT_MESSAGE {
        return Err(UsageError::new("--diff is for --format moveit-msg").into());
    }
    let spelling = spelling(format)?;
    let memory = context.memory()?;
    let found = args.selection.objects(&memory, context)?;
    let frame = args.selection.frame.as_str();
    let fitting = args.selection.more.fit(found, spelling, frame, context)?;
    let objects = fitting.objects.into_iter().map(|located| located.object);
    let text = if args.diff {
        let operations: Vec<Operation> = objects.map(|object| Operation::Add(Box::new(object))).collect();
        write_operations(&operations, Some(frame))
    } else {
        let name = args.name.clone();
        (spelling.write)(&Scene { name, frame: Some(frame.to_owned()), objects: objects.collect(), ..Scene::default() })
    };
    context.output.write_file(&args.output, text.as_bytes())?;
    Ok(Exit::Done)
}
