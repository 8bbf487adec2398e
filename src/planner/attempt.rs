//! The way from a task to an outcome, the same for every planner.

use std::borrow::Cow;
use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::time::Instant;

use super::capabilities::refuse;
use super::complaint::located;
use super::conclusion::conclude;
use super::files::{self, DOMAIN, DOMAIN_FILE, PLAN, PROBLEM, PROBLEM_FILE};
use super::interface::{Output, Planner};
use super::outcome::Outcome;
use super::run::Run;
use super::spelling::spelled;
use super::task::Task;
use crate::formats::Source;
use crate::formats::credentials::masked_message;
use crate::formats::pddl::portable::{self, Sent};
use crate::formats::plan::Transcript;
use crate::process::{End, Ended, Host, Job, Limits, Mode, Prepared, Share};

/// How many bytes a problem has at least that the built-in planner reads while it is checked: less is read in a millisecond.
const EARLY_SIZE: usize = 1 << 16;

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
    /// The domain and the problem with which it runs already.
    begun: Option<(Source, Source)>,
}

impl<'a> PreparedPlanner<'a> {
    pub(super) fn new(planner: &'a dyn Planner, limits: &Limits, host: &Host<'_>) -> Self {
        let command = planner.command(host);
        let program = prepare(planner, &command, limits, host);
        Self { program, planner, command, limits: *limits, begun: None }
    }

    /// Lets rmem's own planner begin with a large problem before that is checked. Where the task turns out to be wrong, or has
    /// to be written in another way, the planner is killed.
    pub(super) fn begin(&mut self, domain: &Source, problem: &Source, host: &Host<'_>) {
        if self.planner.is_own() && problem.text().len() >= EARLY_SIZE {
            self.program.begin(&[(DOMAIN_FILE, domain.text()), (PROBLEM_FILE, problem.text())], host);
            self.begun = Some((domain.clone(), problem.clone()));
        }
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
        let begun = self.begun.take().is_some_and(|(domain, problem)| sent.reads_as(domain.text(), problem.text()));
        if self.program.has_begun() && !begun {
            self.program = prepare(planner, &self.command, &limits, host);
        }
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
        if begun && answer.complaint.is_some() {
            // Its places are those of another text.
            (ended, answer) = ask_again(&self.command, &sent, &ended);
        }
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

/// Whether a planner refuses its input where that has numbers.
fn refuses_numbers(answer: &Transcript) -> bool {
    let token = answer.complaint.as_ref().and_then(|complaint| complaint.token.as_deref()).unwrap_or_default();
    let numbers = [":functions", ":metric", ":action-costs", ":fluents", ":numeric-fluents"];
    numbers.iter().any(|number| number.eq_ignore_ascii_case(token))
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
        _ => masked_message(&word.to_string_lossy()).into_owned(),
    };
    let run = Run {
        is_proven: outcome == Outcome::Unsolvable && planner.is_own(),
        code: ended.code(),
        is_without_files: matches!(ended.end, End::NoFiles(_))
            || outcome == Outcome::NotExecutable && ended.is_disk_full,
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
