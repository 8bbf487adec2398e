//! `rmem scene apply FILE`: a scene, or operations, back into documents.

use std::path::{Path, PathBuf};

use bson::{Document, doc};
use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::selection::{More, names, not_negative, read_file, sources};
use crate::commands::{Context, UsageError, WrongInput, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::scene::json::{array, line};
use crate::formats::scene::{Content, Operation, Scene};
use crate::output::{Format, amount};
use crate::scene::apply::{Change, Effect, Target, commit};
use crate::scene::extract::{Reading, extract};
use crate::scene::mesh::Meshes;
use crate::store::Namespace;

const HELP: &str = "\
Examples:
  rmem scene apply moved.scene --into robmem.objects --frame map
  rmem scene diff before.json after.json | rmem scene apply - --into robmem.objects
  rmem scene apply planned.xml --dry-run

FILE is a scene in any format, or the operations that scene diff and scene watch print; - is stdin.
Objects are found by their names. A pose that differs is written back in the document's own frame, through
the tree of frames; shapes, masses and attachments that differ are written as far as the format can express
them. New objects become documents in the scene's frame. Documents whose objects the scene does not have
any more stay, unless --remove is given. Prints a line for each document that changes; all of them
change, or none.";

/// Write a scene, or operations, back into documents
#[derive(Debug, Args)]
#[command(after_help = HELP, arg = formats::argument(&formats::RESULT))]
pub struct ApplyArgs {
    /// A scene file, or operations; - is stdin
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Where the documents are, and where new ones go (default: the collections of [[scene.object]], or --collection)
    #[arg(long, value_name = "NS")]
    into: Option<Namespace>,
    /// Frame of the file's poses, if the file does not name it
    #[arg(long, value_name = "FRAME", value_parser = NonEmptyStringValueParser::new())]
    frame: Option<String>,
    #[command(flatten)]
    more: More,
    /// Format of FILE (default: recognised by the content)
    #[arg(long, value_name = "FORMAT", value_parser = names())]
    from: Option<String>,
    /// Remove documents whose objects are gone
    #[arg(long)]
    remove: bool,
    /// Print what would be changed, and change nothing
    #[arg(long)]
    dry_run: bool,
    /// Numbers that differ by at most this are equal, in metres and radians
    #[arg(long, value_name = "TOLERANCE", default_value_t = 1e-9)]
    #[arg(allow_negative_numbers = true, value_parser = not_negative)]
    tolerance: f64,
}

pub(super) fn run(args: &ApplyArgs, context: &mut Context<'_>) -> Result<Exit> {
    context.format(&formats::RESULT)?;
    let (content, spelling) = read_file(&args.file, args.from.as_deref(), context)?;
    let frame = frame(&content, args)?;
    let kinds = context.settings.object_kinds.clone();
    let sources = sources(args.into.as_ref(), Document::new(), &kinds, context);
    let memory = if args.dry_run { context.memory()? } else { context.memory_to_fill()? };
    let into = args
        .into
        .clone()
        .or_else(|| single(&sources.queries))
        .unwrap_or_else(|| context.settings.collection.value.clone());
    let mut decide = || -> Result<Vec<Change>> {
        let frames = args.more.tree(&sources, &memory, context)?;
        let found = extract(&memory, &sources, &frames, &frame, Reading::Stored)?;
        let known = args.more.accept(found, context)?;
        let target = Target {
            known: &known,
            frames: &frames,
            frame: &frame,
            into: &into,
            remove: args.remove,
            tolerance: args.tolerance,
        };
        let changes = match &content {
            Content::Scene(scene) => target.scene(scene, spelling, &mut Meshes::in_folder(Path::new(""))),
            Content::Operations(operations, _) => target.operations(operations),
        };
        Ok(changes.map_err(WrongInput::new)?)
    };
    let changes = if args.dry_run {
        decide()?
    } else {
        // Another program sees what this one changes before it looks for its own objects.
        let namespaces: Vec<&Namespace> =
            sources.queries.iter().map(|(namespace, _)| namespace).chain([&into]).collect();
        memory.atomically(&namespaces, Error::from, |_| {
            let changes = decide()?;
            commit(&memory, &changes)?;
            Ok::<_, Error>(changes)
        })?
    };
    report(&changes, context)?;
    Ok(Exit::Done)
}

/// The frame of the file's poses; without poses, any will do.
fn frame(content: &Content, args: &ApplyArgs) -> Result<String> {
    let (known, has_poses) = match content {
        Content::Scene(Scene { frame, objects, .. }) => (frame.clone(), !objects.is_empty()),
        Content::Operations(operations, frame) => {
            let placed = |operation: &Operation| matches!(operation, Operation::Add(_) | Operation::Move { .. });
            (frame.clone(), operations.iter().any(placed))
        }
    };
    match (known, &args.frame) {
        (Some(known), Some(given)) if known != *given => Err(WrongInput::new(format!(
            "the poses of {} are in the frame `{known}`, not in `{given}`",
            args.file.display()
        ))
        .into()),
        (Some(frame), _) => Ok(frame),
        (None, Some(given)) => Ok(given.clone()),
        (None, None) if has_poses => Err(UsageError::new(format!(
            "{} does not say in which frame its poses are; expected --frame FRAME",
            args.file.display()
        ))
        .into()),
        (None, None) => Ok(String::new()),
    }
}

/// The collection, where there is one.
fn single(queries: &[(Namespace, Document)]) -> Option<Namespace> {
    let (first, _) = queries.first()?;
    queries.iter().all(|(namespace, _)| namespace == first).then(|| first.clone())
}

fn report(changes: &[Change], context: &mut Context<'_>) -> Result<()> {
    let (mut kept, mut lines) = (0, Vec::new());
    for change in changes {
        let mut written =
            doc! { "operation": change.words.join("+"), "name": &change.name, "ns": change.namespace.to_string() };
        match &change.effect {
            Effect::Keep { .. } => {
                kept += 1;
                continue;
            }
            Effect::Insert(document) if document.is_empty() => continue,
            Effect::Insert(document) => written.extend(document.clone()),
            Effect::Update { id, set, .. } => {
                written.insert("_id", id);
                written.extend(set.clone());
            }
            Effect::Delete { id } => drop(written.insert("_id", id)),
        }
        lines.push(line(&written));
    }
    match context.format(&formats::RESULT)? {
        Format::Json => context.output.line(&array(&lines))?,
        _ => lines.iter().try_for_each(|line| context.output.line(line))?,
    }
    if kept > 0 {
        context
            .output
            .note(&format!("kept {} that the scene does not have; use --remove to delete", amount(kept, "object")));
    }
    Ok(())
}
