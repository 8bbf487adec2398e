//! Points, bars and intervals out of documents.

use bson::Document;

use super::chart::{Axis, Chart, Interval, Kind, Point, Series, timeline_height};
use super::field::{is_undrawable, lookup, number, text};
use crate::formats::scene::Pose;
use crate::formats::scene::document::numbers;

/// The usual size of a chart in pixels.
const WIDTH: f64 = 800.0;
const HEIGHT: f64 = 500.0;

/// Which fields are drawn: dotted paths.
#[derive(Debug, Clone, Default)]
pub struct Fields {
    /// Along x.
    pub x: Option<String>,
    /// Up; of bars without one, documents are counted.
    pub y: Option<String>,
    /// What makes a series of its own for each value.
    pub by: Option<String>,
    /// Names of points and intervals.
    pub label: Option<String>,
    /// Where points of a map look, in radians; else the rotation of the document.
    pub heading: Option<String>,
    /// When intervals begin.
    pub from: Option<String>,
    /// When intervals end.
    pub to: Option<String>,
}

/// What was taken out of documents.
#[derive(Debug, Clone, Default)]
pub struct Taken {
    /// Series, in the order in which they were found.
    pub series: Vec<Series>,
    /// How many documents have what is needed.
    pub used: u64,
    /// How many have not.
    pub skipped: u64,
    /// How many have a number that cannot be drawn, such as 1e301.
    pub undrawable: u64,
    /// Whether x is a date.
    pub x_dates: bool,
    /// Whether y is a date.
    pub y_dates: bool,
}

impl Fields {
    /// Returns the fields without which a document is not drawn, each with the option that names another one.
    #[must_use]
    pub fn needed(&self, kind: Kind) -> Vec<(&'static str, &str)> {
        let (first, second) = self.axes(kind);
        match kind {
            Kind::Line | Kind::Scatter | Kind::Map => vec![("--x", first), ("--y", second)],
            Kind::Timeline => vec![("--from", first), ("--to", second)],
            Kind::Bars => std::iter::once(("--x", first)).chain(self.y.as_deref().map(|y| ("--y", y))).collect(),
        }
    }

    /// The two fields of a point or an interval; of a bar, only the first one counts.
    fn axes(&self, kind: Kind) -> (&str, &str) {
        let (given, usual) = match kind {
            Kind::Map => ((&self.x, &self.y), ("translation.0", "translation.1")),
            Kind::Line | Kind::Scatter => ((&self.x, &self.y), ("x", "y")),
            Kind::Bars => ((&self.x, &self.y), ("_id", "")),
            Kind::Timeline => ((&self.from, &self.to), ("from", "to")),
        };
        (given.0.as_deref().unwrap_or(usual.0), given.1.as_deref().unwrap_or(usual.1))
    }
}

impl Taken {
    /// Takes what one document has.
    pub fn take(&mut self, document: &Document, fields: &Fields, kind: Kind) {
        let name = fields.by.as_ref().and_then(|by| lookup(document, by)).map(text).unwrap_or_default();
        let taken = match kind {
            Kind::Bars => self.bar(document, fields, name),
            Kind::Timeline => self.interval(document, fields, name),
            Kind::Line | Kind::Scatter | Kind::Map => self.point(document, fields, kind, name),
        };
        match taken {
            Some(()) => self.used += 1,
            None if has_undrawable(document, fields, kind) => self.undrawable += 1,
            None => self.skipped += 1,
        }
    }

    fn series(&mut self, name: String) -> &mut Series {
        let index = self.series.iter().position(|series| series.name == name).unwrap_or_else(|| {
            self.series.push(Series { name, ..Series::default() });
            self.series.len() - 1
        });
        &mut self.series[index]
    }

    fn point(&mut self, document: &Document, fields: &Fields, kind: Kind, name: String) -> Option<()> {
        let (x, y) = fields.axes(kind);
        let (x, y) = (lookup(document, x)?, lookup(document, y)?);
        self.x_dates |= matches!(x, bson::Bson::DateTime(_));
        self.y_dates |= matches!(y, bson::Bson::DateTime(_));
        let label = lookup(document, fields.label.as_deref().unwrap_or("name")).map(text).unwrap_or_default();
        let point = Point { x: number(x)?, y: number(y)?, label, heading: heading(document, fields) };
        self.series(name).points.push(point);
        Some(())
    }

    fn bar(&mut self, document: &Document, fields: &Fields, name: String) -> Option<()> {
        let x = text(lookup(document, fields.axes(Kind::Bars).0)?);
        let y = match &fields.y {
            Some(y) => number(lookup(document, y)?)?,
            None => 1.0,
        };
        self.series(name).bars.push((x, y));
        Some(())
    }

    fn interval(&mut self, document: &Document, fields: &Fields, name: String) -> Option<()> {
        let (from, to) = fields.axes(Kind::Timeline);
        let (from, to) = (lookup(document, from)?, lookup(document, to)?);
        self.x_dates |= matches!(from, bson::Bson::DateTime(_));
        let label = lookup(document, fields.label.as_deref().unwrap_or("name")).map(text).unwrap_or_default();
        let (from, to) = (number(from)?, number(to)?);
        let interval = Interval { label, from, to: to.max(from), color: None };
        self.series(name).intervals.push(interval);
        Some(())
    }

    /// The chart of what was taken; axes are called by their fields where nothing else is given. Without a size, a
    /// timeline is as high as its rows need.
    #[must_use]
    pub fn chart(self, fields: &Fields, kind: Kind, title: String, size: Option<(f64, f64)>) -> Chart {
        let called = |given: &Option<String>, usual: &str| given.clone().unwrap_or_else(|| usual.to_owned());
        let (x, y) = match kind {
            Kind::Map => ("x (m)".to_owned(), "y (m)".to_owned()),
            Kind::Bars => (called(&fields.x, ""), called(&fields.y, "documents")),
            Kind::Timeline if self.x_dates => ("time".to_owned(), String::new()),
            Kind::Timeline => ("time (s)".to_owned(), String::new()),
            Kind::Line | Kind::Scatter => (called(&fields.x, "x"), called(&fields.y, "y")),
        };
        let size = size.unwrap_or_else(|| match kind {
            Kind::Timeline => (WIDTH, timeline_height(&self.series)),
            _ => (WIDTH, HEIGHT),
        });
        let axis = |label: String, dates: bool| Axis { label, dates, ..Axis::default() };
        Chart { title, x: axis(x, self.x_dates), y: axis(y, self.y_dates), kind, series: self.series, size }
    }
}

/// Whether a needed field of a document is a number that cannot be drawn.
fn has_undrawable(document: &Document, fields: &Fields, kind: Kind) -> bool {
    fields.needed(kind).iter().any(|(_, field)| lookup(document, field).is_some_and(is_undrawable))
}

/// The heading under a field, else how the document's rotation turns about z.
fn heading(document: &Document, fields: &Fields) -> Option<f64> {
    if let Some(path) = &fields.heading {
        return number(lookup(document, path)?);
    }
    let pose = Pose::new([0.0; 3], numbers(document, "rotation").ok()?)?;
    let [x, y, _] = pose.rotate([1.0, 0.0, 0.0]);
    Some(y.atan2(x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn take(documents: &[Document], fields: &Fields, kind: Kind) -> Taken {
        let mut taken = Taken::default();
        documents.iter().for_each(|document| taken.take(document, fields, kind));
        taken
    }

    #[test]
    fn positions_become_a_map_with_names_and_headings() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let documents = [
            doc! { "name": "cup", "translation": [1, 2, 3], "rotation": [0.0, 0.0, half, half] },
            doc! { "name": "idea" },
        ];
        let taken = take(&documents, &Fields::default(), Kind::Map);
        assert_eq!((taken.used, taken.skipped), (1, 1));
        let point = &taken.series[0].points[0];
        assert_eq!((point.x, point.y, point.label.as_str()), (1.0, 2.0, "cup"));
        assert!((point.heading.unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn each_value_of_by_is_a_series() {
        let documents =
            [doc! { "k": "a", "x": 1, "y": 2 }, doc! { "k": "b", "x": 1, "y": 3 }, doc! { "k": "a", "x": 2, "y": 2 }];
        let fields = Fields { by: Some("k".into()), ..Fields::default() };
        let taken = take(&documents, &fields, Kind::Line);
        let sizes: Vec<(&str, usize)> =
            taken.series.iter().map(|series| (series.name.as_str(), series.points.len())).collect();
        assert_eq!(sizes, [("a", 2), ("b", 1)]);
        let bars = take(&documents, &Fields { x: Some("k".into()), ..Fields::default() }, Kind::Bars);
        assert_eq!(bars.series[0].bars.len(), 3);
    }

    #[test]
    fn no_values_make_a_drawing_fail() {
        for kind in [Kind::Line, Kind::Scatter, Kind::Map, Kind::Bars, Kind::Timeline] {
            for documents in [
                vec![],
                vec![doc! { "x": 0, "y": 0, "from": 1, "to": 1 }],
                vec![doc! { "x": f64::NAN, "y": 1 }, doc! { "x": 1e300, "y": -1e300, "from": 5, "to": 1 }],
                vec![doc! { "x": "<&>\u{1}", "y": i64::MAX, "_id": "a", "name": "]]>", "translation": [1, 1] }],
            ] {
                let taken = take(&documents, &Fields::default(), kind);
                if taken.used == 0 {
                    continue;
                }
                for log in [false, true] {
                    let mut chart = taken.clone().chart(&Fields::default(), kind, "t".into(), Some((600.0, 400.0)));
                    (chart.x.log, chart.y.log) = (log, log);
                    let svg = chart.positive().draw().unwrap().svg();
                    assert!(svg.starts_with("<svg") && !svg.contains("NaN"), "{svg}");
                }
            }
        }
    }
}
