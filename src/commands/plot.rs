//! `rmem plot NS [QUERY|PIPELINE]`: a chart of documents.

use std::path::{Path, PathBuf};

use bson::Document;
use clap::{Args, ValueEnum};

use super::query::{argument, blame, owned};
use super::{Context, UsageError, WrongInput, missing};
use crate::error::Result;
use crate::exit::Exit;
use crate::formats::{Source, shell};
use crate::memory::Memory;
use crate::plan::Record;
use crate::store::{Find, Namespace};
use crate::views::series::{Fields, Taken};
use crate::views::{Kind, Picture};

/// Draw documents as lines, points, a map, bars or a timeline
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  rmem plot robmem.worldmodel --kind map -o map.svg\n  \
rmem plot robmem.battery --x time --y charge --by robot -o charge.png\n  \
rmem plot robmem.objects \"[{\\$group: {_id: '\\$type', count: {\\$sum: 1}}}]\" --x _id --y count \\\n    --kind bars -o types.svg\n  \
rmem plot robmem.jobs --kind timeline --from begun --to ended --label name --by robot -o jobs.svg\n  \
rmem plot robmem.plans --kind timeline --by status -o executed.svg\n\n\
FIELD is a dotted path; a number in it is an index, as in translation.0. Dates are an axis of time. A map\n\
draws positions to scale, by default the x and y of translation, with names and with headings (by default how\n\
rotation turns about z). A timeline of plans has their steps as they were executed. Bars without --y count documents. Documents without the fields are left out; their number\n\
is reported on stderr. A file that ends in .png is a PNG, any other is SVG.")]
pub struct PlotArgs {
    /// Collection, as DATABASE.COLLECTION
    #[arg(value_name = "NS")]
    pub namespace: Namespace,
    /// Which documents: a query or a pipeline (default: all documents)
    #[arg(value_name = "PIPELINE", default_value = "{}", hide_default_value = true)]
    pub pipeline: String,
    /// The field along x
    #[arg(long, value_name = "FIELD")]
    pub x: Option<String>,
    /// The field along y
    #[arg(long, value_name = "FIELD")]
    pub y: Option<String>,
    /// A series for each value of FIELD
    #[arg(long, value_name = "FIELD")]
    pub by: Option<String>,
    /// Kind of drawing
    #[arg(long, value_name = "KIND", value_enum, default_value_t = PlotKind::Line)]
    pub kind: PlotKind,
    /// Names of points and intervals (default: name)
    #[arg(long, value_name = "FIELD")]
    pub label: Option<String>,
    /// Headings on a map, in radians
    #[arg(long, value_name = "FIELD")]
    pub heading: Option<String>,
    /// Field with the start of intervals (default: from)
    #[arg(long, value_name = "FIELD")]
    pub from: Option<String>,
    /// Field with the end of intervals (default: to)
    #[arg(long, value_name = "FIELD")]
    pub to: Option<String>,
    /// Make the x axis logarithmic
    #[arg(long)]
    pub log_x: bool,
    /// Make the y axis logarithmic
    #[arg(long)]
    pub log_y: bool,
    /// The title (default: the collection)
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// What the x axis shows, with its unit (default: the field)
    #[arg(long, value_name = "TEXT")]
    pub x_label: Option<String>,
    /// What the y axis shows, with its unit (default: the field)
    #[arg(long, value_name = "TEXT")]
    pub y_label: Option<String>,
    /// Width and height in pixels (default: 800x500; of a timeline, as its rows need)
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(f64, f64)>,
    /// Write to FILE, .svg or .png; - is stdout
    #[arg(short, long, value_name = "FILE", value_parser = picture_or_stdout)]
    pub output: PathBuf,
}

/// How a chart is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlotKind {
    /// Points joined in order of x
    Line,
    /// Points
    Scatter,
    /// Positions to scale, with names and headings
    Map,
    /// A bar for each value of x
    Bars,
    /// Intervals over time
    Timeline,
}

/// A size like `800x500`.
pub(super) fn size(text: &str) -> Result<(f64, f64), String> {
    let wrong = || format!("`{text}` is not a size; expected WIDTHxHEIGHT in pixels, 100 to 10000 each, like 800x500");
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    let side = |text: &str| text.parse().ok().filter(|side: &f64| (100.0..=10_000.0).contains(side)).ok_or_else(wrong);
    Ok((side(width)?, side(height)?))
}

pub(super) fn run(args: &PlotArgs, context: &mut Context<'_>) -> Result<Exit> {
    let kind = kind(args.kind);
    let fields = fields(args, kind)?;
    let memory = context.memory()?;
    let taken = take(args, &fields, kind, &memory)?;
    let all = taken.used + taken.skipped + taken.undrawable;
    if taken.skipped > 0 {
        let fields = listed(&fields, kind, " or ");
        context.output.note(&format!("{} of {all} documents lack {fields} and are left out", taken.skipped));
    }
    if taken.undrawable > 0 {
        context.output.note(&undrawable(taken.undrawable, all, &listed(&fields, kind, " or ")));
    }
    let is_undrawable = taken.undrawable > 0;
    let title = args.title.clone().unwrap_or_else(|| args.namespace.to_string());
    let mut chart = taken.chart(&fields, kind, title, args.size);
    (chart.x.log, chart.y.log) = (args.log_x, args.log_y);
    chart.x.label = args.x_label.clone().unwrap_or(chart.x.label);
    chart.y.label = args.y_label.clone().unwrap_or(chart.y.label);
    let chart = chart.positive();
    if chart.series.is_empty() {
        // What is not there has no fields either.
        missing::refuse(&args.namespace, &memory, context)?;
        if is_undrawable {
            return Err(
                WrongInput::new(format!("no document of {} has numbers that can be drawn", args.namespace)).into()
            );
        }
        let options: Vec<String> = fields.needed(kind).iter().map(|(option, _)| format!("{option} FIELD")).collect();
        return Err(WrongInput::new(format!(
            "no document of {} has what is drawn, {}; {} draw other fields, which rmem schema {0} prints",
            args.namespace,
            listed(&fields, kind, " and "),
            options.join(" ")
        ))
        .into());
    }
    write(&args.output, &chart.draw()?, context)?;
    Ok(Exit::Done)
}

/// Says that numbers cannot be drawn.
fn undrawable(count: u64, all: u64, fields: &str) -> String {
    format!(
        "{count} of {all} documents have a number in {fields} that cannot be drawn (too large, or NaN) and are left out"
    )
}

/// The fields without which a document is not drawn, as messages have them.
fn listed(fields: &Fields, kind: Kind, between: &str) -> String {
    fields.needed(kind).iter().map(|(_, field)| format!("`{field}`")).collect::<Vec<_>>().join(between)
}

/// A file for a picture, whose name says its format.
pub(super) fn picture_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    match extension.as_ref().and_then(|extension| extension.to_str()) {
        Some("svg" | "png") => Ok(path),
        _ => Err("a picture is SVG or PNG; expected a name that ends in .svg or .png".to_owned()),
    }
}

/// The same, or `-` for stdout.
pub(super) fn picture_or_stdout(text: &str) -> Result<PathBuf, String> {
    if text == "-" { Ok(PathBuf::from(text)) } else { picture_file(text) }
}

/// Writes a picture in the format of the file's name.
pub(super) fn write(path: &Path, picture: &Picture, context: &mut Context<'_>) -> Result<()> {
    let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    if is_png {
        return context.output.write_file(path, &picture.png().map_err(WrongInput::new)?);
    }
    context.output.write_file(path, picture.svg().as_bytes())
}

fn kind(kind: PlotKind) -> Kind {
    match kind {
        PlotKind::Line => Kind::Line,
        PlotKind::Scatter => Kind::Scatter,
        PlotKind::Map => Kind::Map,
        PlotKind::Bars => Kind::Bars,
        PlotKind::Timeline => Kind::Timeline,
    }
}

fn fields(args: &PlotArgs, kind: Kind) -> Result<Fields, UsageError> {
    let has_both = args.x.is_some() && args.y.is_some();
    if matches!(kind, Kind::Line | Kind::Scatter) && !has_both {
        return Err(UsageError::new("expected --x FIELD and --y FIELD; see the fields with rmem schema NS"));
    }
    if kind == Kind::Bars && args.x.is_none() {
        return Err(UsageError::new("expected --x FIELD for the bars"));
    }
    Ok(Fields {
        x: args.x.clone(),
        y: args.y.clone(),
        by: args.by.clone(),
        label: args.label.clone(),
        heading: args.heading.clone(),
        from: args.from.clone(),
        to: args.to.clone(),
    })
}

/// Whether a timeline has the steps of plans, as they were executed: where no other fields are named.
fn draws_plans(args: &PlotArgs) -> bool {
    args.kind == PlotKind::Timeline && [&args.from, &args.to, &args.label].into_iter().all(Option::is_none)
}

fn take(args: &PlotArgs, fields: &Fields, kind: Kind, memory: &Memory) -> Result<Taken> {
    let given = [("<pipeline>", args.pipeline.as_str())];
    let documents = if args.pipeline.trim_start().starts_with('[') {
        let stages: Vec<Document> = shell::parse_pipeline(&Source::new("<pipeline>", args.pipeline.as_str()))?;
        memory.aggregate_reading(&args.namespace, &stages)
    } else {
        let filter = argument("<pipeline>", &args.pipeline)?;
        memory.find(&args.namespace, &Find { filter, ..Find::default() })
    };
    let mut taken = Taken::default();
    for document in documents.map_err(|error| blame(error, &given))? {
        let document = document.and_then(owned).map_err(|error| blame(error, &given))?;
        let steps = if draws_plans(args) { Record { document: document.clone() }.intervals() } else { Vec::new() };
        match steps.as_slice() {
            [] => taken.take(&document, fields, kind),
            steps => steps.iter().for_each(|step| taken.take(step, fields, kind)),
        }
    }
    Ok(taken)
}
