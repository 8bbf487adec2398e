//! `rmem clips run PROGRAM…`: CLIPS with the memory's functions inside it.

use std::path::{Path, PathBuf};

use bson::Document;

use super::args::{RunArgs, WORLD};
use crate::clips::engine::{self, Ended, Job, Message, Sender, robot_configuration};
use crate::commands::{Context, lock};
use crate::error::{Context as _, Result};
use crate::exit::Exit;
use crate::formats::Source;
use crate::memory::dump::world_file::{WorldError, WorldFile};
use crate::planner::Host;
use crate::store::Namespace;

pub(in crate::commands::clips) fn run(args: &RunArgs, context: &mut Context<'_>) -> Result<Exit> {
    let programs = args.programs.iter().map(|path| context.read_clips(path)).collect::<Result<Vec<Source>>>()?;
    let facts = args.facts.iter().map(|path| context.read_clips(path)).collect::<Result<Vec<Source>>>()?;
    let guard = crate::interrupt::InterruptGuard::new();
    let job = Job {
        programs,
        folders: folders(args),
        configuration: configuration(args, context)?,
        facts,
        cycles: args.cycles,
        timeout: args.timeout,
        interrupted: guard.interrupted(),
        world: args.sync.clone().map_or_else(|| Namespace::parse(WORLD), Ok)?,
        is_synced: args.sync.is_some(),
        collection: context.settings.collection.value.clone(),
        mutexes: lock::mutexes(context)?,
        planners: context.planners(),
        host: Host { interrupted: guard.interrupted(), ..context.host() },
    };
    let (opening, worlds) = (context.opening(), worlds(context)?);
    let is_observed = context.observer().is_some();
    let open = move |sender: &Sender| {
        let memory = opening.open(is_observed.then(|| sender.observer()))?;
        for world in &worlds {
            let loaded =
                WorldFile::parse(world).map_err(|source| WorldError::Text { name: world.name().to_owned(), source });
            let loaded = loaded.and_then(|world| world.load(&memory));
            loaded.with_context(|| format!("loading {}", world.name()))?;
        }
        Ok(memory)
    };
    let ended = engine::run(job, open, &mut |message| handle(message, context))?;
    Ok(match ended {
        Ended::Well => Exit::Done,
        Ended::Exited(code) => Exit::Passed(u8::try_from(code & 0xff).unwrap_or(u8::MAX)),
        Ended::Failed => Exit::No,
        Ended::OutOfTime => {
            context.output.error("the time was over while rules were firing");
            Exit::OutOfTime
        }
        Ended::Interrupted => Exit::Interrupted,
    })
}

/// Where programs find files.
fn folders(args: &RunArgs) -> Vec<PathBuf> {
    let mut folders = args.path.clone();
    for program in args.programs.iter().filter_map(|program| program.parent()) {
        if program != Path::new("") && !folders.iter().any(|folder| folder == program) {
            folders.push(program.to_owned());
        }
    }
    folders.push(PathBuf::from("."));
    folders
}

/// The documents of the files of `--values`.
fn configuration(args: &RunArgs, context: &mut Context<'_>) -> Result<Vec<Document>> {
    let mut all = Vec::new();
    for path in &args.values {
        all.extend(robot_configuration::documents(&context.read(path)?)?);
    }
    Ok(all)
}

/// The world files of `--load`.
fn worlds(context: &mut Context<'_>) -> Result<Vec<Source>> {
    context.settings.load.clone().iter().map(|path| context.read(path)).collect()
}

/// Prints what the program says, and reads what it wants to know.
fn handle(message: Message, context: &mut Context<'_>) -> Result<()> {
    match message {
        Message::Out(text) => context.output.stdout().write_all(&text)?,
        Message::Err(text) => {
            context.output.flush()?;
            context.output.pass_on(&text);
        }
        Message::Note(text) => context.output.note(&text),
        Message::Warning(text) => context.output.warn(&text),
        Message::Operation(operation) => {
            if let Some(observer) = context.observer() {
                observer(&operation);
            }
        }
        Message::Pause => {
            context.output.flush()?;
            context.report_operations();
        }
        Message::Read(answer) => {
            context.output.flush()?;
            // The receiver may have ended; then the line is not needed.
            drop(answer.send(context.read_line()?));
        }
    }
    Ok(())
}
