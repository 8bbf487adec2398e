//! `rmem scene show`: a map of the scene.

use std::path::{Path, PathBuf};

use clap::Args;

use super::selection::Selection;
use crate::commands::{Context, WrongInput, plot};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::scene::{Pose, Scene};
use crate::memory::frames::Frames;
use crate::scene::mesh::Meshes;
use crate::views::top::top;

const HELP: &str = "\
Example:
  rmem scene show robmem.objects --frame map -o map.svg

Draws what is seen from above, to scale: the outlines of all shapes, names, and the frames with the direction
of their x axes. Planes have no outline. A file that ends in .png is a PNG, any other is SVG.";

/// Draw the scene from above
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub struct ShowArgs {
    #[command(flatten)]
    pub(super) selection: Selection,
    /// The title
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "800x700", value_parser = plot::size)]
    size: (f64, f64),
    /// Write to FILE, .svg or .png; - is stdout
    #[arg(short, long, value_name = "FILE", value_parser = plot::picture_or_stdout)]
    output: PathBuf,
}

pub(super) fn run(args: &ShowArgs, context: &mut Context<'_>) -> Result<Exit> {
    let frame = args.selection.frame.as_str();
    let kinds = context.settings.object_kinds.clone();
    let sources = args.selection.sources(&kinds, context)?;
    let memory = context.memory()?;
    let frames = args.selection.more.tree(&sources, &memory, context)?;
    let mut objects: Vec<_> =
        args.selection.objects(&memory, context)?.objects.into_iter().map(|located| located.object).collect();
    let mut meshes = Meshes::in_folder(Path::new(""));
    for object in &mut objects {
        if let Err(reason) = meshes.load(object) {
            context.output.warn(&format!("`{}` has no outline: {reason}", object.name));
        }
    }
    let scene = Scene { name: args.title.clone(), frame: Some(frame.to_owned()), objects, ..Scene::default() };
    let chart = top(&scene, &placed(&frames, frame), args.size);
    if chart.series.is_empty() {
        return Err(WrongInput::new("there are neither objects nor frames to draw").into());
    }
    plot::write(&args.output, &chart.draw()?, context)?;
    Ok(Exit::Done)
}

/// The frames that are in the tree of the scene's frame, at their places in it.
fn placed(frames: &Frames, frame: &str) -> Vec<(String, Pose)> {
    let all = frames.all();
    let placed = all.iter().filter_map(|(name, ..)| Some(((*name).to_owned(), frames.way(name, frame).ok()?)));
    placed.chain([(frame.to_owned(), Pose::IDENTITY)]).collect()
}
