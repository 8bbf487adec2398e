//! Figures as a picture: a panel for each kind of work, durations over the number of documents.

use std::fmt::Write as _;

use super::figure::Figure;
use super::work::Work;

const WIDTH: f64 = 300.0;
const HEIGHT: f64 = 200.0;
/// The margin of a panel, for its labels.
const MARGIN: f64 = 50.0;
const COLUMNS: usize = 3;
const COLOURS: [&str; 3] = ["#1b6ca8", "#c1440e", "#5b8c3e"];

/// The figures as SVG, both axes logarithmic.
#[must_use]
pub fn plot(figures: &[Figure]) -> String {
    let rows = Work::ALL.len().div_ceil(COLUMNS);
    let (width, height) = (place(COLUMNS, WIDTH), place(rows, HEIGHT) + MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (nth, work) in Work::ALL.into_iter().enumerate() {
        let own: Vec<&Figure> = figures.iter().filter(|figure| figure.work == work).collect();
        panel(&mut svg, work, &own, place(nth % COLUMNS, WIDTH) + MARGIN, place(nth / COLUMNS, HEIGHT) + MARGIN);
    }
    let names = figures.first().map(|figure| figure.medians.as_slice()).unwrap_or_default();
    for (nth, (name, _)) in names.iter().enumerate() {
        let colour = COLOURS[nth % COLOURS.len()];
        text(&mut svg, MARGIN + place(nth, 60.0), height - 10.0, colour, name);
    }
    svg.push_str("</svg>\n");
    svg
}

/// Where the `nth` thing of a row begins.
fn place(nth: usize, size: f64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a handful")]
    let nth = nth as f64;
    nth * (size + MARGIN)
}

fn panel(svg: &mut String, work: Work, figures: &[&Figure], left: f64, top: f64) {
    let durations = figures.iter().flat_map(|figure| figure.medians.iter().map(|(_, median)| median.as_secs_f64()));
    #[expect(clippy::cast_precision_loss, reason = "a count for a picture")]
    let documents = |figure: &Figure| figure.documents as f64;
    let (slowest, fastest) = durations.fold((1e-6, 1.0), |(most, least): (f64, f64), x| (most.max(x), least.min(x)));
    let (most, fewest) = figures.iter().fold((1.0, 1e9), |(most, least): (f64, f64), figure| {
        (most.max(documents(figure)), least.min(documents(figure)))
    });
    let (width, height) = (WIDTH - MARGIN, HEIGHT - MARGIN);
    let x = |count: f64| left + width * share(count, fewest, most);
    let y = |seconds: f64| top + height * (1.0 - share(seconds, fastest, slowest));
    text(svg, left, top - 8.0, "black", work.name());
    // Writing to a String cannot fail.
    let _ = writeln!(
        svg,
        "<rect x=\"{left:.0}\" y=\"{top:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" fill=\"none\" stroke=\"#bbb\"/>"
    );
    for seconds in [fastest, slowest] {
        text(svg, left - 45.0, y(seconds) + 4.0, "#555", &format!("{:.0} µs", seconds * 1e6));
    }
    for count in [fewest, most] {
        text(svg, x(count) - 12.0, top + height + 14.0, "#555", &format!("{count:.0}"));
    }
    let subjects = figures.first().map_or(0, |figure| figure.medians.len());
    for nth in 0..subjects {
        let points = figures.iter().filter_map(|figure| {
            let (_, median) = figure.medians.get(nth)?;
            Some(format!("{:.1},{:.1}", x(documents(figure)), y(median.as_secs_f64())))
        });
        let points: Vec<String> = points.collect();
        let colour = COLOURS[nth % COLOURS.len()];
        let line = points.join(" ");
        let _ = writeln!(svg, "<polyline points=\"{line}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>");
    }
}

/// Where a value lies between two others, on a logarithmic axis.
fn share(value: f64, least: f64, most: f64) -> f64 {
    let span = most.ln() - least.ln();
    if span > 0.0 { (value.ln() - least.ln()) / span } else { 0.5 }
}

fn text(svg: &mut String, x: f64, y: f64, colour: &str, words: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.0}\" y=\"{y:.0}\" fill=\"{colour}\">{words}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_line_for_each_subject_in_each_panel() {
        let medians =
            |factor| vec![("embedded", Duration::from_micros(factor)), ("mongod", Duration::from_micros(900))];
        let figures: Vec<Figure> = [1_000, 10_000]
            .into_iter()
            .flat_map(|documents| {
                Work::ALL.map(|work| Figure { documents, work, medians: medians(documents as u64 / 100) })
            })
            .collect();
        let svg = plot(&figures);
        assert_eq!(svg.matches("<polyline").count(), 2 * Work::ALL.len());
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
