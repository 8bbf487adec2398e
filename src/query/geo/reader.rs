//! Geometries from values, with MongoDB's checks.

use super::geometry::{Geometry, Position, Shape};
use super::plane;
use super::sphere::{BigPolygon, Line, Polygon, Vector};
use crate::query::error::{QueryError, Result};
use crate::query::view::{Fields, View};

/// Names of the reference system of longitudes and latitudes.
const DEGREES: [&str; 2] = ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326"];
/// The same, where the inside of a polygon is left of its ring, however large.
const STRICT: &str = "urn:x-mongodb:crs:strictwinding:EPSG:4326";

/// The types of GeoJSON that have a reference system and coordinates.
#[derive(Debug, Clone, Copy)]
enum GeometryType {
    Point,
    LineString,
    Polygon,
    MultiPoint,
    MultiLineString,
    MultiPolygon,
    Collection,
}

fn wrong(message: impl Into<String>) -> QueryError {
    QueryError::bad_value(message)
}

/// What a document has at a place: GeoJSON, or a pair of coordinates, perhaps with more behind it.
///
/// # Errors
/// If it is neither.
pub(super) fn stored(value: View<'_>) -> Result<Geometry> {
    geometry(value, true)
}

/// What a query has as `$geometry`.
///
/// # Errors
/// If it is no geometry.
pub(super) fn asked(value: View<'_>) -> Result<Geometry> {
    geometry(value, false)
}

fn geometry(value: View<'_>, with_more: bool) -> Result<Geometry> {
    match value {
        View::Document(fields) if !begins_with_number(fields) => geojson(fields),
        View::Document(_) | View::Array(_) => {
            Ok(Geometry::Point(Shape::Point(Position::new(pair(Some(value), with_more)?))))
        }
        _ => Err(wrong("a geo element must be an array or an object")),
    }
}

/// Returns whether a document is a pair of coordinates under any names.
pub(super) fn begins_with_number(fields: Fields<'_>) -> bool {
    fields.iter().next().is_some_and(|(_, value)| matches!(value, View::Number(_)))
}

/// Two finite numbers in an array or document; `with_more` allows more behind them.
///
/// # Errors
/// If there is something else.
pub(super) fn pair(value: Option<View<'_>>, with_more: bool) -> Result<plane::Point> {
    let mut values: Box<dyn Iterator<Item = View<'_>>> = match value {
        Some(View::Array(items)) => Box::new(items.iter()),
        Some(View::Document(fields)) => Box::new(fields.iter().map(|(_, value)| value)),
        other => {
            let found = other.map_or("nothing", View::type_name);
            return Err(wrong(format!("a point must be an array or an object of two numbers, not {found}")));
        }
    };
    let (Some(View::Number(x)), Some(View::Number(y))) = (values.next(), values.next()) else {
        return Err(wrong("a point must have two numbers"));
    };
    let point = (x.to_double(), y.to_double());
    if !point.0.is_finite() || !point.1.is_finite() {
        return Err(wrong("the coordinates of a point must be finite numbers"));
    }
    if !with_more && values.next().is_some() {
        return Err(wrong("a point must have no more than two numbers"));
    }
    Ok(point)
}

/// Returns a longitude and a latitude.
fn position(value: Option<View<'_>>) -> Result<Position> {
    on_sphere(pair(value, true)?)
}

/// Returns a position that must be on the sphere.
///
/// # Errors
/// If the longitude is beyond ±180 or the latitude beyond ±90.
pub(super) fn on_sphere(flat: plane::Point) -> Result<Position> {
    let position = Position::new(flat);
    match position.sphere {
        Some(_) => Ok(position),
        None => Err(wrong(format!("longitude {} or latitude {} is out of bounds", flat.0, flat.1))),
    }
}

/// Returns the position of a GeoJSON Point; MongoDB looks at its coordinates only.
///
/// # Errors
/// If there are none.
pub(super) fn point(fields: Fields<'_>) -> Result<Position> {
    match is_strict(fields)? {
        true => Err(wrong("strict winding order is only supported for a Polygon")),
        false => position(fields.get("coordinates")),
    }
}

fn geometry_type(fields: Fields<'_>) -> Option<GeometryType> {
    let Some(View::String(name)) = fields.get("type") else { return None };
    Some(match name {
        "Point" => GeometryType::Point,
        "LineString" => GeometryType::LineString,
        "Polygon" => GeometryType::Polygon,
        "MultiPoint" => GeometryType::MultiPoint,
        "MultiLineString" => GeometryType::MultiLineString,
        "MultiPolygon" => GeometryType::MultiPolygon,
        "GeometryCollection" => GeometryType::Collection,
        _ => return None,
    })
}

fn unknown(fields: Fields<'_>) -> QueryError {
    wrong(format!("unknown GeoJSON type: {}", fields.to_document()))
}

/// Returns a geometry in GeoJSON.
fn geojson(fields: Fields<'_>) -> Result<Geometry> {
    let geometry_type = geometry_type(fields).ok_or_else(|| unknown(fields))?;
    if let GeometryType::Collection = geometry_type {
        return collection(fields).map(Geometry::Shapes);
    }
    if is_strict(fields)? {
        return match geometry_type {
            GeometryType::Polygon => big_polygon(fields.get("coordinates")).map(Geometry::Big),
            _ => Err(wrong("strict winding order is only supported for a Polygon")),
        };
    }
    let shapes = simple(geometry_type, fields)?;
    Ok(match (geometry_type, shapes.as_slice()) {
        (GeometryType::Point, [point]) => Geometry::Point(point.clone()),
        _ => Geometry::Shapes(shapes),
    })
}

fn collection(fields: Fields<'_>) -> Result<Vec<Shape>> {
    let Some(View::Array(items)) = fields.get("geometries") else {
        return Err(wrong("the geometries of a GeometryCollection must be an array"));
    };
    if items.is_empty() {
        return Err(wrong("a GeometryCollection must have at least one geometry"));
    }
    let mut shapes = Vec::new();
    for item in items.iter() {
        let View::Document(fields) = item else {
            return Err(wrong("an element of a GeometryCollection is not an object"));
        };
        match geometry_type(fields).ok_or_else(|| unknown(fields))? {
            GeometryType::Collection => return Err(wrong("a GeometryCollection cannot be in another")),
            _ if is_strict(fields)? => {
                return Err(wrong("a GeometryCollection cannot have a polygon of strict winding order"));
            }
            geometry_type => shapes.extend(simple(geometry_type, fields)?),
        }
    }
    Ok(shapes)
}

fn simple(geometry_type: GeometryType, fields: Fields<'_>) -> Result<Vec<Shape>> {
    let coordinates = fields.get("coordinates");
    let several = |name: &str| match coordinates {
        Some(View::Array(items)) if !items.is_empty() => Ok(items.iter()),
        _ => Err(wrong(format!("the coordinates of a {name} must be an array of at least one"))),
    };
    match geometry_type {
        GeometryType::Point => Ok(vec![Shape::Point(position(coordinates)?)]),
        GeometryType::LineString => Ok(vec![Shape::Line(line(coordinates)?)]),
        GeometryType::Polygon => Ok(vec![Shape::Polygon(polygon(coordinates)?)]),
        GeometryType::MultiPoint => {
            several("MultiPoint")?.map(|item| Ok(Shape::Point(position(Some(item))?))).collect()
        }
        GeometryType::MultiLineString => {
            several("MultiLineString")?.map(|item| Ok(Shape::Line(line(Some(item))?))).collect()
        }
        GeometryType::MultiPolygon => {
            several("MultiPolygon")?.map(|item| Ok(Shape::Polygon(polygon(Some(item))?))).collect()
        }
        GeometryType::Collection => collection(fields),
    }
}

/// Returns whether the reference system is the one of strict winding order.
fn is_strict(fields: Fields<'_>) -> Result<bool> {
    let system = match fields.get("crs") {
        None => return Ok(false),
        Some(View::Document(system)) => system,
        Some(_) => return Err(wrong("a GeoJSON crs must be an object")),
    };
    if !matches!(system.get("type"), Some(View::String("name"))) {
        return Err(wrong("a GeoJSON crs must have type: 'name'"));
    }
    let Some(View::Document(properties)) = system.get("properties") else {
        return Err(wrong("a GeoJSON crs must have properties, an object"));
    };
    match properties.get("name") {
        Some(View::String(name)) if DEGREES.contains(&name) => Ok(false),
        Some(View::String(STRICT)) => Ok(true),
        Some(View::String(name)) => Err(wrong(format!("unknown crs name: {name}"))),
        _ => Err(wrong("a GeoJSON crs must have a properties.name, a string")),
    }
}

/// Points of the sphere, equal neighbours once.
fn points(value: Option<View<'_>>) -> Result<Vec<Vector>> {
    let Some(View::Array(items)) = value else {
        return Err(wrong("GeoJSON coordinates must be an array of coordinates"));
    };
    let mut points: Vec<Vector> = Vec::with_capacity(items.len());
    for item in items.iter() {
        let place = position(Some(item))?;
        points.extend(place.sphere.map(|spot| spot.point));
    }
    Ok(points)
}

fn line(value: Option<View<'_>>) -> Result<Line> {
    let mut points = points(value)?;
    points.dedup();
    if points.len() < 2 {
        return Err(wrong("a LineString must have at least 2 different vertices"));
    }
    Line::new(points).ok_or_else(|| wrong("a LineString cannot go to the opposite of a vertex"))
}

/// Returns the vertices of a ring, without the last one that closes it.
fn ring(value: Option<View<'_>>) -> Result<Vec<Vector>> {
    let mut points = points(value)?;
    if points.is_empty() {
        return Err(wrong("a ring has no vertices"));
    }
    if points.first() != points.last() {
        return Err(wrong("a ring is not closed: its last position must be its first"));
    }
    points.dedup();
    points.pop();
    Ok(points)
}

fn polygon(value: Option<View<'_>>) -> Result<Polygon> {
    let Some(View::Array(items)) = value else {
        return Err(wrong("the coordinates of a Polygon must be an array of rings"));
    };
    let rings = items.iter().map(|item| ring(Some(item))).collect::<Result<_>>()?;
    Polygon::new(rings).map_err(|fault| wrong(format!("the polygon is not valid: {fault}")))
}

fn big_polygon(value: Option<View<'_>>) -> Result<BigPolygon> {
    let one = match value {
        Some(View::Array(items)) if items.len() == 1 => items.get(0),
        _ => return Err(wrong("a polygon of strict winding order must have one ring")),
    };
    BigPolygon::new(ring(one)?).map_err(|fault| wrong(format!("the polygon is not valid: {fault}")))
}
