//! `rmem scene diff A B`: two scenes compared, as operations.

use std::path::Path;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::selection::{More, names, not_negative, read_file, sources};
use crate::commands::formats::SCENE_DIFFERENCE;
use crate::commands::{Context, UsageError, WrongInput, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::Diagnostic;
use crate::formats::scene::json::{array, line};
use crate::formats::scene::message::write_operations;
use crate::formats::scene::{Content, Operation, Scene, Spelling};
use crate::output::Format;
use crate::scene::diff::diff;
use crate::store::Namespace;

const HELP: &str = "\
Examples:
  rmem scene diff before.scene after.scene
  rmem scene diff world.json robmem.objects --frame map --format moveit-msg

A and B are scene files in any format, or collections of the memory: a name is a collection
where there is no such file. Prints a line for each operation
that leads from A to B: add, remove, move, attach, detach, reshape; with --format json one array, with moveit-msg one
PlanningScene with is_diff. Exits with 0 where nothing differs, else with 1. What a file's format cannot
express is not compared.";

/// Compare two scenes, as operations
#[derive(Debug, Args)]
#[command(after_help = HELP)]
#[command(arg = crate::commands::formats::argument(&SCENE_DIFFERENCE))]
pub struct DiffArgs {
    /// A scene file, or a collection
    #[arg(value_name = "A")]
    first: String,
    /// A scene file, or a collection
    #[arg(value_name = "B")]
    second: String,
    /// The frame of a collection's poses (default: that of the file)
    #[arg(long, value_name = "FRAME", value_parser = NonEmptyStringValueParser::new())]
    frame: Option<String>,
    #[command(flatten)]
    more: More,
    /// Format of the files (default: recognised by the content)
    #[arg(long, value_name = "FORMAT", value_parser = names())]
    from: Option<String>,
    /// Numbers that differ by at most this are equal, in metres and radians
    #[arg(long, value_name = "TOLERANCE", default_value_t = 1e-9)]
    #[arg(allow_negative_numbers = true, value_parser = not_negative)]
    tolerance: f64,
}

/// A scene, and the format of its file.
type Side = (Scene, Option<&'static Spelling>);

pub(super) fn run(args: &DiffArgs, context: &mut Context<'_>) -> Result<Exit> {
    let format = context.format(&SCENE_DIFFERENCE)?;
    let mut sides = [file(&args.first, args, context)?, file(&args.second, args, context)?];
    let known = args.frame.clone().or_else(|| sides.iter().flatten().find_map(|(scene, _)| scene.frame.clone()));
    for (side, name) in sides.iter_mut().zip([&args.first, &args.second]) {
        if side.is_none() {
            *side = Some((collection(name, known.as_deref(), args, context)?, None));
        }
    }
    let [Some(first), Some(second)] = sides else { return Err(UsageError::new("expected two scenes").into()) };
    let frame = common_frame(&first.0, &second.0)?;
    let (first, second) = (expressible(first.0, second.1), expressible(second.0, first.1));
    let operations = diff(&first, &second, args.tolerance);
    print(&operations, frame.as_deref(), format, context)?;
    Ok(if operations.is_empty() { Exit::Done } else { Exit::No })
}

fn print(
    operations: &[Operation],
    frame: Option<&str>,
    format: Format,
    context: &mut Context<'_>,
) -> std::io::Result<()> {
    if format == Format::MOVEIT_MESSAGE {
        return context.output.stdout().write_all(write_operations(operations, frame).as_bytes());
    }
    if format == Format::Json {
        let operations: Vec<String> = operations.iter().map(|operation| line(&operation.to_document(frame))).collect();
        return context.output.line(&array(&operations));
    }
    operations.iter().try_for_each(|operation| context.output.line(&line(&operation.to_document(frame))))
}

/// The scene of a file; none where the name is that of a collection.
fn file(name: &str, args: &DiffArgs, context: &mut Context<'_>) -> Result<Option<Side>> {
    let path = Path::new(name);
    if let Some(namespace) = Namespace::parse(name).ok().filter(|_| name != "-" && !path.exists()) {
        if !has_extension(path) {
            return Ok(None);
        }
        if is_collection(&namespace, context) {
            context.output.note(&format!("there is no file {name}; it is taken for a collection"));
            return Ok(None);
        }
    }
    match read_file(path, args.from.as_deref(), context)? {
        (Content::Scene(scene), spelling) => Ok(Some((scene, Some(spelling)))),
        (Content::Operations(operations, _), _) if operations.is_empty() => {
            Err(Diagnostic::at(name, 1, 1, "expected a scene, found nothing").into())
        }
        (Content::Operations(..), _) => Err(WrongInput::new(format!("{name} has operations; expected a scene")).into()),
    }
}

/// Whether the memory has a collection; not where it cannot be asked.
fn is_collection(namespace: &Namespace, context: &mut Context<'_>) -> bool {
    let Ok(memory) = context.memory() else { return false };
    missing::look(namespace, &memory, context).is_ok_and(|message| message.is_none())
}

/// Whether a name that is not a file here looks like one.
fn has_extension(path: &Path) -> bool {
    let known = ["json", "scene", "xml", "sdf", "urdf", "mjcf", "world"];
    path.extension().is_some_and(|extension| known.iter().any(|known| extension == *known))
}

fn collection(name: &str, frame: Option<&str>, args: &DiffArgs, context: &mut Context<'_>) -> Result<Scene> {
    let frame = frame.ok_or_else(|| UsageError::new(format!("expected --frame FRAME for the poses of {name}")))?;
    let kinds = context.settings.object_kinds.clone();
    let sources = sources(Some(&name.parse()?), bson::Document::new(), &kinds, context);
    let memory = context.memory()?;
    Ok(args.more.objects(&sources, frame, &[], &memory, context)?.scene(frame))
}

fn common_frame(first: &Scene, second: &Scene) -> Result<Option<String>, WrongInput> {
    match (&first.frame, &second.frame) {
        (Some(one), Some(other)) if one != other => Err(WrongInput::new(format!(
            "the poses are in the frames `{one}` and `{other}`; export both with one --frame"
        ))),
        (one, other) => Ok(one.clone().or_else(|| other.clone())),
    }
}

/// The scene as far as the other's format can express it.
fn expressible(scene: Scene, spelling: Option<&Spelling>) -> Scene {
    let Some(spelling) = spelling else { return scene };
    let objects = scene.objects.iter().map(|object| spelling.expressible(object)).collect();
    Scene { objects, ..scene }
}

#[cfg(test)]
mod tests {
    use crate::commands::scene::selection::FORMATS;
    use crate::formats::scene::SPELLINGS;

    #[test]
    fn every_format_of_the_command_line_is_one_of_the_library() {
        assert_eq!(FORMATS.len(), SPELLINGS.len());
        assert!(FORMATS.iter().all(|format| crate::formats::scene::by_name(format.name()).is_some()));
    }
}
