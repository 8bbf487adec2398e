//! `$geoWithin` and `$geoIntersects`: what lies in a region, or has a part of it.

use bson::{Bson, Document};

use super::geometry::{Geometry, Shape, Spot};
use super::plane::{Disc, Outline, Rectangle};
use super::reader;
use super::sphere::{BigPolygon, Cap};
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::View;

/// A region and the condition that a geometry must meet.
#[derive(Debug)]
pub(in crate::query) struct Region(Question);

/// The condition on a geometry.
#[derive(Debug)]
enum Question {
    /// Positions of the plane within.
    Flat(Flat),
    /// Everything within a part of the sphere.
    Within(Round),
    /// Everything that has a point in common with a part of the sphere.
    Meets(Round),
}

/// A region of the plane.
#[derive(Debug)]
enum Flat {
    Box(Rectangle),
    Center(Disc),
    Polygon(Outline),
}

/// A region of the sphere.
#[derive(Debug)]
enum Round {
    Cap(Cap),
    Shapes(Vec<Shape>),
    Big(BigPolygon),
}

/// An argument of the two operators.
enum Area {
    Flat(Flat),
    Cap(Cap),
    Geometry(Geometry),
}

impl Region {
    /// Reads what `$geoWithin` (and its older name `$within`) takes.
    ///
    /// # Errors
    /// If that is not one region that something can be within.
    pub(in crate::query) fn within(operator: &str, argument: &Bson) -> Result<Self> {
        let areas = areas(argument)?;
        if areas.len() > 1 && operator == "$geoWithin" {
            return Err(QueryError::bad_value("$geoWithin takes one region only"));
        }
        match last(areas)? {
            Area::Flat(flat) => Ok(Self(Question::Flat(flat))),
            Area::Cap(cap) => Ok(Self(Question::Within(Round::Cap(cap)))),
            Area::Geometry(Geometry::Big(polygon)) => Ok(Self(Question::Within(Round::Big(polygon)))),
            Area::Geometry(geometry) if geometry.has_area() => Ok(Self(Question::Within(round(&geometry)?))),
            Area::Geometry(_) => Err(QueryError::bad_value(
                "nothing is within a point or a line: $geoWithin needs a Polygon or MultiPolygon",
            )),
        }
    }

    /// Reads what `$geoIntersects` takes.
    ///
    /// # Errors
    /// If that is no geometry of the sphere.
    pub(in crate::query) fn meets(argument: &Bson) -> Result<Self> {
        match last(areas(argument)?)? {
            Area::Geometry(Geometry::Big(polygon)) => Ok(Self(Question::Meets(Round::Big(polygon)))),
            Area::Geometry(geometry) => Ok(Self(Question::Meets(round(&geometry)?))),
            Area::Cap(cap) => Ok(Self(Question::Meets(Round::Cap(cap)))),
            Area::Flat(_) => Err(QueryError::bad_value("$geoIntersects needs a $geometry of the sphere")),
        }
    }

    /// Returns whether a value of a document is a geometry that the region is asked for.
    pub(in crate::query) fn takes(&self, value: View<'_>) -> bool {
        if !matches!(value, View::Document(_) | View::Array(_)) {
            return false;
        }
        let Ok(geometry) = reader::stored(value) else { return false };
        match &self.0 {
            Question::Flat(flat) => geometry.flat().is_some_and(|point| flat.has(point)),
            Question::Within(round) => geometry.shapes().is_some_and(|shapes| shapes.iter().all(|s| round.contains(s))),
            Question::Meets(round) => geometry.shapes().is_some_and(|shapes| shapes.iter().any(|s| round.meets(s))),
        }
    }
}

impl Flat {
    fn has(&self, point: (f64, f64)) -> bool {
        match self {
            Self::Box(rectangle) => rectangle.has(point),
            Self::Center(disc) => disc.has(point),
            Self::Polygon(outline) => outline.has(point),
        }
    }
}

impl Round {
    fn contains(&self, shape: &Shape) -> bool {
        match (self, shape) {
            (Self::Cap(cap), Shape::Point(position)) => {
                position.sphere.is_some_and(|Spot { cell, .. }| cap.touches_cell(cell))
            }
            (Self::Cap(cap), Shape::Line(line)) => cap.contains_line(line),
            (Self::Cap(cap), Shape::Polygon(polygon)) => cap.contains_polygon(polygon),
            (Self::Shapes(shapes), shape) => shapes.iter().any(|own| own.contains(shape)),
            (Self::Big(big), Shape::Point(position)) => {
                position.sphere.is_some_and(|spot| big.has_or_touches(spot.point, spot.cell))
            }
            (Self::Big(big), Shape::Line(line)) => big.contains_line(line),
            (Self::Big(big), Shape::Polygon(polygon)) => big.contains(polygon),
        }
    }

    fn meets(&self, shape: &Shape) -> bool {
        match (self, shape) {
            // MongoDB finds nothing that a cap intersects.
            (Self::Cap(_), _) => false,
            (Self::Shapes(shapes), shape) => shapes.iter().any(|own| own.meets(shape)),
            (Self::Big(big), Shape::Point(position)) => {
                position.sphere.is_some_and(|spot| big.has_or_touches(spot.point, spot.cell))
            }
            (Self::Big(big), Shape::Line(line)) => big.meets_line(line),
            (Self::Big(big), Shape::Polygon(polygon)) => big.meets(polygon),
        }
    }
}

fn round(geometry: &Geometry) -> Result<Round> {
    let shapes = geometry.shapes();
    shapes
        .map(|shapes| Round::Shapes(shapes.to_vec()))
        .ok_or_else(|| QueryError::bad_value("the geometry is not one of the sphere"))
}

fn last(areas: Vec<Area>) -> Result<Area> {
    areas.into_iter().next_back().ok_or_else(|| QueryError::bad_value("a geo query needs a geometry"))
}

fn areas(argument: &Bson) -> Result<Vec<Area>> {
    let Bson::Document(specifiers) = argument else {
        return Err(QueryError::bad_value("the argument of a geo query must be an object"));
    };
    specifiers.iter().filter(|(name, _)| *name != "$uniqueDocs").map(|(name, value)| area(name, value)).collect()
}

fn area(name: &str, value: &Bson) -> Result<Area> {
    let items = match value {
        Bson::Array(items) => items.clone(),
        Bson::Document(fields) => fields.values().cloned().collect(),
        _ => return Err(QueryError::bad_value(format!("unknown geo specifier: {name}: {value}"))),
    };
    let point = |index: usize| reader::pair(items.get(index).map(View::from), false);
    match name {
        "$geometry" => Ok(Area::Geometry(reader::asked(value.into())?)),
        "$box" => Ok(Area::Flat(Flat::Box(Rectangle::between(point(0)?, point(1)?)))),
        "$center" => Ok(Area::Flat(Flat::Center(Disc { centre: point(0)?, radius: radius(&items)? }))),
        "$centerSphere" => {
            let centre = reader::on_sphere(point(0)?)?;
            let radius = radius(&items)?;
            let spot = centre.sphere.ok_or_else(|| QueryError::bad_value("the centre is not on the sphere"))?;
            Ok(Area::Cap(Cap::new(spot.point, radius)))
        }
        "$polygon" => {
            let corners = items.iter().map(|item| reader::pair(Some(item.into()), false)).collect::<Result<_>>()?;
            let outline = Outline::new(corners);
            let outline = outline.ok_or_else(|| QueryError::bad_value("a $polygon must have at least 3 points"))?;
            Ok(Area::Flat(Flat::Polygon(outline)))
        }
        _ => Err(QueryError::bad_value(format!("unknown geo specifier: {name}"))),
    }
}

/// Returns the radius behind the centre, with nothing after it.
fn radius(items: &[Bson]) -> Result<f64> {
    let radius = items.get(1).and_then(Number::of).map(Number::to_double).filter(|radius| *radius >= 0.0);
    let radius = radius.ok_or_else(|| QueryError::bad_value("the radius must be a number that is not negative"))?;
    match items.len() {
        2 => Ok(radius),
        _ => Err(QueryError::bad_value("a circle is a centre and a radius, nothing more")),
    }
}

/// Refuses other operators beside one that must be alone.
///
/// # Errors
/// If there are any.
pub(in crate::query) fn alone(name: &str, siblings: &Document) -> Result<()> {
    match siblings.keys().find(|other| *other != name) {
        Some(other) if siblings.keys().next().is_some_and(|first| first == name) => {
            Err(QueryError::bad_value(format!("{other} cannot stand beside {name}")))
        }
        _ => Ok(()),
    }
}
