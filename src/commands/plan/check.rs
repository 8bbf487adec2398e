//! `rmem plan check ID`: does the rest of a stored plan still reach its goal?

use bson::{Bson, Document, doc};

use super::pose::{self, PlanningTask, Sections, key, pose};
use super::stored;
use crate::cli::PlanCheck;
use crate::commands::{Context, WrongInput};
use crate::exit::Exit;
use crate::formats::{Diagnostics, Source, shell};
use crate::memory::Memory;
use crate::output::Format;
use crate::pddl::{Cause, Failure, Repair, Step, Validation, repair, validate};
use crate::plan::{Input, Record, Status, Stored, TaskSource, spelled};
use crate::problem::{Part, names};
use crate::store::Namespace;

pub(super) fn run(args: &PlanCheck, context: &mut Context<'_>) -> anyhow::Result<Exit> {
    let format = context.format(&[Format::Text, Format::Json])?;
    let now = args.problem.as_deref().map(|path| context.read(path)).transpose()?;
    let memory = context.memory()?;
    let record = stored::get(&args.plan.id, &args.plan.namespace, &memory)?;
    let verdict = judge(&record, now, &memory, context)?;
    match format {
        Format::Json => context.output.line(&shell::relaxed(&verdict.to_document(&record.id())))?,
        _ => verdict.tell(&record.id()).iter().try_for_each(|line| context.output.line(line))?,
    }
    Ok(verdict.exit())
}

/// What is left of a plan, and whether it still reaches the goal.
pub(super) struct Verdict {
    /// How many steps are left, and of how many.
    left: (usize, usize),
    fault: Option<Fault>,
    unjudged: Option<String>,
}

/// What is wrong with the rest of a plan.
#[derive(Default)]
struct Fault {
    /// The first broken step, counted from 1 over the whole plan; none where the goal is missed.
    step: Option<usize>,
    action: Option<String>,
    /// What was said of it.
    message: String,
    /// What is false, as PDDL.
    missing: Vec<String>,
    /// Where what is missing would come from, or what should not be there does.
    sources: Vec<Origin>,
    /// What would make the plan go on.
    repairs: Vec<Repair>,
}

struct Origin {
    what: String,
    template: String,
    document: Option<(Namespace, Bson)>,
}

/// Poses the plan's problem as it is now and simulates what is left.
pub(super) fn judge(
    record: &Record,
    now: Option<Source>,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<Verdict> {
    let mut recipe = record.recipe().map_err(|error| WrongInput::new(format!("{}: {error}", record.id())))?;
    if let Some(problem) = now {
        recipe.task = Input::Problem(problem);
    } else if !recipe.is_template() {
        context.output.warn(
            "the plan's problem was a file, which says nothing of the memory: every step is simulated, from the \
             file's initial state; give the state of now with --problem",
        );
        return simulate(record, &recipe, &|_| true, memory, context);
    }
    simulate(record, &recipe, &|status| status != Status::Done, memory, context)
}

fn simulate(
    record: &Record,
    recipe: &TaskSource,
    is_left: &dyn Fn(Status) -> bool,
    memory: &Memory,
    context: &mut Context<'_>,
) -> anyhow::Result<Verdict> {
    let domain = &pose::domain(recipe)?;
    let progress = record.progress();
    let count = progress.len();
    let steps = progress.iter().enumerate();
    let left: Vec<usize> = steps.filter(|(_, step)| is_left(step.status)).map(|(index, _)| index).collect();
    let verdict = |fault, unjudged| Ok(Verdict { left: (left.len(), count), fault, unjudged });
    let posed = match pose(recipe, domain, Sections::Unsaid, memory, context) {
        Ok(posed) => posed,
        Err(error) => match error.downcast::<Diagnostics>() {
            Ok(Diagnostics(complaints)) => {
                let said: Vec<String> = complaints.iter().map(ToString::to_string).collect();
                let message = format!("the problem cannot be posed any more:\n{}", said.join("\n"));
                return verdict(Some(Fault { message, ..Fault::default() }), None);
            }
            Err(error) => return Err(error),
        },
    };
    let names = posed.names(domain);
    let name = |value: &Bson| names.get(&key(value)).cloned().or_else(|| spelled(value));
    let plan = match record.plan(&name).map_err(|error| stored::broken(&record.id(), &error))? {
        Stored::Plan(plan) => plan,
        Stored::Failure(outcome) => {
            let message = format!("there is no plan: {}", outcome.as_deref().unwrap_or("none was found"));
            return verdict(Some(Fault { message, ..Fault::default() }), None);
        }
    };
    let steps = rest(&plan.steps, &left);
    match validate(domain, &posed.problem, &steps) {
        Validation::Valid { .. } => verdict(None, None),
        Validation::Unjudged(reason) => verdict(None, Some(reason)),
        Validation::Invalid(failure) => {
            let mut repairs = repair(domain, &posed.problem, &steps);
            repairs.iter_mut().for_each(|repair| recount(repair, &left));
            verdict(Some(Fault { repairs, ..fault(&failure, &left, &steps, &posed) }), None)
        }
    }
}

/// The steps that are left; those with times begin at once.
fn rest(steps: &[Step], left: &[usize]) -> Vec<Step> {
    let mut rest: Vec<Step> = left.iter().filter_map(|index| steps.get(*index)).cloned().collect();
    if rest.len() < steps.len() {
        let first = rest.iter().filter_map(|step| step.start).fold(f64::INFINITY, f64::min);
        rest.iter_mut().for_each(|step| step.start = step.start.map(|start| start - first));
    }
    rest
}

/// Names the step that is to blame by its place in the whole plan.
fn recount(repair: &mut Repair, left: &[usize]) {
    if let Cause::Step { step, .. } = &mut repair.cause
        && let Some(place) = left.get(*step)
    {
        *step = *place;
    }
}

fn fault(failure: &Failure, left: &[usize], steps: &[Step], posed: &PlanningTask) -> Fault {
    let step = failure.step();
    let said = failure.to_string();
    let message = match step.and_then(|step| said.strip_prefix(&format!("step {}: ", step + 1))) {
        Some(rest) => rest.to_owned(),
        None => said.clone(),
    };
    let missing = match failure {
        Failure::Precondition { condition, .. } => vec![condition.clone()],
        Failure::Goal { conditions } => conditions.clone(),
        _ => Vec::new(),
    };
    let action = step.and_then(|step| steps.get(step)).map(|step| {
        let words: Vec<&str> = std::iter::once(&step.action).chain(&step.arguments).map(String::as_str).collect();
        names::restore(&format!("({})", words.join(" ")))
    });
    Fault {
        step: step.and_then(|step| left.get(step)).map(|index| index + 1),
        action,
        message: names::restore(&message),
        sources: missing.iter().flat_map(|condition| sources(condition, posed)).collect(),
        missing: missing.iter().map(|condition| names::restore(condition)).collect(),
        repairs: Vec::new(),
    }
}

/// Where in the template a missing fact would be written, or which document says what should not be.
fn sources(condition: &str, posed: &PlanningTask) -> Vec<Origin> {
    let Some(generated) = &posed.generated else { return Vec::new() };
    let template = generated.template().name();
    let negated = condition.strip_prefix("(not ").and_then(|rest| rest.strip_suffix(')'));
    let atom = negated.unwrap_or(condition);
    let there = generated.explain_atom(posed.problem.tree(), atom);
    let there: Vec<_> = there.into_iter().filter(|explanation| explanation.part == Part::Init).collect();
    if negated.is_none() && there.is_empty() {
        let predicate = atom.trim_start_matches('(').split([' ', ')']).next().unwrap_or_default();
        let writers = generated.writers(predicate).into_iter();
        return writers
            .map(|(line, text)| Origin {
                what: format!("nothing in the memory says so; it would be written by {text}"),
                template: format!("{template}:{line}"),
                document: None,
            })
            .collect();
    }
    let what = |text: &str| match negated {
        Some(_) => format!("{text} is in the memory"),
        None => format!("{text} is in the memory, but no longer true after the steps before"),
    };
    there
        .into_iter()
        .map(|explanation| Origin {
            what: what(&explanation.text),
            template: format!("{template}:{}:{}", explanation.origin.line, explanation.origin.column),
            document: explanation.documents.into_iter().next(),
        })
        .collect()
}

impl Verdict {
    /// Whether the plan is still good.
    pub(super) fn holds(&self) -> bool {
        self.fault.is_none() && self.unjudged.is_none()
    }

    fn exit(&self) -> Exit {
        match (&self.fault, &self.unjudged) {
            (Some(_), _) => Exit::No,
            (None, Some(_)) => Exit::Unsupported,
            (None, None) => Exit::Done,
        }
    }

    /// The verdict for people, a line each.
    pub(super) fn tell(&self, id: &str) -> Vec<String> {
        let (left, count) = self.left;
        if let Some(reason) = &self.unjudged {
            return vec![format!("{id} cannot be judged: {reason}")];
        }
        let Some(fault) = &self.fault else {
            return vec![format!("{id} holds: {left} of {count} steps are left")];
        };
        let step = fault.step.map(|step| format!("step {step}: ")).unwrap_or_default();
        let mut lines = vec![format!("{id} does not hold: {step}{}", fault.message)];
        for source in &fault.sources {
            lines.push(format!("  {}: {}", source.template, source.what));
            if let Some((namespace, id)) = &source.document {
                lines.push(format!("  document _id {} of {namespace}", shell::relaxed_value(id)));
            }
        }
        let repairs = fault.repairs.iter().map(|repair| names::restore(&repair.to_string()));
        lines.extend(repairs.flat_map(|text| text.lines().map(|line| format!("  {line}")).collect::<Vec<_>>()));
        lines
    }

    /// The verdict for programs.
    fn to_document(&self, id: &str) -> Document {
        let (left, count) = self.left;
        let mut document = doc! { "plan": id, "holds": self.holds(), "left": number(left), "steps": number(count) };
        if let Some(reason) = &self.unjudged {
            document.insert("unjudged", reason);
        }
        let Some(fault) = &self.fault else { return document };
        if let Some(step) = fault.step {
            document.insert("step", number(step));
        }
        if let Some(action) = &fault.action {
            document.insert("action", action);
        }
        document.insert("message", &fault.message);
        document.insert("missing", fault.missing.clone());
        let sources = fault.sources.iter().map(|source| {
            let mut entry = doc! { "what": &source.what, "template": &source.template };
            if let Some((namespace, id)) = &source.document {
                entry.insert("namespace", namespace.to_string());
                entry.insert("document", id.clone());
            }
            Bson::Document(entry)
        });
        document.insert("sources", sources.collect::<Vec<_>>());
        document.insert("repairs", fault.repairs.iter().map(mended).collect::<Vec<_>>());
        document
    }
}

/// A repair for programs; the step that is to blame counts from 1.
fn mended(repair: &Repair) -> Bson {
    let spelled = |text: &String| names::restore(text);
    let all = |texts: &[String]| texts.iter().map(spelled).collect::<Vec<_>>();
    let mut document = doc! { "condition": spelled(&repair.condition) };
    if let Cause::Step { step, action } = &repair.cause {
        document.insert("undone_by", doc! { "step": number(step + 1), "action": spelled(action) });
    }
    if !repair.values.is_empty() {
        document.insert("values", all(&repair.values));
    }
    let remedies = repair.remedies.iter().map(|remedy| {
        let (action, missing) = (spelled(&remedy.action), all(&remedy.missing));
        Bson::Document(doc! { "action": action, "possible": remedy.is_possible, "missing": missing })
    });
    document.insert("remedies", remedies.collect::<Vec<_>>());
    document.into()
}

fn number(count: usize) -> Bson {
    Bson::Int64(i64::try_from(count).unwrap_or(i64::MAX))
}
