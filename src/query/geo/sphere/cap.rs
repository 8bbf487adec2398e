//! Caps: all points within an angle of a centre.

use std::f64::consts::PI;

use super::cell::Cell;
use super::line::Line;
use super::polygon::Polygon;
use super::vector::Vector;

/// A cap.
#[derive(Debug, Clone)]
pub(in crate::query::geo) struct Cap {
    centre: Vector,
    /// How high the cap is over the plane of its edge: 1 for half the sphere, 2 for all of it.
    height: f64,
}

impl Cap {
    /// Returns the cap of a radius in radians.
    pub(in crate::query::geo) fn new(centre: Vector, radius: f64) -> Self {
        let half = (0.5 * radius).sin();
        Self { centre, height: if radius >= PI { 2.0 } else { 2.0 * half * half } }
    }

    fn has(&self, point: Vector) -> bool {
        (self.centre - point).square() <= 2.0 * self.height
    }

    /// Returns whether a part of the cell is in the cap.
    pub(in crate::query::geo) fn touches_cell(&self, cell: Cell) -> bool {
        let vertices = cell.vertices();
        if vertices.iter().any(|vertex| self.has(*vertex)) {
            return true;
        }
        if self.height >= 1.0 {
            return false;
        }
        if cell.contains(self.centre) {
            return true;
        }
        let square = self.height * (2.0 - self.height);
        for (from, to) in vertices.iter().zip(vertices.iter().cycle().skip(1)) {
            let inward = from.cross(*to);
            let depth = self.centre.dot(inward);
            if depth > 0.0 {
                continue;
            }
            if depth * depth > square * inward.square() {
                return false;
            }
            let along = inward.cross(self.centre);
            if along.dot(*from) < 0.0 && along.dot(*to) > 0.0 {
                return true;
            }
        }
        false
    }

    /// Returns the centre of the points outside of the cap, and how far they reach.
    fn outside(&self) -> (Vector, f64) {
        let height = if self.height >= 2.0 { -1.0 } else { 2.0 - self.height };
        (-self.centre, if height < 0.0 { -1.0 } else { 2.0 * (0.5 * height).sqrt().asin() })
    }

    pub(in crate::query::geo) fn contains_line(&self, line: &Line) -> bool {
        let (centre, radius) = self.outside();
        line.distance(centre) >= radius
    }

    pub(in crate::query::geo) fn contains_polygon(&self, polygon: &Polygon) -> bool {
        let (centre, radius) = self.outside();
        polygon.distance(centre) >= radius
    }
}
