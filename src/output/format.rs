//! The formats of results.

use std::str::FromStr;

use crate::formats::scene::{SPELLINGS, message};
use crate::input::UsageError;

/// How results are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// One document a line, relaxed Extended JSON.
    Jsonl,
    /// One JSON array, indented.
    Json,
    /// One document a line, canonical Extended JSON: every type spelled out.
    Canonical,
    /// Columns for people.
    Table,
    /// Comma-separated values.
    Csv,
    /// Tab-separated values.
    Tsv,
    /// Lines for people; a plan as in the planning competitions.
    Text,
    /// CLIPS facts.
    Clips,
    /// What FF prints.
    Ff,
    /// A stored document as it is, one line of JSON.
    Document,
    /// Lines of words, quoted for a shell.
    Shell,
    /// A graph for Graphviz.
    Dot,
    /// A drawing.
    Svg,
    /// A drawing of what was planned above what was done.
    Timeline,
    /// A scene, in the format of that name ([`SPELLINGS`]).
    Scene(&'static str),
}

/// All but those of scenes.
const OWN: &[Format] = &[
    Format::Jsonl,
    Format::Json,
    Format::Canonical,
    Format::Table,
    Format::Csv,
    Format::Tsv,
    Format::Text,
    Format::Clips,
    Format::Ff,
    Format::Document,
    Format::Shell,
    Format::Dot,
    Format::Svg,
    Format::Timeline,
];

impl Format {
    /// A scene as MoveIt's message `PlanningScene`.
    pub const MOVEIT_MESSAGE: Self = Self::Scene(message::SPELLING.name);

    /// Returns all formats. One of scenes that has the name of another format is that one.
    pub fn all() -> impl Iterator<Item = Self> {
        let scenes = SPELLINGS.iter().map(|spelling| spelling.name);
        let scenes = scenes.filter(|name| OWN.iter().all(|own| own.name() != *name));
        OWN.iter().copied().chain(scenes.map(Self::Scene))
    }

    /// Returns the word on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Jsonl => "jsonl",
            Self::Json => "json",
            Self::Canonical => "canonical",
            Self::Table => "table",
            Self::Csv => "csv",
            Self::Tsv => "tsv",
            Self::Text => "text",
            Self::Clips => "clips",
            Self::Shell => "shell",
            Self::Ff => "ff",
            Self::Document => "document",
            Self::Dot => "dot",
            Self::Svg => "svg",
            Self::Timeline => "timeline",
            Self::Scene(name) => name,
        }
    }
}

impl FromStr for Format {
    type Err = UsageError;

    fn from_str(name: &str) -> Result<Self, UsageError> {
        Self::all().find(|format| format.name() == name).ok_or_else(|| {
            let known: Vec<_> = Self::all().map(Self::name).collect();
            UsageError::new(format!("unknown format `{name}`; expected one of {}", known.join(", ")))
        })
    }
}
