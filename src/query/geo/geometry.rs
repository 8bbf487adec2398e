//! Geometries of documents and queries: GeoJSON, and pairs of coordinates.

use super::plane;
use super::sphere::{BigPolygon, Cell, Line, Polygon, Vector};

/// A place: a position, lines, areas, or a collection of these.
#[derive(Debug, Clone)]
pub(super) enum Geometry {
    /// A position: a pair of coordinates, or a GeoJSON Point.
    Point(Shape),
    /// Other GeoJSON, taken apart into its simple shapes.
    Shapes(Vec<Shape>),
    /// A polygon of the `strictwinding` reference system, which only queries may have.
    Big(BigPolygon),
}

/// A simple shape of the sphere.
#[derive(Debug, Clone)]
pub(super) enum Shape {
    Point(Position),
    Line(Line),
    Polygon(Polygon),
}

/// A position by its coordinates: on the plane, and on the sphere where these are a longitude and a latitude.
#[derive(Debug, Clone, Copy)]
pub(super) struct Position {
    pub(super) flat: plane::Point,
    pub(super) sphere: Option<Spot>,
}

/// A point of the sphere.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) point: Vector,
    pub(super) cell: Cell,
}

impl Position {
    pub(super) fn new(flat: plane::Point) -> Self {
        let valid = flat.0.abs() <= 180.0 && flat.1.abs() <= 90.0;
        let sphere = valid.then(|| {
            let point = Vector::at(flat.0, flat.1);
            Spot { point, cell: Cell::of(point) }
        });
        Self { flat, sphere }
    }
}

impl Geometry {
    /// Returns the position on the plane, where the geometry is one position.
    pub(super) fn flat(&self) -> Option<plane::Point> {
        match self {
            Self::Point(Shape::Point(position)) => Some(position.flat),
            _ => None,
        }
    }

    /// Returns whether the geometry has areas, which other geometries can be within.
    pub(super) fn has_area(&self) -> bool {
        match self {
            Self::Point(_) => false,
            Self::Shapes(shapes) => shapes.iter().any(|shape| matches!(shape, Shape::Polygon(_))),
            Self::Big(_) => true,
        }
    }

    /// Returns the simple shapes on the sphere, where the geometry can be there.
    pub(super) fn shapes(&self) -> Option<&[Shape]> {
        match self {
            Self::Point(shape) => shape.is_on_sphere().then_some(std::slice::from_ref(shape)),
            Self::Shapes(shapes) => Some(shapes),
            Self::Big(_) => None,
        }
    }

    /// Returns the angle, in radians, from a point to the closest point of the geometry, where it can be on the sphere.
    pub(super) fn distance(&self, from: Vector) -> Option<f64> {
        self.shapes()?.iter().map(|shape| shape.distance(from)).reduce(f64::min)
    }
}

impl Shape {
    fn is_on_sphere(&self) -> bool {
        !matches!(self, Self::Point(Position { sphere: None, .. }))
    }

    fn distance(&self, from: Vector) -> f64 {
        match self {
            Self::Point(position) => position.sphere.map_or(f64::INFINITY, |spot| spot.point.angle(from)),
            Self::Line(line) => line.distance(from),
            Self::Polygon(polygon) => polygon.distance(from),
        }
    }

    /// Returns whether all of another shape is in this one: only areas have anything within them.
    pub(super) fn contains(&self, other: &Self) -> bool {
        let Self::Polygon(own) = self else { return false };
        match other {
            Self::Point(position) => position.sphere.is_some_and(|spot| own.has_or_touches(spot.point, spot.cell)),
            Self::Line(line) => own.contains_line(line),
            Self::Polygon(polygon) => own.contains(polygon),
        }
    }

    /// Returns whether two shapes have a point in common.
    pub(super) fn meets(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Point(a), Self::Point(b)) => a.sphere.zip(b.sphere).is_some_and(|(a, b)| a.cell.is(b.cell)),
            (Self::Point(position), Self::Line(line)) | (Self::Line(line), Self::Point(position)) => {
                position.sphere.is_some_and(|spot| line.touches_cell(spot.cell))
            }
            (Self::Point(position), Self::Polygon(polygon)) | (Self::Polygon(polygon), Self::Point(position)) => {
                position.sphere.is_some_and(|spot| polygon.touches_cell(spot.point, spot.cell))
            }
            (Self::Line(a), Self::Line(b)) => b.meets(a),
            (Self::Line(line), Self::Polygon(polygon)) | (Self::Polygon(polygon), Self::Line(line)) => {
                polygon.meets_line(line)
            }
            (Self::Polygon(a), Self::Polygon(b)) => b.meets(a),
        }
    }
}
