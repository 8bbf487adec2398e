//! The way from a task to an outcome, the same for every planner.

use std::borrow::Cow;
use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::time::{Duration, Instant};

use super::complaint::located;
use super::files::{self, DOMAIN, DOMAIN_FILE, PLAN, PROBLEM, PROBLEM_FILE};
use super::outcome::Outcome;
use super::sizes::Sizes;
use super::task::Task;
use crate::formats::pddl::ast;
use crate::formats::pddl::portable::{self, Sent};
use crate::formats::plan::{Transcript, Verdict};
use crate::formats::{Diagnostic, Source};
use crate::pddl::{Feature, Plan, Step, Validation, Why, validate, why};
use crate::process::{End, Ended, Host, Job, Limits, Mode, Prepared, Share};

/// How many of a planner's last lines an error message repeats.
const TAIL: usize = 12;

/// A program that plans.
pub trait Planner: Send + Sync {
    /// What the user calls it.
    fn name(&self) -> &str;

    /// Its version, where that is known without running it.
    fn version(&self) -> Option<String> {
        None
    }

    /// Whether it is rmem itself, whose word that there is no plan is a proof.
    fn is_own(&self) -> bool {
        false
    }

    /// What it cannot do, what is most worth saying first.
    fn lacks(&self) -> &[Feature] {
        &[]
    }

    /// How large a task may be for it, where its tables have fixed sizes.
    fn sizes(&self) -> Option<Sizes> {
        None
    }

    /// The requirement keywords it knows; none where it takes any.
    fn requirements(&self) -> Option<&[&str]> {
        None
    }

    /// Whether it reads neither things of several types nor durative actions that are more than lists of moments.
    fn reads_only_simple_forms(&self) -> bool {
        false
    }

    /// Program and arguments. `{domain}`, `{problem}` and `{plan}` stand for files; the plan's
    /// is not there until the planner writes it.
    fn command(&self, host: &Host<'_>) -> Vec<OsString>;

    /// Another command to try after such an answer to the first.
    fn again(&self, _answer: &Transcript, _command: &[OsString]) -> Option<Vec<OsString>> {
        None
    }

    /// The program's whole environment, where it does not get rmem's.
    fn environment(&self) -> Option<&[(&str, &str)]> {
        None
    }

    /// What it has printed.
    fn read(&self, output: &Output) -> Transcript;

    /// With what in a task its word that there is no plan is not a proof.
    fn doubts(&self) -> &[Feature] {
        &[]
    }

    /// Whether it can prove that there is no plan at all.
    fn proves(&self) -> bool {
        true
    }

    /// Whether a plan it left when its time ran out counts: it writes whole plans, each
    /// better than the one before.
    fn is_anytime(&self) -> bool {
        false
    }

    /// Whether it looks for better plans of this task once it has found one.
    fn improves(&self, _task: &Task<'_>) -> bool {
        self.is_anytime()
    }

    /// What of a task keeps it from that.
    fn never_improves(&self, _task: &Task<'_>) -> &[Feature] {
        &[]
    }

    /// How to get the program.
    fn install(&self) -> String {
        format!("install `{}`, or name another planner with --planner", self.name())
    }
}

/// What a planner's program left.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// The exit code; none where a signal or a limit ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
    /// Plan files, the last of them the best.
    pub plans: Vec<Source>,
}

/// A planner's run on a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// How it ended.
    pub outcome: Outcome,
    /// The planner's name.
    pub planner: String,
    /// Its version, where known.
    pub version: Option<String>,
    /// Program and arguments, with marks for the files of the run.
    pub command: Vec<String>,
    /// Wall time.
    pub time: Duration,
    /// Processor time of all its processes, to a hundredth of a second, where it is known.
    pub cpu: Option<Duration>,
    /// The most memory that its processes had resident, in bytes: of one of them, or of all at once, where there is a limit of
    /// memory and as far as it was seen.
    pub memory: Option<u64>,
    /// Why the plan could not be simulated, where that is so.
    pub unjudged: Option<String>,
    /// The planner let actions touch, and the plan has them apart ([`Plan::spaced`]).
    pub is_spaced: bool,
    /// The planner refused the costs of actions, and was sent the task without them.
    pub is_without_costs: bool,
    /// Whether rmem itself has proved that there is no plan; otherwise that is the word of another planner.
    pub is_proven: bool,
    /// The exit code of its program; none where a signal or a limit ended it.
    pub code: Option<i32>,
    /// Whether no files could be made for the run: a fault of this machine, not of the planner.
    pub is_without_files: bool,
    /// The limit that ended its program, as an outcome.
    pub limit: Option<Outcome>,
    /// Why there is no plan, where that was asked for.
    pub why: Option<Why>,
    /// The message about the outcome: the planner's own words, or what it lacks
    /// and where, or how to install it. Empty for a plan.
    pub message: String,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Run {
    /// Simulates the plan, if there is one. A plan that does not reach the goal is none, whatever its
    /// planner says; but where only its actions touch, it is the plan with these apart.
    pub fn simulate(&mut self, task: &Task<'_>) {
        let Outcome::Plan(plan) = &mut self.outcome else { return };
        let verdict = match validate(task.domain, task.problem, &plan.steps) {
            verdict @ Validation::Invalid(_) => match spaced(plan, task) {
                Some((spaced, verdict)) => {
                    *plan = spaced;
                    self.is_spaced = true;
                    verdict
                }
                None => verdict,
            },
            verdict => verdict,
        };
        match verdict {
            Validation::Valid { value } => plan.cost = value.or(plan.cost),
            Validation::Unchecked(reason) => self.unjudged = Some(reason),
            // The planner may have been writing when its time was over.
            Validation::Invalid(_) if self.limit.is_some() => {
                self.message = format!("no whole plan within its limit; what it left: {verdict}");
                self.outcome = self.limit.clone().unwrap_or(Outcome::OutOfTime);
            }
            Validation::Invalid(_) => {
                self.message = verdict.to_string();
                self.outcome = Outcome::Invalid;
            }
        }
    }

    /// Looks into why there is no plan, where the planner found that there is none or gave up. Where it gave up and a
    /// condition of the goal can never hold, that is the proof.
    pub fn explain(&mut self, task: &Task<'_>) {
        if !matches!(self.outcome, Outcome::Unsolvable | Outcome::GaveUp) || self.why.is_some() {
            return;
        }
        let why = why(task.domain, task.problem);
        if self.outcome == Outcome::GaveUp && why.is_proof() {
            self.outcome = Outcome::Unsolvable;
            self.message = "the planner gave up, but the goal can never hold".to_owned();
        }
        self.is_proven |= why.is_proof();
        self.why = Some(why);
    }

    /// The last lines of what the planner printed, for messages.
    #[must_use]
    pub fn tail(&self) -> String {
        let printed =
            |text: &str| text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect::<Vec<_>>();
        let mut lines = printed(&self.stdout);
        lines.extend(printed(&self.stderr));
        let start = lines.len().saturating_sub(TAIL);
        let tail = lines.split_off(start);
        tail.iter().map(|line| line.chars().take(200).collect::<String>()).collect::<Vec<_>>().join("\n")
    }
}

/// The plan with its actions apart, where that is valid: what planners print may leave out the gaps.
#[must_use]
pub fn spaced(plan: &Plan, task: &Task<'_>) -> Option<(Plan, Validation)> {
    let spaced = plan.spaced(&task.problem.timed().collect::<Vec<f64>>())?;
    let verdict = validate(task.domain, task.problem, &spaced.steps);
    matches!(verdict, Validation::Valid { .. }).then_some((spaced, verdict))
}

/// Runs a planner on a task. What it cannot do is refused before the run.
#[must_use]
pub fn run(planner: &dyn Planner, task: &Task<'_>, limits: &Limits, host: &Host<'_>) -> Run {
    PreparedPlanner::new(planner, limits, host).attempt(task, host, None, false).0
}

/// A planner whose program is there and waits for its task.
pub(super) struct PreparedPlanner<'a> {
    planner: &'a dyn Planner,
    command: Vec<OsString>,
    program: Prepared,
    limits: Limits,
}

impl<'a> PreparedPlanner<'a> {
    pub(super) fn new(planner: &'a dyn Planner, limits: &Limits, host: &Host<'_>) -> Self {
        let command = planner.command(host);
        Self { program: prepare(planner, &command, limits, host), planner, command, limits: *limits }
    }

    /// Runs it on a task. Of several runs that share their limit of memory, each has a `share`. With `is_for_best`,
    /// the best plan that a planner has when it is interrupted is its result. What the run leaves ends by itself, and is
    /// waited for where it is dropped.
    pub(super) fn attempt(
        mut self,
        task: &Task<'_>,
        host: &Host<'_>,
        share: Option<Share<'_>>,
        is_for_best: bool,
    ) -> (Run, Ended) {
        let (planner, limits) = (self.planner, self.limits);
        if let Some(refusal) = refuse(planner, task) {
            return report(planner, Outcome::Unsupported, refusal.to_string(), &[], Ended::default());
        }
        let (domain, problem) = (task.domain.tree(), task.problem.tree());
        let (domain, problem) = match planner.reads_only_simple_forms() {
            true => portable::simplified(domain, problem),
            false => (Cow::Borrowed(domain), Cow::Borrowed(problem)),
        };
        let (domain, problem) = (domain.as_ref(), problem.as_ref());
        let Some(mut sent) = portable::try_send(domain, problem, planner.requirements(), host.interrupted) else {
            return report(planner, Outcome::Interrupted, String::new(), &[], Ended::default());
        };
        let keeps = is_for_best && planner.is_anytime();
        let kept = |program: Prepared| if keeps { program.kept() } else { program };
        let (mut ended, mut answer) = ask(planner, kept(self.program), &sent, host, share, keeps);
        let ask_again = |command: &[OsString], sent: &Sent, before: &Ended| {
            let rest = Limits { time: limits.time.map(|time| time.saturating_sub(before.wall)), ..limits };
            let program = kept(prepare(planner, command, &rest, host));
            let (mut ended, answer) = ask(planner, program, sent, host, share, keeps);
            ended.wall += before.wall;
            ended.resident = ended.resident.max(before.resident);
            ended.cpu = ended.cpu.zip(before.cpu).map(|(one, other)| one + other);
            (ended, answer)
        };
        let mut is_without_costs = false;
        if refuses_numbers(&answer) && task.has_only_costs() {
            let known = planner.requirements();
            if let Some(costless) = portable::try_send_without_costs(domain, problem, known, host.interrupted) {
                (ended, answer) = ask_again(&self.command, &costless, &ended);
                (sent, is_without_costs) = (costless, true);
            }
        }
        if let Some(other) = planner.again(&answer, &self.command) {
            (ended, answer) = ask_again(&other, &sent, &ended);
            self.command = other;
        }
        if planner.is_own() {
            answer.message = spelled(&answer.message, task.domain.tree());
        }
        if let Some(located) = answer.complaint.as_ref().and_then(|complaint| located(complaint, &sent, task)) {
            answer.message = located;
        }
        let (outcome, mut message) = conclude(planner, &ended, answer, &sent, task, &limits);
        if outcome == Outcome::OutOfMemory && share.is_some() {
            message.push_str(", for all planners together");
        }
        let (run, ended) = report(planner, outcome, message, &self.command, ended);
        (Run { is_without_costs, ..run }, ended)
    }
}

/// What the planner cannot do of the task, at its place.
pub(super) fn refuse(planner: &dyn Planner, task: &Task<'_>) -> Option<Diagnostic> {
    let domain = task.domain.features().iter().map(|used| (used, task.domain.source()));
    let uses: Vec<_> = domain.chain(task.problem.features().iter().map(|used| (used, task.problem.source()))).collect();
    let lacking = |lack: &Feature| uses.iter().find(|(used, _)| used.feature == *lack);
    if let Some((used, source)) = planner.lacks().iter().find_map(lacking) {
        let message = format!("the planner `{}` cannot handle {}", planner.name(), used.feature);
        return Some(Diagnostic::new(source, used.span, message).hint("name another planner with --planner"));
    }
    let hint = "name another planner with --planner, or a larger build of this one in rmem.toml";
    Some(planner.sizes()?.exceeded(planner.name(), task)?.hint(hint))
}

/// A message whose actions and predicates, each behind a word that says what it is, are spelled as in the domain.
fn spelled(message: &str, domain: &ast::Domain) -> String {
    let actions = domain.actions.iter().map(|action| &action.name);
    let actions = actions.chain(domain.durative_actions.iter().map(|action| &action.name));
    let names: Vec<&str> =
        actions.chain(domain.predicates.iter().map(|predicate| &predicate.name)).map(|name| name.as_str()).collect();
    let mut is_name = false;
    let words = message.split(' ').map(|word| {
        let known = names.iter().find(|name| is_name && name.eq_ignore_ascii_case(word));
        is_name = matches!(word, "action" | "predicate");
        known.copied().unwrap_or(word)
    });
    words.collect::<Vec<_>>().join(" ")
}

/// What of a task keeps planners from looking for better plans, at its place.
#[must_use]
pub fn not_improved(planners: &[Box<dyn Planner>], task: &Task<'_>) -> Option<Diagnostic> {
    let domain = task.domain.features().iter().map(|used| (used, task.domain.source()));
    let mut uses = domain.chain(task.problem.features().iter().map(|used| (used, task.problem.source())));
    let kept = |feature: &Feature| planners.iter().find(|planner| planner.never_improves(task).contains(feature));
    let (used, source, planner) = uses.find_map(|(used, source)| Some((used, source, kept(&used.feature)?)))?;
    let message = format!("{} cannot improve a plan of a temporal task with {}", planner.name(), used.feature);
    Some(Diagnostic::new(source, used.span, message).hint("leave out --anytime").unsupported())
}

/// Whether a planner refuses its input where that has numbers.
fn refuses_numbers(answer: &Transcript) -> bool {
    let token = answer.complaint.as_ref().and_then(|complaint| complaint.token.as_deref()).unwrap_or_default();
    let numbers = [":functions", ":metric", ":action-costs", ":fluents", ":numeric-fluents"];
    numbers.iter().any(|number| number.eq_ignore_ascii_case(token))
}

impl Task<'_> {
    /// Whether the costs of actions are its only numbers.
    fn has_only_costs(&self) -> bool {
        let mut features = self.domain.features().iter().chain(self.problem.features()).map(|used| used.feature);
        let is_other = |feature: Feature| {
            matches!(
                feature,
                Feature::NumericFluents | Feature::DurativeActions | Feature::ObjectFluents | Feature::Preferences
            )
        };
        !self.domain.tree().functions.is_empty() && !features.any(is_other)
    }

    /// What in the task keeps the planner's word from being a proof.
    fn doubt(&self, planner: &dyn Planner) -> Option<Feature> {
        let mut features = self.domain.features().iter().chain(self.problem.features()).map(|used| used.feature);
        features.find(|feature| planner.doubts().contains(feature))
    }
}

/// Starts a planner's program, which then waits for its task.
fn prepare(planner: &dyn Planner, command: &[OsString], limits: &Limits, host: &Host<'_>) -> Prepared {
    let program = command.first().map_or(OsStr::new(""), OsString::as_os_str);
    let job = Job {
        program,
        arguments: command.get(1..).unwrap_or_default(),
        files: &[(DOMAIN, DOMAIN_FILE), (PROBLEM, PROBLEM_FILE), (PLAN, "plan")],
        is_fed: false,
        folder: None,
        environment: planner.environment(),
        mode: Mode::Captured,
        wanted: files::order,
    };
    Prepared::new(&job, limits, host)
}

/// Gives the program its task, and reads its answer.
fn ask(
    planner: &dyn Planner,
    program: Prepared,
    sent: &Sent,
    host: &Host<'_>,
    share: Option<Share<'_>>,
    keeps: bool,
) -> (Ended, Transcript) {
    let mut ended = program.run(&[(DOMAIN_FILE, &sent.domain), (PROBLEM_FILE, &sent.problem)], share, host);
    let output = Output {
        code: ended.code(),
        stdout: std::mem::take(&mut ended.stdout),
        stderr: std::mem::take(&mut ended.stderr),
        plans: std::mem::take(&mut ended.files),
    };
    let reading = Instant::now();
    // What a program left that was cut short counts for nothing, and may be endless; but a planner that looks for
    // the best plan has whole plans before it is interrupted.
    let answer = match ended.end {
        End::Interrupted if !keeps => Transcript::unclear(),
        End::TooMuchOutput => Transcript::unclear(),
        _ => planner.read(&output),
    };
    ended.wall += reading.elapsed();
    (ended.stdout, ended.stderr) = (output.stdout, output.stderr);
    (ended, answer)
}

/// What a run amounts to, and the message about it.
fn conclude(
    planner: &dyn Planner,
    ended: &Ended,
    answer: Transcript,
    sent: &Sent,
    task: &Task<'_>,
    limits: &Limits,
) -> (Outcome, String) {
    // At a limit, the last of the plans that a planner has made better and better is its answer.
    let keeps = planner.is_anytime() && answer.verdict == Verdict::Plan;
    match &ended.end {
        End::Missing => return (Outcome::NotFound, planner.install()),
        End::NoInterpreter(path) => {
            return (Outcome::NotFound, format!("its program is there, but not the interpreter `{path}` of it"));
        }
        End::Interrupted if !keeps => return (Outcome::Interrupted, String::new()),
        End::TooMuchOutput => {
            return (Outcome::NoPlan, format!("its program printed more than {} MiB", limits.output >> 20));
        }
        End::OutOfTime if !keeps => {
            let time = limits.time.unwrap_or_default();
            let words = match answer.verdict {
                Verdict::Unclear if !answer.message.is_empty() => {
                    format!("no plan within {time:?} ({})", answer.message)
                }
                _ => format!("no plan within {time:?}"),
            };
            return (Outcome::OutOfTime, words);
        }
        End::Starved if !keeps => return (Outcome::OutOfMemory, starved(&answer, limits)),
        End::Failed(words) | End::SupervisorGone(words) if ended.out_of_memory => {
            return (Outcome::OutOfMemory, words.clone());
        }
        End::SupervisorGone(words) => return (Outcome::Failed, words.clone()),
        End::Failed(words) | End::NoFiles(words) => {
            return (Outcome::NotExecutable, format!("its program could not be run: {words}"));
        }
        _ => {}
    }
    let crash = crash(&ended.end);
    match answer.verdict {
        Verdict::Plan if crash.is_none() || (keeps && ended.out_of_memory) => {
            (Outcome::Plan(restored(answer, sent).timed_as(task.domain, task.problem)), String::new())
        }
        Verdict::Unsolvable if crash.is_none() && !planner.proves() => {
            (Outcome::GaveUp, format!("{} (its search proves nothing)", answer.message))
        }
        Verdict::Unsolvable if crash.is_none() => match task.doubt(planner) {
            None => (Outcome::Unsolvable, answer.message),
            Some(doubt) => (Outcome::GaveUp, format!("{} (no proof for a task with {doubt})", answer.message)),
        },
        Verdict::GaveUp if crash.is_none() => (Outcome::GaveUp, answer.message),
        Verdict::Unsupported => (Outcome::Unsupported, answer.message),
        Verdict::OutOfMemory => (Outcome::OutOfMemory, with_limit(&answer.message, limits)),
        Verdict::OutOfTime => (Outcome::OutOfTime, answer.message),
        _ if ended.out_of_memory => (Outcome::OutOfMemory, starved(&answer, limits)),
        Verdict::Unclear if ended.end == End::Exited(127) => absent(&ended.stderr),
        Verdict::Rejected => (Outcome::NoPlan, format!("it refused its input: {}", answer.message)),
        Verdict::NoCriterion => (Outcome::NoPlan, answer.message),
        _ => match (crash, &ended.end) {
            (Some(crash), _) => (Outcome::Failed, crash),
            (None, End::Exited(code)) if *code != 0 => (Outcome::Failed, exited(*code, &answer.message, &ended.stderr)),
            (None, _) if answer.message.is_empty() => (Outcome::NoPlan, "what it returned is not a plan".to_owned()),
            (None, _) => (Outcome::NoPlan, answer.message),
        },
    }
}

/// A planner's words about its memory without the system's number of the error, and the limit that was too low.
fn with_limit(words: &str, limits: &Limits) -> String {
    let words = words.split(" (os error").next().unwrap_or_default();
    match limits.memory {
        Some(bytes) if bytes < i64::MAX as u64 => format!("{words}; {}", memory(limits)),
        _ => words.to_owned(),
    }
}

/// The limit of memory that was too low, and how far the planner was.
fn starved(answer: &Transcript, limits: &Limits) -> String {
    match answer.verdict {
        Verdict::Unclear if !answer.message.is_empty() => format!("{} ({})", memory(limits), answer.message),
        _ => memory(limits),
    }
}

fn memory(limits: &Limits) -> String {
    let bytes = limits.memory.unwrap_or_default();
    match bytes {
        0..1024 => format!("its limit was {bytes} bytes"),
        1024..0x10_0000 => format!("its limit was {} KiB", bytes >> 10),
        _ => format!("its limit was {} MiB", bytes >> 20),
    }
}

/// The outcome of a program that is there and exits with 127. That is what shells do when
/// they cannot find what they are to run, which they say.
fn absent(stderr: &str) -> (Outcome, String) {
    let words = last_line(stderr);
    let lower = words.to_lowercase();
    match ["not found", "no such file"].iter().any(|complaint| lower.contains(complaint)) {
        true => (Outcome::NotFound, format!("its program calls another: {words}")),
        false if words.is_empty() => (Outcome::Failed, "it exited with 127".to_owned()),
        false => (Outcome::Failed, format!("it exited with 127: {words}")),
    }
}

/// The message about a program that ended with an exit code other than 0 and without a plan: the reader's, or the last
/// line that it wrote to stderr.
fn exited(code: i32, message: &str, stderr: &str) -> String {
    let words = if message.is_empty() { last_line(stderr) } else { message };
    let words: String = words.chars().take(200).collect();
    if words.is_empty() { format!("it exited with {code}") } else { format!("it exited with {code}: {words}") }
}

/// The last line with words.
fn last_line(text: &str) -> &str {
    text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default().trim()
}

/// A crash: a signal, also as a shell reports one.
fn crash(end: &End) -> Option<String> {
    match end {
        End::Signalled(signal) => Some(format!("its program was ended by signal {signal}")),
        End::Exited(code @ 129..=165) => Some(format!("its program was ended by signal {}", code - 128)),
        _ => None,
    }
}

fn restored(answer: Transcript, sent: &Sent) -> Plan {
    let mut steps: Vec<_> = answer.actions.iter().map(|action| Step::from(sent.restore(action))).collect();
    steps.sort_by(|a, b| a.start.unwrap_or_default().total_cmp(&b.start.unwrap_or_default()));
    Plan { steps, cost: answer.cost }
}

fn report(
    planner: &dyn Planner,
    outcome: Outcome,
    message: String,
    command: &[OsString],
    mut ended: Ended,
) -> (Run, Ended) {
    let shown = |(index, word): (usize, &OsString)| match index {
        // The program by its name: a stored plan does not record where it is installed.
        0 => Path::new(word).file_name().unwrap_or(word).to_string_lossy().into_owned(),
        _ => word.to_string_lossy().into_owned(),
    };
    let run = Run {
        is_proven: outcome == Outcome::Unsolvable && planner.is_own(),
        code: ended.code(),
        is_without_files: matches!(ended.end, End::NoFiles(_)),
        limit: match ended.end {
            End::OutOfTime => Some(Outcome::OutOfTime),
            End::Starved => Some(Outcome::OutOfMemory),
            _ => None,
        },
        outcome,
        planner: planner.name().to_owned(),
        version: planner.version(),
        command: command.iter().enumerate().map(shown).collect(),
        time: ended.wall,
        cpu: ended.cpu,
        memory: ended.resident,
        unjudged: None,
        is_spaced: false,
        is_without_costs: false,
        why: None,
        message,
        stdout: std::mem::take(&mut ended.stdout),
        stderr: std::mem::take(&mut ended.stderr),
    };
    (run, ended)
}
