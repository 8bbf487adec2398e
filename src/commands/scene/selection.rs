//! Which documents are objects, and in which frame they are wanted.

use std::collections::HashSet;
use std::path::Path;

use bson::Document;
use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use crate::commands::query::{argument, blame};
use crate::commands::{Context, UsageError, WrongInput, missing};
use crate::error::Result;
use crate::formats::scene::{Content, Kind, Scene, Spelling, by_name, recognize};
use crate::formats::{Diagnostic, Source, Span};
use crate::memory::Memory;
use crate::memory::computables::BodyKind;
use crate::memory::frames::{Frames, WayError};
use crate::output::Format;
use crate::scene::extract::{Reading, extract};
use crate::scene::mesh::Meshes;
use crate::scene::{Extraction, Invalid, ObjectKind, Reason, Sources};
use crate::store::{Namespace, StoreError};

pub(super) use crate::commands::formats::SCENE as FORMATS;

/// Which documents.
#[derive(Debug, Args)]
pub(super) struct Selection {
    /// Collection, as DATABASE.COLLECTION (default: those of [[scene.object]], or --collection)
    #[arg(value_name = "NS")]
    pub(super) namespace: Option<Namespace>,
    /// Query that selects documents (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub(super) query: String,
    /// The frame of all poses
    #[arg(long, value_name = "FRAME", value_parser = NonEmptyStringValueParser::new())]
    pub(super) frame: String,
    #[command(flatten)]
    pub(super) more: More,
}

/// What holds for every way to select documents.
#[derive(Debug, Args)]
pub(super) struct More {
    /// The tree of frames (default: that of the computable `transform`, or frames in the same database)
    #[arg(long, value_name = "NS")]
    pub(super) frames: Option<Namespace>,
    /// Skip invalid objects, with a warning
    #[arg(long)]
    pub(super) skip_invalid: bool,
}

impl Selection {
    /// The objects in the wanted frame.
    pub(super) fn objects(&self, memory: &Memory, context: &mut Context<'_>) -> Result<Extraction> {
        let kinds = context.settings.object_kinds.clone();
        let sources = self.sources(&kinds, context)?;
        let given = [("<query>", self.query.as_str())];
        self.more.objects(&sources, &self.frame, &given, memory, context)
    }

    /// Where objects are looked for.
    pub(super) fn sources<'a>(
        &self,
        kinds: &'a [ObjectKind],
        context: &Context<'_>,
    ) -> Result<Sources<'a>, Diagnostic> {
        let query = argument("<query>", &self.query)?;
        Ok(sources(self.namespace.as_ref(), query, kinds, context))
    }
}

/// A collection that is named; else those of the configured kinds; else the usual one.
pub(super) fn sources<'a>(
    namespace: Option<&Namespace>,
    query: Document,
    kinds: &'a [ObjectKind],
    context: &Context<'_>,
) -> Sources<'a> {
    let queries = match namespace {
        Some(namespace) => vec![(namespace.clone(), query)],
        None if kinds.is_empty() => vec![(context.settings.collection.value.clone(), query)],
        None => kinds.iter().map(|kind| (kind.namespace.clone(), kind.query.clone())).collect(),
    };
    Sources { queries, kinds }
}

impl More {
    /// The collection of the frames.
    pub(super) fn frames(&self, sources: &Sources<'_>, context: &Context<'_>) -> Namespace {
        if let Some(frames) = &self.frames {
            return frames.clone();
        }
        let first = sources.queries.first().map_or(&context.settings.collection.value, |(namespace, _)| namespace);
        let configured = context.settings.computables.iter().filter(|definition| definition.namespace == *first);
        let tree = configured.into_iter().find_map(|definition| match &definition.body {
            BodyKind::Builtin { name, options } if name == "transform" => options.get("frames")?.parse().ok(),
            _ => None,
        });
        tree.unwrap_or_else(|| Namespace { database: first.database.clone(), collection: "frames".to_owned() })
    }

    /// The tree of frames.
    pub(super) fn tree(
        &self,
        sources: &Sources<'_>,
        memory: &Memory,
        context: &Context<'_>,
    ) -> Result<Frames, StoreError> {
        let frames = self.frames(sources, context);
        Frames::read(&frames, |find| memory.find(&frames, find))
    }

    /// The objects in a frame, with a warning where there are none because a collection does not exist. `given` are the
    /// texts on the command line that a wrong query is in.
    pub(super) fn objects(
        &self,
        sources: &Sources<'_>,
        frame: &str,
        given: &[(&'static str, &str)],
        memory: &Memory,
        context: &mut Context<'_>,
    ) -> Result<Extraction> {
        let frames = self.tree(sources, memory, context)?;
        let found = extract(memory, sources, &frames, frame, Reading::All).map_err(|error| blame(error, given))?;
        if frames.has_any() && !frames.knows(frame) && found.is_nothing_for_want_of(frame) {
            return Err(WrongInput::new(format!("--frame {frame}: no such frame; {}", frames.known())).into());
        }
        // Where frames lead back to themselves, it is not the documents in them that are wrong.
        let is_cycle = |invalid: &&Invalid| matches!(invalid.reason, Reason::Frame(WayError::Cycle { .. }));
        let cycle = found.invalid.iter().find(is_cycle);
        if let (Some(cycle), false) = (cycle, self.skip_invalid) {
            let message = format!("{}; the parents of a frame have to end at one without a parent", cycle.reason);
            return Err(WrongInput::new(message).into());
        }
        if found.objects.is_empty() {
            for (namespace, _) in &sources.queries {
                missing::warn(namespace, memory, context);
            }
        }
        self.accept(found, context)
    }

    /// Refuses invalid objects, or skips them with a warning.
    pub(super) fn accept(&self, mut found: Extraction, context: &mut Context<'_>) -> Result<Extraction> {
        let invalid = std::mem::take(&mut found.invalid);
        self.report(&invalid, context)?;
        Ok(found)
    }

    /// The same of those that were found.
    pub(super) fn report(&self, invalid: &[Invalid], context: &mut Context<'_>) -> Result<()> {
        let Some(first) = invalid.first() else { return Ok(()) };
        if !self.skip_invalid {
            let more = match invalid.len() {
                1 => String::new(),
                count => format!(" ({} more are wrong)", count - 1),
            };
            return Err(
                WrongInput::new(format!("{first}{more}; correct it, or leave it out with --skip-invalid")).into()
            );
        }
        leave_out(invalid, context);
        Ok(())
    }

    /// Prepares objects for a format: loads meshes that it wants inside, refuses or leaves out what it cannot
    /// express, and says what else gets lost.
    pub(super) fn fit(
        &self,
        found: Extraction,
        spelling: &Spelling,
        frame: &str,
        context: &mut Context<'_>,
    ) -> Result<Extraction> {
        spelling.check_frame(frame).map_err(|wrong| UsageError::new(format!("--frame {frame}: {wrong}")))?;
        let mut meshes = Meshes::in_folder(Path::new(""));
        let kinds = spelling.limits.kinds;
        let inline = kinds.contains(&Kind::Triangles) && !kinds.contains(&Kind::MeshFile);
        let (mut fitting, mut invalid) = (Extraction::default(), Vec::new());
        let mut lost: Vec<(&str, Vec<String>)> = Vec::new();
        for mut located in found.objects {
            let loaded = if inline { meshes.load(&mut located.object) } else { Ok(()) };
            let checked = loaded.and_then(|()| spelling.check_in(&located.object, frame));
            match checked {
                Ok(()) => {
                    for what in spelling.loses(&located.object) {
                        match lost.iter_mut().find(|(other, _)| *other == what) {
                            Some((_, names)) => names.push(located.object.name.clone()),
                            None => lost.push((what, vec![located.object.name.clone()])),
                        }
                    }
                    fitting.objects.push(located);
                }
                Err(reason) => {
                    invalid.push(Invalid { namespace: located.namespace, id: located.id, reason: reason.into() })
                }
            }
        }
        self.report(&invalid, context)?;
        for (what, names) in lost {
            let name = spelling.name;
            context.output.warn(&format!("{name} has no {what}; written without them: {}", shortened(&names)));
        }
        Ok(fitting)
    }
}

/// The first names, and how many more there are.
fn shortened(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let first = names.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{first} and {} more", names.len() - SHOWN) } else { first }
}

/// The spelling of a format.
pub(super) fn spelling(format: Format) -> Result<&'static Spelling> {
    by_name(format.name())
        .ok_or_else(|| UsageError::new(format!("`{}` is not a format of scenes", format.name())).into())
}

/// A scene file, in the format that is named or that it looks like.
pub(super) fn read_file(
    path: &Path,
    from: Option<&str>,
    context: &mut Context<'_>,
) -> Result<(Content, &'static Spelling)> {
    let source: Source = context.read(path)?;
    let spelling = match from {
        Some(name) => by_name(name).ok_or_else(|| UsageError::new(format!("`{name}` is not a format of scenes")))?,
        None => recognize(source.text()).ok_or_else(|| unknown(&source))?,
    };
    let content = (spelling.read)(&source)?;
    check_names(path, &content)?;
    if let Content::Scene(Scene { robots, .. }) = &content
        && !robots.is_empty()
    {
        let names = robots.join("`, `");
        context.output.warn(&format!("{}: left out: `{names}`; a robot is no object of a scene", path.display()));
    }
    Ok((content, spelling))
}

/// Warns of objects that are left out.
pub(super) fn leave_out(invalid: &[Invalid], context: &mut Context<'_>) {
    invalid.iter().for_each(|one| context.output.warn(&format!("left out: {one}")));
}

/// That a file looks like no format of scenes.
fn unknown(source: &Source) -> Diagnostic {
    let formats = FORMATS.map(Format::name).join(", ");
    let message = format!(
        "this looks like no format of scenes (in MoveIt's, the second line is `* NAME` or `.`); name its format with --from: {formats}"
    );
    let first = source.text().lines().next().unwrap_or_default();
    Diagnostic::new(source, Span::new(0, first.len()), message)
}

/// Refuses a scene with two objects of one name: which of them is meant is not known.
fn check_names(path: &Path, content: &Content) -> Result<(), WrongInput> {
    let Content::Scene(scene) = content else { return Ok(()) };
    let mut names = HashSet::new();
    match scene.objects.iter().find(|object| !names.insert(object.name.as_str())) {
        None => Ok(()),
        Some(object) => Err(WrongInput::new(format!(
            "{}: there are two objects with the name `{}`; give one of them another",
            path.display(),
            object.name
        ))),
    }
}

/// The names of the formats that scenes are read from, for the command line.
pub(super) fn names() -> clap::builder::PossibleValuesParser {
    clap::builder::PossibleValuesParser::new(FORMATS.map(Format::name))
}

/// Reads a length or an angle.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| *number >= 0.0 && number.is_finite());
    number.ok_or_else(|| "expected a number that is not negative, like 0.01".to_owned())
}
