//! Names on a map: beside their points, where they hide neither points nor each other.

use std::collections::HashMap;

use kuva::render::layout::ComputedLayout;
use kuva::render::render::{Primitive, TextAnchor};

use super::words;
use crate::views::chart::Chart;

/// The size of names in pixels.
const SIZE: u32 = 11;
/// Half the width of a point's marker, with what is kept free around it.
const MARKER: f64 = 5.0;
/// The edge of a cell in which neighbours are looked for.
const CELL: f64 = 48.0;
/// The most characters of a name.
const LONGEST: usize = 32;

/// The names that there is room for, and how many there are that there is none for.
pub(super) fn place(chart: &Chart, computed: &ComputedLayout) -> (Vec<Primitive>, usize) {
    let (mut taken, mut arrows) = (Taken::default(), Taken::default());
    let points = || chart.points().map(|point| (point, computed.map_x(point.x), computed.map_y(point.y)));
    let arrow = chart.arrow();
    for (point, x, y) in points() {
        taken.add(Area::around(x, y, MARKER, MARKER));
        if let Some([tip_x, tip_y]) = point.tip(arrow) {
            let (tip_x, tip_y) = (computed.map_x(tip_x), computed.map_y(tip_y));
            for part in [0.4, 0.7, 1.0] {
                arrows.add(Area::around(x + (tip_x - x) * part, y + (tip_y - y) * part, MARKER / 2.0, MARKER / 2.0));
            }
        }
    }
    let inside = Area {
        left: computed.margin_left,
        top: computed.margin_top,
        right: computed.width - computed.margin_right,
        bottom: computed.height - computed.margin_bottom,
    };
    let (mut texts, mut left_out) = (Vec::new(), 0);
    for (point, x, y) in points().filter(|(point, ..)| !point.label.is_empty()) {
        let label = words::clipped(&point.label, LONGEST);
        let areas = candidates(x, y, words::width(&label, f64::from(SIZE)));
        let free: Vec<Area> = areas.filter(|area| area.is_within(&inside) && taken.is_free(area)).collect();
        // Rather over an arrow than not at all.
        match free.iter().find(|area| arrows.is_free(area)).or(free.first()).copied() {
            Some(area) => {
                texts.push(text(&area, label));
                taken.add(area);
            }
            None => left_out += 1,
        }
    }
    (texts, left_out)
}

/// A rectangle in pixels; y grows downwards.
#[derive(Clone, Copy)]
struct Area {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Area {
    /// With its middle here, and so much to each side.
    fn around(x: f64, y: f64, across: f64, up: f64) -> Self {
        Self { left: x - across, top: y - up, right: x + across, bottom: y + up }
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    fn is_within(&self, other: &Self) -> bool {
        self.left >= other.left && self.right <= other.right && self.top >= other.top && self.bottom <= other.bottom
    }

    /// The cells that it is in.
    fn cells(&self) -> impl Iterator<Item = (i64, i64)> {
        let cell = |at: f64| (at / CELL).floor() as i64;
        let (rows, columns) = (cell(self.top)..=cell(self.bottom), cell(self.left)..=cell(self.right));
        rows.flat_map(move |row| columns.clone().map(move |column| (row, column)))
    }
}

/// Where the name of a point may be, the best first: above, below, right, left, and at the corners.
fn candidates(x: f64, y: f64, width: f64) -> impl Iterator<Item = Area> {
    let up = f64::from(SIZE) / 2.0;
    let (beside, above) = (MARKER + 1.0 + width / 2.0, MARKER + 1.0 + up);
    let places = [
        (0.0, -above),
        (0.0, above),
        (beside, 0.0),
        (-beside, 0.0),
        (beside, -above),
        (-beside, -above),
        (beside, above),
        (-beside, above),
    ];
    places.into_iter().map(move |(dx, dy)| Area::around(x + dx, y + dy, width / 2.0, up))
}

fn text(area: &Area, label: String) -> Primitive {
    Primitive::Text {
        x: f64::midpoint(area.left, area.right),
        // The baseline is above the lower edge by what letters have below it.
        y: area.bottom - f64::from(SIZE) * 0.2,
        content: label,
        size: SIZE,
        anchor: TextAnchor::Middle,
        rotate: None,
        bold: false,
        color: None,
    }
}

/// Areas that are not free any more, by cells.
#[derive(Default)]
struct Taken(HashMap<(i64, i64), Vec<Area>>);

impl Taken {
    fn add(&mut self, area: Area) {
        area.cells().for_each(|cell| self.0.entry(cell).or_default().push(area));
    }

    fn is_free(&self, area: &Area) -> bool {
        area.cells().filter_map(|cell| self.0.get(&cell)).flatten().all(|other| !other.overlaps(area))
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::layout;
    use super::super::marks::marks;
    use super::*;
    use crate::views::chart::{Axis, Chart, Kind, Point, Series};

    fn crowd(count: u32) -> Chart {
        let point = |nth: u32| {
            let (turn, reach) = (f64::from(nth) * 2.4, f64::from(nth).sqrt());
            let (x, y) = (turn.cos() * reach, turn.sin() * reach);
            Point { x, y, label: format!("object-{nth}"), heading: Some(turn) }
        };
        let series = vec![Series { points: (0..count).map(point).collect(), ..Series::default() }];
        let (x, y) = (Axis::default(), Axis::default());
        Chart { title: "crowd".to_owned(), x, y, kind: Kind::Map, series, size: (800.0, 500.0) }
    }

    #[test]
    fn names_hide_neither_points_nor_each_other_and_all_are_counted() {
        for count in [1, 5, 80, 2_000] {
            let chart = crowd(count);
            let computed = ComputedLayout::from_layout(&layout(&chart, &marks(&chart)));
            let (texts, left_out) = place(&chart, &computed);
            assert_eq!(texts.len() + left_out, count as usize);
            assert_eq!(left_out == 0, count <= 5, "{left_out} of {count}");
            let area = |text: &Primitive| match text {
                Primitive::Text { x, y, content, .. } => {
                    let wide = words::width(content, f64::from(SIZE)) / 2.0;
                    Area::around(*x, y + 0.2 * f64::from(SIZE) - f64::from(SIZE) / 2.0, wide - 0.1, 5.4)
                }
                other => panic!("{other:?}"),
            };
            let areas: Vec<Area> = texts.iter().map(area).collect();
            for (nth, one) in areas.iter().enumerate() {
                assert!(areas[nth + 1..].iter().all(|other| !one.overlaps(other)));
                assert!(chart.points().all(|point| {
                    let (x, y) = (computed.map_x(point.x), computed.map_y(point.y));
                    !one.overlaps(&Area::around(x, y, 4.0, 4.0))
                }));
            }
        }
    }
}
