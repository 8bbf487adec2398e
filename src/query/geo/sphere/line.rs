//! Lines: edges one after the other.

use super::cell::Cell;
use super::edge::{Meeting, distance, meeting};
use super::vector::Vector;

/// A line of at least two vertices, of which no two neighbours are equal or opposite.
#[derive(Debug, Clone)]
pub(in crate::query::geo) struct Line {
    vertices: Vec<Vector>,
}

impl Line {
    /// Returns the line, where it is one.
    pub(in crate::query::geo) fn new(vertices: Vec<Vector>) -> Option<Self> {
        let sound = |pair: &[Vector]| matches!(pair, [a, b] if a != b && *a != -*b);
        (vertices.len() >= 2 && vertices.windows(2).all(sound)).then_some(Self { vertices })
    }

    pub(super) fn vertices(&self) -> &[Vector] {
        &self.vertices
    }

    pub(super) fn edges(&self) -> impl Iterator<Item = (Vector, Vector)> + Clone + '_ {
        self.vertices.iter().copied().zip(self.vertices.iter().copied().skip(1))
    }

    /// Returns whether two lines cross or touch.
    pub(in crate::query::geo) fn meets(&self, other: &Self) -> bool {
        self.edges().any(|(a, b)| other.edges().any(|(c, d)| meeting(a, b, c, d) != Meeting::Apart))
    }

    /// Returns whether the line goes through the cell.
    pub(in crate::query::geo) fn touches_cell(&self, cell: Cell) -> bool {
        if self.vertices.iter().any(|vertex| cell.contains(*vertex)) {
            return true;
        }
        let corners = cell.vertices();
        let sides = corners.iter().zip(corners.iter().cycle().skip(1));
        sides.into_iter().any(|(from, to)| self.edges().any(|(a, b)| meeting(*from, *to, a, b) != Meeting::Apart))
    }

    /// Returns the angle from a point to the closest point of the line.
    pub(in crate::query::geo) fn distance(&self, point: Vector) -> f64 {
        distance(point, self.edges())
    }
}
