//! Plans as drawings: a box a step, from top to bottom, or bars over a line of time.

use std::fmt::Write as _;

use super::print::time;
use super::{PrintedPlan, Status};

/// Of a line of text, in pixels.
const LINE: f64 = 24.0;
/// From the top of a line of text to the foot of its letters.
const BASE: f64 = 17.0;
/// Between what is drawn and the edge.
const MARGIN: f64 = 12.0;
/// Of a character, at most; texts are monospaced.
const CHARACTER: f64 = 8.0;
/// The room for the time of temporal plans.
const SPAN: f64 = 640.0;
/// The least that is seen of a bar.
const THIN: f64 = 2.0;

pub(super) fn draw(page: &PrintedPlan<'_>) -> String {
    let body = if page.plan.is_temporal() { bars(page) } else { boxes(page) };
    let (width, height) = (body.width + 2.0 * MARGIN, body.height + 2.0 * MARGIN);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"monospace\" font-size=\"13\">\n\
         <title>{}</title>\n{}</svg>\n",
        escaped(page.id),
        body.text
    )
}

/// What is drawn, and how large it is.
struct Drawing {
    text: String,
    width: f64,
    height: f64,
}

/// A box a step, an arrow from each to the next.
fn boxes(page: &PrintedPlan<'_>) -> Drawing {
    let labels = labels(page);
    let width = widest(&labels) + 2.0 * MARGIN;
    let (middle, step) = (MARGIN + width / 2.0, LINE * 1.75);
    let mut text = String::new();
    for (index, label) in labels.iter().enumerate() {
        let top = MARGIN + step * index as f64;
        if index > 0 {
            let (from, to) = (top - (step - LINE), top);
            let _ = writeln!(text, "<path d=\"M{middle} {from}V{to}m-4 -5l4 5l4 -5\" fill=\"none\" stroke=\"#444\"/>");
        }
        rectangle(&mut text, [MARGIN, top, width, LINE], page.status(index), label);
        let _ = writeln!(
            text,
            "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            top + BASE,
            escaped(label)
        );
    }
    let count = labels.len() as f64;
    Drawing { text, width, height: (step * count - (step - LINE)).max(LINE) }
}

/// A bar a step, as long as it takes, its name in front.
fn bars(page: &PrintedPlan<'_>) -> Drawing {
    let labels = labels(page);
    let names = widest(&labels) + MARGIN;
    let end = |step: &crate::pddl::Step| step.start.unwrap_or_default() + step.duration.unwrap_or_default();
    let last = page.plan.steps.iter().map(end).fold(0.0, f64::max);
    let scale = if last > 0.0 && last.is_finite() { SPAN / last } else { 0.0 };
    let left = MARGIN + names;
    let mut text = String::new();
    for (index, (step, label)) in page.plan.steps.iter().zip(&labels).enumerate() {
        let top = MARGIN + LINE * index as f64;
        let _ = writeln!(text, "<text x=\"{MARGIN}\" y=\"{}\">{}</text>", top + BASE, escaped(label));
        let start = left + step.start.unwrap_or_default() * scale;
        let length = (step.duration.unwrap_or_default() * scale).max(THIN);
        rectangle(&mut text, [start, top + 3.0, length, LINE - 6.0], page.status(index), label);
    }
    let bottom = MARGIN + LINE * labels.len() as f64;
    let right = left + SPAN;
    let _ = writeln!(text, "<path d=\"M{left} {bottom}H{right}\" stroke=\"#444\"/>");
    let below = bottom + BASE;
    let _ = writeln!(text, "<text x=\"{left}\" y=\"{below}\">0</text>");
    let _ = writeln!(text, "<text x=\"{right}\" y=\"{below}\" text-anchor=\"end\">{}</text>", time(last));
    Drawing { text, width: names + SPAN, height: LINE * (labels.len() as f64 + 1.0) }
}

fn labels(page: &PrintedPlan<'_>) -> Vec<String> {
    page.plan.steps.iter().enumerate().map(|(index, step)| format!("{}: {}", index + 1, page.readable(step))).collect()
}

fn widest(labels: &[String]) -> f64 {
    labels.iter().map(|label| label.chars().count()).max().unwrap_or(0) as f64 * CHARACTER
}

fn rectangle(text: &mut String, [x, y, width, height]: [f64; 4], status: Status, label: &str) {
    let fill = match status {
        Status::Open => "#fff",
        Status::Running => "#cde5ff",
        Status::Done => "#cdf5cd",
        Status::Failed => "#ffc9c9",
    };
    let _ = writeln!(
        text,
        "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"4\" fill=\"{fill}\" \
         stroke=\"#444\"><title>{} ({status})</title></rect>",
        escaped(label)
    );
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
