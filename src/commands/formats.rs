//! The formats of commands: `--format` with a list of its own in each help.

use clap::Arg;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::formats::scene::SPELLINGS;
use crate::output::Format;

/// The formats of documents.
pub(crate) const DOCUMENTS: [Format; 6] =
    [Format::Jsonl, Format::Json, Format::Canonical, Format::Table, Format::Csv, Format::Tsv];
/// The formats of values, such as ids.
pub(super) const VALUES: [Format; 3] = [Format::Jsonl, Format::Json, Format::Canonical];
/// The formats of the one document that is the result of a command.
pub(crate) const RESULT: [Format; 2] = [Format::Jsonl, Format::Json];
/// The formats of lines for people.
pub(crate) const TEXT: [Format; 2] = [Format::Text, Format::Json];
/// The formats of a generated problem: PDDL; or with what its sections matched.
pub(super) const PROBLEM: [Format; 2] = [Format::Text, Format::Json];
/// The formats of CLIPS facts.
pub(crate) const FACTS: [Format; 1] = [Format::Clips];
/// The formats of plans.
pub(crate) const PLAN: [Format; 8] =
    [Format::Text, Format::Json, Format::Document, Format::Clips, Format::Ff, Format::Shell, Format::Dot, Format::Svg];

/// The formats of stored plans, of which it is known what was done.
pub(crate) const STORED_PLAN: [Format; 9] = [
    Format::Text,
    Format::Json,
    Format::Document,
    Format::Clips,
    Format::Ff,
    Format::Shell,
    Format::Dot,
    Format::Svg,
    Format::Timeline,
];
/// The formats of scenes.
pub(crate) const SCENE: [Format; SPELLINGS.len()] = scenes();

/// The formats of operations on a scene.
pub(crate) const SCENE_OPERATIONS: [Format; 2] = [Format::Jsonl, Format::MOVEIT_MESSAGE];

/// The formats of the difference of two scenes.
pub(crate) const SCENE_DIFFERENCE: [Format; 3] = [Format::Jsonl, Format::Json, Format::MOVEIT_MESSAGE];

/// The formats of scenes, the first of which, JSON, is one of documents as well.
const fn scenes() -> [Format; SPELLINGS.len()] {
    let mut formats = [Format::Json; SPELLINGS.len()];
    let mut at = 1;
    while at < formats.len() {
        formats[at] = Format::Scene(SPELLINGS[at].name);
        at += 1;
    }
    formats
}

/// The id of the argument on the command line.
pub(crate) const ID: &str = "format";

/// Returns the `--format` of a command that prints these formats; the first is the default.
pub(crate) fn argument(formats: &[Format]) -> Arg {
    let names: Vec<&'static str> = formats.iter().map(|format| format.name()).collect();
    let default = match formats.contains(&Format::Table) {
        true => format!("table on a terminal, else {}", names[0]),
        false => names[0].to_owned(),
    };
    let help = format!("Output format: {} (default: {default}) [env: RMEM_FORMAT]", names.join(", "));
    let known = formats.to_vec();
    let parser = PossibleValuesParser::new(names).try_map(move |name| {
        let format = known.iter().find(|format| format.name() == name);
        format.copied().ok_or_else(|| format!("unknown format `{name}`"))
    });
    global().help(help).value_parser(parser)
}

/// Returns the hidden `--format` of a command that has none.
pub(crate) fn none() -> Arg {
    global().hide(true).value_parser(any())
}

/// Reads the name of any format.
pub(crate) fn any() -> impl TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::all().map(Format::name)).try_map(|name| name.parse::<Format>())
}

fn global() -> Arg {
    // Below `--load`, as in the help of rmem itself.
    Arg::new(ID)
        .display_order(4)
        .long(ID)
        .value_name("FORMAT")
        .global(true)
        .hide_possible_values(true)
        .help_heading("Global options")
}
