//! Stored plans on the command line: which one, and why it is not found.

use std::path::Path;

use clap::Args;

use crate::commands::{Context, WrongInput, template};
use crate::error::Result;
use crate::formats::Source;
use crate::memory::Memory;
use crate::plan::{Input, LAST, Last, PlanDocumentError, Record, Repository, TaskSource};
use crate::store::Namespace;

/// Which stored plan.
#[derive(Debug, Clone, Args)]
pub struct StoredArgs {
    /// The plan: its id, a unique prefix of it, or last
    #[arg(value_name = "ID")]
    pub id: String,
    /// Collection of the plans
    #[arg(long = "in", value_name = "NS", default_value = "robmem.plans")]
    pub namespace: Namespace,
}

/// The plan with an id; `last` is the kind of run that is wanted.
pub(super) fn get(plan: &StoredArgs, last: Last, memory: &Memory, context: &mut Context<'_>) -> Result<Record> {
    let repository = Repository::new(memory, &plan.namespace);
    if plan.id != LAST {
        return Ok(repository.get(&plan.id)?);
    }
    let found = repository.last(last)?;
    let newest = repository.last(Last::Run)?;
    if newest.id() != found.id() {
        let (newest, outcome) = (newest.id(), newest.outcome());
        let what = if outcome == "success" { "has no steps".to_owned() } else { format!("found no plan ({outcome})") };
        context.output.note(&format!("last is {}; the run {newest} after it {what}", found.id()));
    }
    Ok(found)
}

/// Says which of the files that a plan was made from are others now, for the texts that are kept with the plan are used.
pub(super) fn warn_of_changes(id: &str, source: &TaskSource, context: &mut Context<'_>) {
    let parts = match &source.input {
        Input::Template(request) => request.parts.iter().map(|part| &part.source).collect(),
        Input::Problem(_) => Vec::new(),
    };
    let texts = [&source.domain, source.input.text()].into_iter().chain(parts);
    let is_changed = |text: &&Source| {
        // The domain that a template was rendered to has its name.
        let is_rendered = text.name() == source.domain.name() && template::is_template(Path::new(text.name()));
        let now = std::fs::read_to_string(text.name());
        !is_rendered && now.is_ok_and(|now| now != text.text())
    };
    let names: Vec<&str> = texts.filter(is_changed).map(Source::name).collect();
    if let [first, ..] = names.as_slice() {
        let (verb, text) = if names.len() == 1 { ("was", "text") } else { ("were", "texts") };
        let plan = if source.is_template() { "--template" } else { "--problem" };
        context.output.warn(&format!(
            "{} {verb} changed since {id} was planned; the {text} of that time, kept with the plan, is taken: \
             `rmem plan --domain … {plan} …` takes {first} as it is now",
            names.join(", ")
        ));
    }
}

/// A document that has a `plan` but is none.
pub(super) fn broken(id: &str, error: &PlanDocumentError) -> WrongInput {
    WrongInput::new(format!("{id} is not a plan that rmem reads: {error}"))
}
