//! Any program, by configuration.

use std::ffi::OsString;
use std::path::PathBuf;

use super::ff::DOUBTS;
use super::interface::{Output, Planner};
use crate::formats::plan::{Transcript, Verdict, auto, downward, ff, temporal};
use crate::pddl::Feature;
use crate::process::Host;

/// How a planner's output is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// As that of whichever planner it looks like.
    Auto,
    /// As FF's: from the text of both streams.
    Ff,
    /// As Fast Downward's: from a plan file and the exit code.
    Downward,
    /// As a temporal planner's: from a plan file or the text of both streams.
    Temporal,
}

/// A planner from `[planner.NAME]`.
#[derive(Debug, Clone)]
pub struct Configured {
    /// Its name.
    pub name: String,
    /// Program and arguments; `{domain}`, `{problem}` and `{plan}` stand for files.
    pub command: Vec<String>,
    /// How its output is read.
    pub output: Dialect,
    /// What it cannot handle.
    pub lacks: Vec<Feature>,
    /// The folder of the configuration. The planner runs in a temporary directory, so
    /// words of the command that are paths of files relative to this folder are made
    /// absolute.
    pub folder: PathBuf,
}

impl Configured {
    fn word(&self, word: &str) -> OsString {
        let path = self.folder.join(word);
        match (word.contains('/') || word.contains('.')) && path.is_file() {
            true => path.into_os_string(),
            false => word.into(),
        }
    }
}

impl Planner for Configured {
    fn name(&self) -> &str {
        &self.name
    }

    fn lacks(&self) -> &[Feature] {
        &self.lacks
    }

    fn command(&self, _host: &Host<'_>) -> Vec<OsString> {
        self.command.iter().map(|word| self.word(word)).collect()
    }

    fn read(&self, output: &Output) -> Transcript {
        let transcript = match self.output {
            Dialect::Auto => auto::read(&output.plans, output.code, &output.stdout, &output.stderr),
            Dialect::Downward => downward::read(&output.plans, output.code, &output.stdout, &output.stderr),
            Dialect::Temporal => temporal::read(&output.plans, &output.stdout, &output.stderr),
            Dialect::Ff => {
                let printed = ff::read(&output.stdout, &output.stderr);
                let mut filed = output.plans.iter().rev().map(|plan| ff::read(plan.text(), ""));
                let filed = filed.find(|filed| printed.verdict == Verdict::Unclear && filed.verdict == Verdict::Plan);
                filed.unwrap_or(printed)
            }
        };
        // A plan file that was there when a limit ended the program may lack its last line; simulation shows whether it is whole.
        match transcript.verdict {
            Verdict::Unclear if output.code.is_none() => auto::filed(&output.plans).unwrap_or(transcript),
            _ => transcript,
        }
    }

    fn doubts(&self) -> &[Feature] {
        match self.output {
            Dialect::Ff | Dialect::Auto => &DOUBTS,
            _ => &[],
        }
    }

    /// Temporal planners look at some moments of many, and at some orders of actions.
    fn proves(&self) -> bool {
        self.output != Dialect::Temporal
    }

    fn is_anytime(&self) -> bool {
        self.output != Dialect::Ff
    }

    fn install(&self) -> String {
        let program = self.command.first().map_or("", String::as_str);
        format!("there is no program `{program}`, the command of the planner `{}` in rmem.toml", self.name)
    }
}
