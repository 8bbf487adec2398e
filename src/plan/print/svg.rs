//! Plans as drawings: lanes of actions over time.
//!
//! A lane for each robot (or whatever one parameter of the actions names), boxes from left to right: by their
//! times, or as early as what they need is there. Arrows are causal links between lanes, from the step that
//! makes a condition true to the one that needs it.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use bson::{Bson, Document};

use super::page::PrintedPlan;
use crate::plan::{Status, rounded};
use crate::problem::names;

/// The height of a lane, in pixels.
const LANE: f64 = 64.0;
/// The height of a box.
const BOX: f64 = 44.0;
/// Between columns, where arrows are.
const GAP: f64 = 26.0;
/// Between what is drawn and the edge.
const MARGIN: f64 = 16.0;
/// Space above the lanes, for the title.
const HEAD: f64 = 44.0;
/// Of a character of the largest text, about.
const CHARACTER: f64 = 7.6;
/// The width for the time of temporal plans.
const SPAN: f64 = 900.0;
/// As wide a plan without times may be before it goes on below.
const WIDEST: f64 = 1300.0;
/// Between the lanes and where they go on below.
const BREAK: f64 = 28.0;
/// The least that is seen of a bar.
const THIN: f64 = 3.0;
/// The most characters of a lane's name.
const NAME: usize = 24;
/// The most characters of a line in a box without times.
const LONGEST: usize = 36;
/// Of a character of the title, about.
const WIDE: f64 = 9.6;

/// Where a step is drawn.
struct Placed {
    /// Long plans go on below.
    row: usize,
    lane: usize,
    /// What is done at once in a lane is drawn in tracks, one below the other.
    track: usize,
    left: f64,
    width: f64,
}

/// What is drawn, and where.
struct Drawing<'a> {
    page: &'a PrintedPlan<'a>,
    lanes: Vec<String>,
    /// How many tracks each lane has.
    tracks: Vec<usize>,
    placed: Vec<Placed>,
    left: f64,
    width: f64,
    /// How often the lanes are drawn, one below the other.
    rows: usize,
    /// The end of the last step, of a plan with times.
    end: Option<f64>,
}

pub(super) fn draw(page: &PrintedPlan<'_>) -> String {
    let drawing = Drawing::of(page);
    let height = drawing.bottom(drawing.rows - 1) + 78.0;
    let width = drawing.left + drawing.width + MARGIN;
    let width = width.max(drawing.words().chars().count() as f64 * WIDE + 2.0 * MARGIN).max(drawing.legend_width());
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
         viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"DejaVu Sans, Arial, sans-serif\" font-size=\"12\">\n\
         <title>{}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <defs><marker id=\"arrow\" viewBox=\"0 0 8 8\" refX=\"7\" refY=\"4\" markerWidth=\"7\" markerHeight=\"7\" orient=\"auto\">\
         <path d=\"M0 0L8 4L0 8z\" fill=\"#555\"/></marker></defs>\n",
        escaped(page.id)
    );
    drawing.title(&mut text);
    drawing.lanes(&mut text);
    drawing.axis(&mut text);
    drawing.links(&mut text);
    drawing.boxes(&mut text);
    drawing.legend(&mut text, height);
    text.push_str("</svg>\n");
    text
}

impl<'a> Drawing<'a> {
    fn of(page: &'a PrintedPlan<'a>) -> Self {
        let parameter = page.lanes.map(str::to_owned).or_else(|| shared_parameter(page));
        let names: Vec<String> =
            (0..page.plan.steps.len()).map(|index| lane_name(page, index, parameter.as_deref())).collect();
        let mut lanes: Vec<String> = Vec::new();
        for name in &names {
            if !lanes.contains(name) {
                lanes.push(name.clone());
            }
        }
        lanes.sort();
        if lanes.is_empty() {
            lanes.push(String::new());
        }
        let lane = |name: &String| lanes.iter().position(|lane| lane == name).unwrap_or_default();
        let rows: Vec<usize> = names.iter().map(lane).collect();
        let widest = lanes.iter().map(|lane| lane.chars().count().min(NAME)).max().unwrap_or_default();
        let left = MARGIN + widest as f64 * CHARACTER + 12.0;
        let end = page.plan.is_temporal().then(|| {
            let ends =
                page.plan.steps.iter().map(|step| step.start.unwrap_or_default() + step.duration.unwrap_or_default());
            ends.fold(0.0, f64::max)
        });
        let (placed, width) = match end {
            Some(end) => by_time(page, &rows, left, end),
            None => by_need(page, &rows, left),
        };
        let rows = placed.iter().map(|placed| placed.row + 1).max().unwrap_or(1);
        let mut tracks = vec![1; lanes.len()];
        placed.iter().for_each(|placed| tracks[placed.lane] = tracks[placed.lane].max(placed.track + 1));
        Self { page, lanes, tracks, placed, left, width, rows, end }
    }

    /// The upper edge of a lane.
    fn top(&self, row: usize, lane: usize) -> f64 {
        let tracks = |count: usize| self.tracks.iter().take(count).sum::<usize>() as f64;
        HEAD + (LANE * tracks(self.lanes.len()) + BREAK) * row as f64 + LANE * tracks(lane)
    }

    /// The lower edge of the last lane.
    fn bottom(&self, row: usize) -> f64 {
        self.top(row, self.lanes.len())
    }

    /// The height at which a step is drawn.
    fn middle(&self, placed: &Placed) -> f64 {
        self.top(placed.row, placed.lane) + LANE * placed.track as f64 + LANE / 2.0
    }

    /// What the title says.
    fn words(&self) -> String {
        let count = self.page.plan.steps.len();
        let mut words = format!("plan {} — {count} step{}", self.page.id, if count == 1 { "" } else { "s" });
        // Without a metric, the cost is the number of steps, which says nothing about a plan with times.
        let is_said = |cost: &f64| self.end.is_none_or(|end| *cost != count as f64 && *cost != end);
        if let Some(cost) = self.page.plan.cost.filter(is_said) {
            let _ = write!(words, ", cost {}", rounded(cost));
        }
        if let Some(end) = self.end {
            let _ = write!(words, ", makespan {} s", rounded(end));
        }
        words
    }

    fn title(&self, text: &mut String) {
        let words = self.words();
        let _ = writeln!(
            text,
            "<text x=\"{MARGIN}\" y=\"24\" font-size=\"15\" font-weight=\"bold\">{}</text>",
            escaped(&words)
        );
    }

    fn lanes(&self, text: &mut String) {
        let all =
            (0..self.rows).flat_map(|row| self.lanes.iter().enumerate().map(move |(lane, name)| (row, lane, name)));
        for (row, lane, name) in all {
            let top = self.top(row, lane);
            let fill = if lane % 2 == 0 { "#f5f6f8" } else { "#ffffff" };
            let (width, height) = (self.left + self.width - MARGIN, LANE * self.tracks[lane] as f64);
            let _ = writeln!(
                text,
                "<rect x=\"{MARGIN}\" y=\"{top}\" width=\"{width:.1}\" height=\"{height}\" fill=\"{fill}\"/>"
            );
            let _ = writeln!(
                text,
                "<text x=\"{}\" y=\"{}\" font-weight=\"bold\">{}<title>{}</title></text>",
                MARGIN + 4.0,
                top + height / 2.0 + 4.0,
                escaped(&clipped(name, NAME as f64 * CHARACTER)),
                escaped(name)
            );
        }
    }

    /// Ticks at round times.
    fn axis(&self, text: &mut String) {
        let bottom = self.bottom(0);
        let (left, right) = (self.left, self.left + self.width);
        let Some(end) = self.end.filter(|end| *end > 0.0 && end.is_finite()) else { return };
        let _ = writeln!(text, "<path d=\"M{left:.1} {bottom}H{right:.1}\" stroke=\"#555\"/>");
        let step = round_step(end / 8.0);
        let mut nth = 0.0;
        while nth * step <= end * (1.0 + 1e-9) {
            let (at, x) = (nth * step, left + nth * step / end * self.width);
            let _ = writeln!(
                text,
                "<path d=\"M{x:.1} {HEAD}V{}\" stroke=\"#ccc\" stroke-dasharray=\"2 3\"/>",
                bottom + 5.0
            );
            let _ = writeln!(
                text,
                "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#333\">{}</text>",
                bottom + 19.0,
                short(at)
            );
            nth += 1.0;
        }
        let middle = f64::midpoint(left, right);
        let _ = writeln!(
            text,
            "<text x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#333\">time (s)</text>",
            bottom + 36.0
        );
    }

    /// Arrows between lanes; one for each pair of steps, which names all facts.
    fn links(&self, text: &mut String) {
        let Some(structure) = self.page.structure else { return };
        let mut pairs: BTreeMap<(usize, usize), Vec<&str>> = BTreeMap::new();
        for link in &structure.links {
            let (Some(from), Some(to)) = (self.placed.get(link.from), self.placed.get(link.to)) else { continue };
            if from.lane == to.lane {
                continue;
            }
            pairs.entry((link.from, link.to)).or_default().push(&link.fact);
        }
        let mut marked: Vec<usize> = Vec::new();
        for ((from, to), facts) in pairs {
            let beside = marked.iter().filter(|other| **other == to).count() as f64 * 30.0;
            let (step, target) = (from + 1, to);
            let (from, to) = (&self.placed[from], &self.placed[to]);
            if from.row != to.row {
                marked.push(target);
                let (x, y) = (to.left + 2.0 + beside, self.middle(to) - LANE / 2.0 + 8.0);
                let facts = escaped(&names::readable(&facts.join(" ")));
                let _ = writeln!(
                    text,
                    "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"9\" fill=\"#555\">← {step}<title>{facts}</title></text>"
                );
                continue;
            }
            let (x1, y1) = (from.left + from.width, self.middle(from));
            let (x2, y2) = (to.left - 1.0, self.middle(to));
            let bend = ((x2 - x1) / 2.0).clamp(12.0, 60.0);
            let _ = writeln!(
                text,
                "<path d=\"M{x1:.1} {y1:.1}C{:.1} {y1:.1} {:.1} {y2:.1} {x2:.1} {y2:.1}\" fill=\"none\" stroke=\"#555\" \
                 stroke-opacity=\"0.75\" marker-end=\"url(#arrow)\"><title>{}</title></path>",
                x1 + bend,
                x2 - bend,
                escaped(&names::readable(&facts.join(" ")))
            );
        }
    }

    fn boxes(&self, text: &mut String) {
        for (index, (step, placed)) in self.page.plan.steps.iter().zip(&self.placed).enumerate() {
            let (status, top) = (self.page.status(index), self.middle(placed) - BOX / 2.0);
            let (fill, stroke) = colors(status);
            let (left, width) = (placed.left, placed.width);
            let whole = escaped(&self.page.readable(step));
            let _ = writeln!(
                text,
                "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{BOX}\" rx=\"5\" fill=\"{fill}\" \
                 stroke=\"{stroke}\"><title>{}: {whole} ({status})</title></rect>",
                index + 1
            );
            let fits = |words: &str| clipped(words, width - 10.0);
            let lines = [format!("{} {}", index + 1, step.action), self.arguments(index)];
            for (line, words) in lines.iter().enumerate() {
                let y = top + 18.0 + 16.0 * line as f64;
                let weight = if line == 0 { " font-weight=\"bold\"" } else { " font-size=\"11\"" };
                let words = escaped(&fits(words));
                if !words.is_empty() {
                    let _ = writeln!(text, "<text x=\"{:.1}\" y=\"{y:.1}\"{weight}>{words}</text>", left + 6.0);
                }
            }
        }
    }

    /// The arguments of a step but for the one that names its lane.
    fn arguments(&self, index: usize) -> String {
        arguments(self.page, index, &self.lanes[self.placed[index].lane])
    }

    fn legend(&self, text: &mut String, height: f64) {
        let mut left = MARGIN;
        let y = height - 18.0;
        for status in STATUSES {
            let (fill, stroke) = colors(status);
            let word = status.to_string();
            let _ = writeln!(
                text,
                "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"14\" height=\"12\" rx=\"3\" fill=\"{fill}\" stroke=\"{stroke}\"/>\n\
                 <text x=\"{:.1}\" y=\"{y:.1}\">{word}</text>",
                y - 10.0,
                left + 20.0
            );
            left += legend_entry(&word);
        }
        if self.page.structure.is_some() {
            let _ = writeln!(
                text,
                "<path d=\"M{left:.1} {0:.1}h26\" stroke=\"#555\" marker-end=\"url(#arrow)\"/>\n\
                 <text x=\"{1:.1}\" y=\"{y:.1}\">{LINK}</text>",
                y - 4.0,
                left + 34.0
            );
        }
    }

    /// How wide the drawing has to be for its legend.
    fn legend_width(&self) -> f64 {
        let statuses: f64 = STATUSES.iter().map(|status| legend_entry(&status.to_string())).sum();
        let link = if self.page.structure.is_some() { legend_entry(LINK) } else { 0.0 };
        2.0 * MARGIN + statuses + link
    }
}

/// What the legend shows, in its order.
const STATUSES: [Status; 4] = [Status::Open, Status::Running, Status::Done, Status::Failed];
/// What the legend says of arrows.
const LINK: &str = "makes true what is needed";

/// How wide a word of the legend is, with what is before it.
fn legend_entry(word: &str) -> f64 {
    36.0 + word.chars().count() as f64 * CHARACTER
}

/// Fill and stroke of a step; told apart by lightness, too.
fn colors(status: Status) -> (&'static str, &'static str) {
    match status {
        Status::Open => ("#ffffff", "#555555"),
        Status::Running => ("#bfe0f5", "#0072B2"),
        Status::Done => ("#c3e6d8", "#009E73"),
        Status::Failed => ("#f6cdb4", "#D55E00"),
    }
}

/// The document of a step, where it is one with names of parameters.
fn record<'a>(page: &PrintedPlan<'a>, index: usize) -> Option<&'a Document> {
    page.document.get_document((index + 1).to_string()).ok()
}

/// The parameters of steps, and how many steps have each, in the order of their first step.
fn counted<'a>(page: &PrintedPlan<'a>) -> Vec<(&'a str, usize)> {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    let records = (0..page.plan.steps.len()).filter_map(|index| record(page, index));
    for key in records.flat_map(Document::keys).filter(|key| *key != "action" && !key.starts_with('_')) {
        match counts.iter_mut().find(|(other, _)| other == key) {
            Some((_, count)) => *count += 1,
            None => counts.push((key, 1)),
        }
    }
    counts
}

/// What the lanes can be.
pub(super) fn lanes<'a>(page: &PrintedPlan<'a>) -> Vec<&'a str> {
    counted(page).into_iter().map(|(name, _)| name).chain(["action"]).collect()
}

/// The parameter that the most steps have; of several, the first.
fn shared_parameter(page: &PrintedPlan<'_>) -> Option<String> {
    let counts = counted(page);
    let most = counts.iter().map(|(_, count)| *count).max()?;
    counts.into_iter().find(|(_, count)| *count == most).map(|(key, _)| key.to_owned())
}

fn lane_name(page: &PrintedPlan<'_>, index: usize, parameter: Option<&str>) -> String {
    let value = parameter.and_then(|parameter| record(page, index)?.get(parameter));
    value.map_or_else(|| "—".to_owned(), shown)
}

fn shown(value: &Bson) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn arguments(page: &PrintedPlan<'_>, index: usize, lane: &str) -> String {
    let step = &page.plan.steps[index];
    let values: Vec<String> = step.arguments.iter().map(|name| shown(&(page.value)(name))).collect();
    let mut is_left_out = false;
    let rest = values.into_iter().filter(|value| {
        let leave = !is_left_out && value == lane;
        is_left_out |= leave;
        !leave
    });
    rest.collect::<Vec<_>>().join(" ")
}

/// Boxes as long as they take; the drawing is wide enough for the names of short ones to be seen somewhere.
fn by_time(page: &PrintedPlan<'_>, rows: &[usize], left: f64, end: f64) -> (Vec<Placed>, f64) {
    let scale = if end > 0.0 && end.is_finite() { SPAN / end } else { 0.0 };
    // Of each lane, where each of its tracks is free again.
    let mut free: Vec<Vec<f64>> = vec![Vec::new(); rows.iter().max().map_or(0, |last| last + 1)];
    let place = |(step, lane): (&crate::pddl::Step, &usize)| {
        let left = left + step.start.unwrap_or_default() * scale;
        let width = (step.duration.unwrap_or_default() * scale).max(THIN);
        let tracks = &mut free[*lane];
        let track = tracks.iter().position(|end| *end <= left + 0.5).unwrap_or(tracks.len());
        tracks.resize(tracks.len().max(track + 1), 0.0);
        tracks[track] = left + width;
        Placed { row: 0, lane: *lane, track, left, width }
    };
    (page.plan.steps.iter().zip(rows).map(place).collect(), SPAN)
}

/// Columns: each step behind those that have to be before it, and behind the one before it in its lane.
fn by_need(page: &PrintedPlan<'_>, rows: &[usize], left: f64) -> (Vec<Placed>, f64) {
    let mut columns: Vec<usize> = Vec::with_capacity(rows.len());
    for (index, lane) in rows.iter().enumerate() {
        let in_lane = (0..index).rev().find(|other| rows[*other] == *lane);
        let ordered: Vec<usize> = match page.structure {
            Some(structure) => structure.order.iter().filter(|(_, to)| *to == index).map(|(from, _)| *from).collect(),
            None => (0..index).collect(),
        };
        let column = ordered.into_iter().chain(in_lane).map(|before| columns[before] + 1).max();
        columns.push(column.unwrap_or_default());
    }
    let count = columns.iter().max().map_or(1, |last| last + 1);
    let mut widths = vec![60.0_f64; count];
    for (index, column) in columns.iter().enumerate() {
        let words = format!("{} {}", index + 1, page.plan.steps[index].action);
        let longest = words.chars().count().max(arguments(page, index, "").chars().count());
        widths[*column] = widths[*column].max(longest.min(LONGEST) as f64 * CHARACTER + 16.0);
    }
    let (mut starts, mut row, mut at, mut reach) = (Vec::with_capacity(count), 0, 0.0_f64, 0.0_f64);
    for width in &widths {
        if at > 0.0 && at + width > WIDEST {
            (row, at) = (row + 1, 0.0);
        }
        starts.push((row, left + at));
        reach = reach.max(at + width);
        at += width + GAP;
    }
    let place = |(lane, column): (&usize, &usize)| {
        let (row, left) = starts[*column];
        Placed { row, lane: *lane, track: 0, left, width: widths[*column] }
    };
    (rows.iter().zip(&columns).map(place).collect(), reach)
}

/// 1, 2 or 5 times a power of ten, at least as large.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|digit| digit * power).find(|step| *step >= least).unwrap_or(power)
}

/// A time of the axis, with as few digits as it needs.
fn short(time: f64) -> String {
    let text = format!("{time:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// As much of a text as fits.
fn clipped(text: &str, width: f64) -> String {
    let width = (width / CHARACTER).floor().max(0.0) as usize;
    if text.chars().count() <= width {
        return text.to_owned();
    }
    match width {
        0..=2 => String::new(),
        width => text.chars().take(width - 1).chain(['…']).collect(),
    }
}

/// A text as XML, in which most control characters cannot be.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() || ('\u{fffe}'..='\u{ffff}').contains(&c) => escaped.extend(c.escape_default()),
            c => escaped.push(c),
        }
    }
    escaped
}
