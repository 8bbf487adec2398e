//! The formats of results.

use std::str::FromStr;

use clap::ValueEnum;

use crate::input::UsageError;

/// How results are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, ValueEnum)]
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
    /// A graph for Graphviz.
    Dot,
    /// A drawing.
    Svg,
    /// A drawing of what was planned above what was done.
    Timeline,
    /// A scene in MoveIt's `.scene` format.
    #[value(name = "moveit")]
    MoveIt,
    /// A scene as MoveIt's message `PlanningScene`.
    #[value(name = "moveit-msg")]
    MoveItMessage,
    /// A scene for MuJoCo.
    Mjcf,
    /// A scene for Gazebo and Drake.
    Sdf,
    /// A scene as a robot description of ROS.
    Urdf,
    /// A scene for OpenRAVE.
    #[value(name = "openrave")]
    OpenRave,
}

impl Format {
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
            Self::Ff => "ff",
            Self::Document => "document",
            Self::Dot => "dot",
            Self::Svg => "svg",
            Self::Timeline => "timeline",
            Self::MoveIt => "moveit",
            Self::MoveItMessage => "moveit-msg",
            Self::Mjcf => "mjcf",
            Self::Sdf => "sdf",
            Self::Urdf => "urdf",
            Self::OpenRave => "openrave",
        }
    }
}

impl FromStr for Format {
    type Err = UsageError;

    fn from_str(name: &str) -> Result<Self, UsageError> {
        let formats = Self::value_variants();
        formats.iter().copied().find(|format| format.name() == name).ok_or_else(|| {
            let known: Vec<_> = formats.iter().map(|format| format.name()).collect();
            UsageError::new(format!("unknown format `{name}`; expected one of {}", known.join(", ")))
        })
    }
}
