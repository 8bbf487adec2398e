//! `rmem validate DOMAIN [PROBLEM [PLAN]]`: parse, check, and simulate a plan.

use std::path::{Path, PathBuf};

use bson::{Bson, Document, doc};
use clap::Args;

use super::template::{is_template, warn};
use super::{Context, WrongInput, error, formats};
use crate::error::{Error, Result};
use crate::exit::Exit;
use crate::formats::command_line::word;
use crate::formats::{Diagnostic, Diagnostics, Source, Span, pddl::Dialect, plan::read_plan, shell};
use crate::output::Format;
use crate::pddl::{Domain, Happening, Plan, Problem, Repair, Validation, repair, trace, validate};
use crate::plan::{reported, rounded};
use crate::planner::{Task, spaced};
use crate::problem::names;
use crate::saturate::to_i64;

/// Check a domain and a problem, and simulate a plan
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  rmem validate domain.pddl problem.pddl plan.txt\n  rmem validate domain.pddl problem.pddl plan.txt -v\n  rmem validate domain.pddl problem.pddl plans/*.txt --format json\n\nWith -v, what happens at each moment is printed first: what becomes true (+) and false (-), and the numbers that change.\n\nWith --format json, prints an array with a document for each plan, or for the problem, or the domain, that was checked.\n\nExits with 1 if any plan is invalid."
)]
#[command(arg = formats::argument(&formats::TEXT))]
pub struct ValidateArgs {
    /// The domain
    #[arg(value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// A problem of it; - is stdin
    #[arg(value_name = "PROBLEM")]
    pub problem: Option<PathBuf>,
    /// Plans for it; - is stdin
    #[arg(value_name = "PLAN")]
    pub plans: Vec<PathBuf>,
    /// Take `//` to the end of a line as a comment
    #[arg(long)]
    pub lenient: bool,
}

pub(super) fn run(args: &ValidateArgs, context: &mut Context<'_>) -> Result<Exit> {
    let format = context.format(&formats::TEXT)?;
    let dialect = Dialect { lenient: args.lenient };
    let source = context.read_pddl(&args.domain)?;
    let domain = Domain::read(&source, dialect).map_err(|wrong| of_template(wrong, &source, &args.domain))?;
    warn(domain.warnings(), context);
    let Some(problem_file) = &args.problem else {
        let valid = doc! { "domain": domain.name(), "valid": true };
        print(&[format!("domain {} is valid", domain.name())], vec![valid], format, context)?;
        return Ok(Exit::Done);
    };
    let source = context.read_pddl(problem_file)?;
    let problem = Problem::read(&source, &domain, dialect);
    let problem = problem.map_err(|wrong| of_template(wrong, &source, problem_file))?;
    warn(problem.warnings(), context);
    if let Some(marked) = template_mark(&source, problem_file) {
        context.output.warn(&marked.to_string());
    }
    if args.plans.is_empty() {
        let valid = doc! { "domain": domain.name(), "problem": problem.name(), "valid": true };
        print(&[format!("problem {} is valid", problem.name())], vec![valid], format, context)?;
        return Ok(Exit::Done);
    }
    let (mut exits, mut reports, mut unread) = (Vec::new(), Vec::new(), None);
    for path in &args.plans {
        let read = context.read_pddl(path).and_then(|file| Ok(CheckedPlan::new(&file, &domain, &problem)?));
        let mut checked = match read {
            Ok(checked) => checked,
            // The others are checked all the same, and a program reads one entry for each plan.
            Err(error) if args.plans.len() > 1 || format == Format::Json => {
                let message = error::text(&error);
                reports.push(doc! { "plan": path.display().to_string(), "valid": Bson::Null, "message": message });
                unread.get_or_insert(error::report(&error, &mut context.output));
                continue;
            }
            Err(error) => return Err(error),
        };
        if context.output.is_verbose() {
            checked.trace = Some(trace(&domain, &problem, &checked.plan.steps));
        }
        match format {
            Format::Json => reports.push(checked.to_document()),
            _ => print(&checked.lines(args.plans.len() > 1), vec![checked.to_document()], format, context)?,
        }
        exits.push(checked.exit());
    }
    if format == Format::Json {
        print(&[], reports, format, context)?;
    }
    // Of several plans, the worst counts.
    let worst = [Exit::No, Exit::Unsupported].into_iter().find(|exit| exits.contains(exit));
    Ok(unread.or(worst).unwrap_or(Exit::Done))
}

/// What is wrong with a file; with one that is a template, the command that makes PDDL of it.
fn of_template(wrong: Vec<Diagnostic>, source: &Source, path: &Path) -> Error {
    let command = format!("rmem gen-problem --template {} --domain DOMAIN", word(&path.to_string_lossy()));
    if is_template(path) {
        let message = "is a template; rmem gen-problem makes a problem of it and checks that";
        return WrongInput::new(format!("{} {message}: {command}", path.display())).into();
    }
    let is_marked = mark(source).is_some();
    let advise = |(nth, error): (usize, Diagnostic)| match nth == 0 && is_marked {
        true => {
            error.without_hints().hint(format!("this is a template; a problem is made of it and checked by: {command}"))
        }
        false => error,
    };
    Diagnostics(wrong.into_iter().enumerate().map(advise).collect()).into()
}

/// Where a problem that can be read has a mark of a template.
fn template_mark(source: &Source, path: &Path) -> Option<Diagnostic> {
    let span = mark(source)?;
    let message = format!("`{}` begins a part of a template, and is read as PDDL here", source.slice(span));
    let command = format!("rmem gen-problem --template {} --domain DOMAIN", word(&path.to_string_lossy()));
    Some(
        Diagnostic::new(source, span, message)
            .hint(format!("where it is a template, a problem is made of it and checked by: {command}")),
    )
}

/// The first mark of a template outside of comments: `<<#`, `{%` or `{{`.
fn mark(source: &Source) -> Option<Span> {
    let mut start = 0;
    source.text().split_inclusive('\n').find_map(|line| {
        let code = line.split(';').next().unwrap_or_default();
        let found = ["<<#", "{%", "{{"].iter().filter_map(|mark| Some((code.find(mark)?, mark.len()))).min();
        let found = found.map(|(at, length)| Span::new(start + at, start + at + length));
        start += line.len();
        found
    })
}

/// Prints lines for people, or documents.
fn print(lines: &[String], reports: Vec<Document>, format: Format, context: &mut Context<'_>) -> Result<()> {
    match format {
        Format::Json => {
            let reports = reports.into_iter().map(Bson::Document).collect();
            context.output.line(&shell::pretty(&Bson::Array(reports)))?;
        }
        _ => lines.iter().try_for_each(|line| context.output.line(line))?,
    }
    Ok(())
}

/// How far the cost that a file gives may be from the true one: planners print few decimals.
const CLAIM_TOLERANCE: f64 = 0.01;

/// A plan, and what its simulation shows.
struct CheckedPlan {
    name: String,
    plan: Plan,
    verdict: Validation,
    repairs: Vec<Repair>,
    /// The cost that the file itself gives.
    claim: Option<f64>,
    /// What happens at each moment, under `-v`.
    trace: Option<Vec<Happening>>,
}

impl CheckedPlan {
    fn new(file: &Source, domain: &Domain, problem: &Problem) -> Result<Self, Diagnostic> {
        let text = Source::new(file.name(), names::spell_plan(file.text()));
        let file_plan = read_plan(&text)?;
        let (is_printed, claim) = (file_plan.is_printed, file_plan.cost);
        let mut plan = Plan::from(file_plan).timed_as(domain, problem);
        let mut verdict = validate(domain, problem, &plan.steps);
        if is_printed && matches!(verdict, Validation::Invalid(_)) {
            (plan, verdict) = spaced(&plan, &Task { domain, problem }).unwrap_or((plan, verdict));
        }
        let repairs = match verdict {
            Validation::Invalid(_) => repair(domain, problem, &plan.steps),
            _ => Vec::new(),
        };
        Ok(Self { name: file.name().to_owned(), plan, verdict, repairs, claim, trace: None })
    }

    fn exit(&self) -> Exit {
        match self.verdict {
            Validation::Valid { .. } => Exit::Done,
            Validation::Invalid(_) => Exit::No,
            Validation::Unchecked(_) => Exit::Unsupported,
        }
    }

    /// The verdict for people, with the name of the file where there are several.
    fn lines(&self, is_named: bool) -> Vec<String> {
        let name = if is_named { format!("{}: ", self.name) } else { String::new() };
        let makespan = self.plan.makespan().map(rounded);
        let verdict = match (&self.verdict, makespan) {
            (Validation::Valid { value }, Some(makespan)) => {
                let other = value.map(rounded).filter(|value| *value != makespan && *value != self.length());
                let value = other.map(|value| format!(", value {value}")).unwrap_or_default();
                format!("the plan is valid, makespan {makespan}{value}")
            }
            (Validation::Valid { value: Some(value) }, None) => format!("the plan is valid, value {}", rounded(*value)),
            (verdict, _) => names::readable(&verdict.to_string()),
        };
        let value = match self.verdict {
            Validation::Valid { value } => value,
            _ => None,
        };
        let claim = self.claim.zip(value).filter(|(claim, value)| (claim - value).abs() > CLAIM_TOLERANCE);
        let claim = claim.map(|(claim, _)| format!("  the file says that its cost is {}", rounded(claim)));
        let repairs = self.repairs.iter().map(|repair| names::readable(&repair.to_string()));
        let repairs: Vec<String> =
            repairs.flat_map(|text| text.lines().map(|line| format!("  {line}")).collect::<Vec<_>>()).collect();
        let trace = self.trace.iter().flatten().flat_map(|happening| self.happening_lines(happening));
        trace.chain([format!("{name}{verdict}")]).chain(claim).chain(repairs).collect()
    }

    /// A moment: what happens, then what becomes true (+) and false (-), and the numbers that change.
    fn happening_lines(&self, happening: &Happening) -> Vec<String> {
        let time = match self.is_timed() {
            true => format!("{:.3}", happening.time),
            false => rounded(happening.time).to_string(),
        };
        let events = happening.events.iter().map(|event| format!("{time}: {}", names::readable(&event.to_string())));
        let facts = |sign: char, facts: &[String]| -> Vec<String> {
            facts.iter().map(|fact| format!("  {sign} {}", names::readable(fact))).collect()
        };
        let values = happening.values.iter().map(|(fluent, before, after)| {
            let before = before.map_or_else(|| "undefined".to_owned(), |before| rounded(before).to_string());
            format!("  = {} from {before} to {}", names::readable(fluent), rounded(*after))
        });
        let changes = [facts('-', &happening.becomes_false), facts('+', &happening.becomes_true)].concat();
        events.chain(changes).chain(values).collect()
    }

    fn is_timed(&self) -> bool {
        self.plan.steps.iter().any(|step| step.start.is_some())
    }

    /// The verdict for programs.
    fn to_document(&self) -> Document {
        let value = match self.verdict {
            Validation::Valid { value } => value.map(reported),
            _ => None,
        };
        let (step, message) = match &self.verdict {
            Validation::Valid { .. } => (None, None),
            Validation::Invalid(failure) => (failure.step(), Some(failure.to_string())),
            Validation::Unchecked(reason) => (None, Some(reason.clone())),
        };
        let mut document = doc! {
            "plan": &self.name,
            "valid": match self.verdict {
                Validation::Unchecked(_) => Bson::Null,
                ref verdict => Bson::Boolean(matches!(verdict, Validation::Valid { .. })),
            },
            "value": value,
            "makespan": self.plan.makespan().map(reported),
            "steps": to_i64(self.plan.steps.len()),
            "step": step.and_then(|step| i64::try_from(step + 1).ok()),
            "message": message.map(|message| names::readable(&message)),
            "repairs": self.repairs.iter().map(|repair| names::readable(&repair.to_string())).collect::<Vec<_>>(),
        };
        if let Some(trace) = &self.trace {
            document.insert("trace", trace.iter().map(to_document).collect::<Vec<_>>());
        }
        document
    }

    fn length(&self) -> f64 {
        self.plan.steps.len() as f64
    }
}

/// A moment for programs.
fn to_document(happening: &Happening) -> Document {
    let restored = |texts: &[String]| texts.iter().map(|text| names::readable(text)).collect::<Vec<_>>();
    let value = |(fluent, before, after): &(String, Option<f64>, f64)| {
        doc! { "fluent": names::readable(fluent), "before": before.map(reported), "after": reported(*after) }
    };
    doc! {
        "time": reported(happening.time),
        "events": happening.events.iter().map(|event| names::readable(&event.to_string())).collect::<Vec<_>>(),
        "true": restored(&happening.becomes_true),
        "false": restored(&happening.becomes_false),
        "values": happening.values.iter().map(value).collect::<Vec<_>>(),
    }
}
