//! `rmem export mcap`: documents over time as an MCAP log.

use std::io::Write;
use std::path::PathBuf;

use bson::{Bson, Document, RawDocumentBuf, doc};
use clap::Args;

use crate::commands::query::{blame, filter_of, owned};
use crate::commands::{Context, WrongInput, missing};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::formats::mcap::{Channel, Log};
use crate::formats::scene::{Object, document};
use crate::formats::shell;
use crate::memory::frames::Frames;
use crate::output::amount;
use crate::scene::kind::{Kinds, NAME};
use crate::store::{Find, Namespace};
use crate::views::field::{lookup, number};
use crate::views::foxglove::{
    FRAME_TRANSFORMS, FRAME_TRANSFORMS_SCHEMA, SCENE_UPDATE, SCENE_UPDATE_SCHEMA, frame_transforms, scene_update,
};

/// Write documents as JSON messages of an MCAP log, and poses as scenes
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem export mcap robmem.sightings --time seen -o sightings.mcap\n\n\
Each document is a message of the topic /DATABASE/COLLECTION at the time of --time: a date, or seconds since 1970.\n\
Documents that are objects of a scene (rmem scene export) are messages foxglove.SceneUpdate of the topic\n\
/DATABASE/COLLECTION/scene, too, and the frames of DATABASE.frames are foxglove.FrameTransforms of /tf.\n\
Documents without the time are left out; their number is reported on stderr.")]
pub struct McapArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Query that selects documents (default: all documents)
    #[arg(value_name = "QUERY", default_value = "{}", hide_default_value = true)]
    pub query: String,
    /// The field with the time of a document
    #[arg(long, value_name = "FIELD")]
    pub time: String,
    /// The tree of frames (default: frames in the same database)
    #[arg(long, value_name = "NS")]
    pub frames: Option<Namespace>,
    /// Write to FILE
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// The channels of a log.
struct Channels {
    documents: Channel,
    scene: Channel,
}

pub(super) fn run(args: &McapArgs, context: &mut Context<'_>) -> Result<Exit> {
    let given = [("<query>", args.query.as_str())];
    let filter = filter_of(&args.namespace, &args.query)?;
    let find = Find { filter, sort: doc! { &args.time: 1 }, ..Find::default() };
    let kinds = context.settings.object_kinds.clone();
    let kinds = Kinds::of(&kinds, &args.namespace)?;
    let memory = context.memory()?;
    let place = args
        .frames
        .clone()
        .unwrap_or_else(|| Namespace { database: args.namespace.database.clone(), collection: "frames".to_owned() });
    let frames = Frames::read(&place, |find| memory.find(&place, find))?;
    let mut written = Written::default();
    let ended = context.output.write_with(&args.output, |out| {
        let documents = memory.find(&args.namespace, &find).map_err(|error| blame(error, &given))?;
        let documents = documents.map(|found| found.map_err(|error| blame(error, &given)));
        written = write_log(args, &kinds, &frames, documents, out)?;
        match written.documents {
            0 => Err(WrongInput::new(format!(
                "no document of {} has a date or seconds under `{}`",
                args.namespace, args.time
            ))
            .into()),
            _ => Ok(()),
        }
    });
    if ended.is_err() && written.documents == 0 {
        missing::refuse(&args.namespace, &memory, context)?;
    }
    ended?;
    context.output.note(&written.to_string());
    Ok(Exit::Done)
}

/// Writes documents that are in the order of their times as a log.
fn write_log(
    args: &McapArgs,
    kinds: &Kinds,
    frames: &Frames,
    documents: impl Iterator<Item = Result<RawDocumentBuf>>,
    out: &mut dyn Write,
) -> Result<Written> {
    let mut log = Log::new(out).context("beginning the log")?;
    let name = args.namespace.to_string();
    let topic = format!("/{}", name.replace('.', "/"));
    let channels = Channels {
        documents: log.channel(&topic, &name, r#"{"type":"object"}"#)?,
        scene: log.channel(&format!("{topic}/scene"), SCENE_UPDATE, SCENE_UPDATE_SCHEMA)?,
    };
    let mut written = Written::default();
    for found in documents {
        let raw = found?;
        let kind = kinds.find(&raw)?;
        let document = owned(raw)?;
        let Some(time) = lookup(&document, &args.time).and_then(nanoseconds) else {
            written.skipped += 1;
            continue;
        };
        if written.documents == 0 && !frames.all().is_empty() {
            let channel = log.channel("/tf", FRAME_TRANSFORMS, FRAME_TRANSFORMS_SCHEMA)?;
            log.message(channel, time, &frame_transforms(&frames.all(), time).to_string())?;
        }
        log.message(channels.documents, time, &shell::relaxed(&document))?;
        written.documents += 1;
        if let Some((mut object, frame)) = object(&document, kind.map_or(NAME, |kind| &kind.name_key)) {
            if let Some(kind) = kind {
                kind.complete(&mut object);
            }
            log.message(channels.scene, time, &scene_update(&object, &frame, time).to_string())?;
            written.objects += 1;
        }
    }
    log.finish().context("ending the log")?;
    Ok(written)
}

/// What was written.
#[derive(Default)]
struct Written {
    documents: u64,
    objects: u64,
    skipped: u64,
}

impl std::fmt::Display for Written {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {} of them objects of a scene", amount(self.documents, "document"), self.objects)?;
        if self.skipped > 0 {
            write!(f, "; {} without a time are left out", self.skipped)?;
        }
        Ok(())
    }
}

/// The object that a document is in its own frame; none where it is no valid one.
fn object(written: &Document, name_key: &str) -> Option<(Object, String)> {
    let object = document::read(written).ok()?;
    let name = written.get_str(name_key).ok()?.to_owned();
    let frame = written.get_str("frame").ok()?.to_owned();
    Some((Object { name, ..object }, frame))
}

/// A time since 1970.
fn nanoseconds(value: &Bson) -> Option<u64> {
    match value {
        Bson::DateTime(date) => u64::try_from(date.timestamp_millis()).ok()?.checked_mul(1_000_000),
        other => {
            let seconds = number(other).filter(|seconds| (0.0..1e10).contains(seconds))?;
            // Whole microseconds, which a double has for some centuries.
            Some((seconds * 1e6).round() as u64 * 1000)
        }
    }
}
