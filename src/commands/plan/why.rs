//! `rmem plan why ID`: where a stored plan comes from.

use bson::{Bson, Document, doc};
use clap::Args;

use super::stored::{self, StoredArgs};
use crate::commands::{Context, WrongInput, formats};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::shell;
use crate::output::Format;
use crate::plan::{Last, Record, Status, hash, rounded, whole};
use crate::problem::names;
use crate::saturate::to_i64;
use crate::store::Namespace;

/// How wide the names are.
const WIDTH: usize = 12;
/// How many digits of a hash are printed.
const DIGITS: usize = 12;

/// Explain where a stored plan comes from
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  rmem plan why last\n  rmem plan why last --format json")]
#[command(arg = formats::argument(&formats::TEXT))]
pub struct WhyArgs {
    /// The plan.
    #[command(flatten)]
    pub plan: StoredArgs,
}

pub(super) fn run(args: &WhyArgs, context: &mut Context<'_>) -> Result<Exit> {
    let memory = context.memory()?;
    let record = stored::get(&args.plan, Last::Run, &memory, context)?;
    let lineage = record
        .lineage()
        .ok_or_else(|| WrongInput::new(format!("{} has no lineage: rmem did not store it", record.id())))?;
    if context.format(&formats::TEXT)? == Format::Json {
        context.output.line(&shell::relaxed(&to_document(&record, lineage, &args.plan.namespace)))?;
        return Ok(Exit::Done);
    }
    for (name, text) in story(&record, lineage) {
        context.output.line(&format!("{name:WIDTH$}{text}"))?;
    }
    Ok(Exit::Done)
}

/// The lineage for programs: as it is stored, but for the texts of the files.
fn to_document(record: &Record, lineage: &Document, namespace: &Namespace) -> Document {
    let count = |status| to_i64(record.progress().iter().filter(|step| step.status == status).count());
    let mut document = doc! {
        "id": record.id(), "namespace": namespace.to_string(),
        "execution": {
            "steps": to_i64(record.progress().len()), "done": count(Status::Done), "running": count(Status::Running),
            "failed": count(Status::Failed),
        },
    };
    document.extend(lineage.clone());
    let sources = document.remove("sources");
    let sources = sources.as_ref().and_then(Bson::as_document);
    for what in ["domain", "template", "problem"] {
        let Ok(known) = lineage.get_str(what) else { continue };
        let kept = sources.and_then(|sources| sources.get_document(what).ok());
        let name = kept.and_then(|kept| kept.get_str("name").ok());
        let is_changed = name.and_then(|name| is_changed(name, known));
        document.insert(what, doc! { "file": name, "sha256": known, "changed": is_changed });
    }
    for key in ["collection", "parameters"] {
        document.extend(sources.and_then(|sources| sources.get(key)).map(|value| (key.to_owned(), value.clone())));
    }
    if let Ok(goal) = lineage.get_str("goal") {
        document.insert("goal", names::readable(goal));
    }
    document
}

/// Whether a file is another now; none where it cannot be read.
fn is_changed(name: &str, known: &str) -> Option<bool> {
    std::fs::read_to_string(name).ok().map(|text| hash(&text) != known)
}

/// The lines that are printed: a name and its text.
fn story(record: &Record, lineage: &Document) -> Vec<(&'static str, String)> {
    let mut story = vec![("plan", record.id())];
    let mut say = |name: &'static str, text: Option<String>| story.extend(text.map(|text| (name, text)));
    let text = |key: &str| lineage.get(key).map(readable);
    say("outcome", text("outcome"));
    say("length", text("length").map(|length| format!("{length} steps")));
    say("cost", text("cost"));
    say("goal", text("goal").map(|goal| names::readable(&goal)));
    let sources = lineage.get_document("sources").ok();
    for what in ["domain", "template", "problem"] {
        let kept = sources.and_then(|sources| sources.get_document(what).ok());
        say(what, lineage.get_str(what).ok().map(|hash| source(kept, hash)));
    }
    for key in ["collection", "parameters"] {
        let value = sources.and_then(|sources| sources.get(key));
        say(key, value.filter(|value| value.as_document().is_none_or(|inner| !inner.is_empty())).map(readable));
    }
    for query in lineage.get_array("queries").into_iter().flatten().filter_map(Bson::as_document) {
        let part = |key: &str| query.get(key).map(readable).unwrap_or_default();
        let documents = if part("count") == "1" { "document" } else { "documents" };
        let line =
            format!("{} {} in {}: {} {documents}", part("name"), part("query"), part("namespace"), part("count"));
        say("query", Some(line));
    }
    say("planner", planner(lineage));
    for racer in lineage.get_array("race").into_iter().flatten().filter_map(Bson::as_document) {
        say("race", Some(raced(racer)));
    }
    say(
        "command",
        lineage
            .get_array("arguments")
            .ok()
            .filter(|words| !words.is_empty())
            .map(|words| words.iter().map(readable).collect::<Vec<_>>().join(" ")),
    );
    say("timeout", lineage.get_f64("timeout").ok().map(|millis| format!("{millis} ms")));
    say("memory", whole(lineage, "memory_limit").map(|bytes| format!("{bytes} bytes at most")));
    let why = lineage.get_document("why").ok();
    for obstacle in why.and_then(|why| why.get_array("unreachable").ok()).into_iter().flatten() {
        say("unreachable", obstacle.as_document().map(unreachable));
    }
    let unfilled = why.and_then(|why| why.get_array("unfilled").ok()).filter(|names| !names.is_empty());
    say("unfilled", unfilled.map(|names| listed(names)));
    say("started", text("started"));
    let times = lineage.get_document("times").into_iter().flatten();
    let times: Vec<String> =
        times.filter_map(|(name, millis)| Some(format!("{name} {:.1} ms", millis.as_f64()?))).collect();
    say("times", (!times.is_empty()).then(|| times.join(", ")));
    say("rerun of", text("rerun_of"));
    let progress = record.progress();
    let count = |status| progress.iter().filter(|step| step.status == status).count();
    let [done, running, failed] = [Status::Done, Status::Running, Status::Failed].map(count);
    if done + running + failed > 0 {
        story.push(("execution", format!("{done} done, {running} running, {failed} failed, of {}", progress.len())));
    }
    story
}

/// `builtin 0.3`
fn planner(lineage: &Document) -> Option<String> {
    let name = lineage.get_str("planner").ok()?;
    Some(lineage.get_str("version").map_or_else(|_| name.to_owned(), |version| format!("{name} {version}")))
}

/// `(on A B): (stack A B) needs (holding A)`
fn unreachable(obstacle: &Document) -> String {
    let condition = obstacle.get_str("condition").unwrap_or_default();
    let achievers = obstacle.get_array("achievers").into_iter().flatten().filter_map(Bson::as_document);
    let needs = achievers.map(|achiever| {
        let action = achiever.get_str("action").unwrap_or_default();
        match achiever.get_array("missing").ok().filter(|missing| !missing.is_empty()) {
            Some(missing) => format!("{action} needs {}", listed(missing)),
            None => format!("{action} never finds all it needs together"),
        }
    });
    let needs: Vec<String> = needs.collect();
    if needs.is_empty() {
        format!("{condition}: no action makes it true")
    } else {
        format!("{condition}: {}", needs.join("; "))
    }
}

fn listed(words: &[Bson]) -> String {
    words.iter().filter_map(Bson::as_str).collect::<Vec<_>>().join(", ")
}

/// `builtin ferroplan 0.30.0: plan after 0.12 s, 12 steps`
fn raced(racer: &Document) -> String {
    let outcome = racer.get_str("outcome").unwrap_or("unknown");
    let time = racer.get_f64("time").map(|millis| format!(" after {:.2} s", millis / 1000.0)).unwrap_or_default();
    let length = whole(racer, "length").map(|length| format!(", {length} steps")).unwrap_or_default();
    let message = racer.get_str("message").ok().and_then(|message| message.lines().next());
    let message = message.map(|message| format!(": {message}")).unwrap_or_default();
    format!("{}: {outcome}{time}{length}{message}", planner(racer).unwrap_or_default())
}

/// Where a text was read, what it was, and whether it still is.
fn source(kept: Option<&Document>, known: &str) -> String {
    let short = known.get(..DIGITS).unwrap_or(known);
    let Some(name) = kept.and_then(|kept| kept.get_str("name").ok()) else { return format!("sha256 {short}") };
    let changed = if is_changed(name, known) == Some(true) { ", the file is another now" } else { "" };
    format!("{name} (sha256 {short}{changed})")
}

fn readable(value: &Bson) -> String {
    match value {
        Bson::String(text) => text.split_whitespace().collect::<Vec<_>>().join(" "),
        Bson::DateTime(date) => date.try_to_rfc3339_string().unwrap_or_else(|_| date.timestamp_millis().to_string()),
        Bson::Double(number) => rounded(*number).to_string(),
        other => shell::relaxed_value(other),
    }
}
