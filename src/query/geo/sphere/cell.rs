//! The smallest cells of S2, about a centimetre wide: what MongoDB takes a point for.
//!
//! The sphere is projected on the six faces of a cube, each of which is divided
//! into 2^30 × 2^30 cells of about equal size.

use super::vector::Vector;

/// Half the number of cells along a face.
const HALF: f64 = 536_870_912.0;

/// A smallest cell.
#[derive(Debug, Clone, Copy)]
pub(in crate::query::geo) struct Cell {
    face: u8,
    /// Column and row.
    place: (f64, f64),
    /// The lower corner on the face, and the upper one.
    corners: [(f64, f64); 2],
}

impl Cell {
    /// Returns the cell that a point is in.
    pub(in crate::query::geo) fn of(point: Vector) -> Self {
        let face = face(point);
        let (u, v) = on_face(face, point);
        let place = (index(u), index(v));
        let corner = |offset: f64| (coordinate(place.0 + offset), coordinate(place.1 + offset));
        Self { face, place, corners: [corner(0.0), corner(1.0)] }
    }

    pub(in crate::query::geo) fn is(self, other: Self) -> bool {
        self.face == other.face && self.place == other.place
    }

    /// Returns the corners, going left around.
    pub(super) fn vertices(self) -> [Vector; 4] {
        let [low, high] = self.corners;
        [(low.0, low.1), (high.0, low.1), (high.0, high.1), (low.0, high.1)]
            .map(|(u, v)| in_space(self.face, u, v).unit())
    }

    /// Returns whether a point is in the cell or on its edge.
    pub(super) fn contains(self, point: Vector) -> bool {
        let [low, high] = self.corners;
        let height = match self.face {
            0 => point.x,
            1 => point.y,
            2 => point.z,
            3 => -point.x,
            4 => -point.y,
            _ => -point.z,
        };
        let (u, v) = on_face(self.face, point);
        height > 0.0 && (low.0..=high.0).contains(&u) && (low.1..=high.1).contains(&v)
    }
}

fn face(point: Vector) -> u8 {
    match point.largest() {
        0 => {
            if point.x < 0.0 {
                3
            } else {
                0
            }
        }
        1 => {
            if point.y < 0.0 {
                4
            } else {
                1
            }
        }
        _ => {
            if point.z < 0.0 {
                5
            } else {
                2
            }
        }
    }
}

/// Where a ray meets the plane of a face.
fn on_face(face: u8, Vector { x, y, z }: Vector) -> (f64, f64) {
    match face {
        0 => (y / x, z / x),
        1 => (-x / y, z / y),
        2 => (-x / z, -y / z),
        3 => (z / x, y / x),
        4 => (z / y, -x / y),
        _ => (-y / z, -x / z),
    }
}

fn in_space(face: u8, u: f64, v: f64) -> Vector {
    match face {
        0 => Vector::new(1.0, u, v),
        1 => Vector::new(-u, 1.0, v),
        2 => Vector::new(-u, -v, 1.0),
        3 => Vector::new(-1.0, -v, -u),
        4 => Vector::new(v, -1.0, -u),
        _ => Vector::new(v, u, -1.0),
    }
}

/// Returns the column or row of a coordinate of a face.
fn index(u: f64) -> f64 {
    let s = if u >= 0.0 { (1.0 + 3.0 * u).sqrt() - 1.0 } else { 1.0 - (1.0 - 3.0 * u).sqrt() };
    (HALF * s + (HALF - 0.5)).round_ties_even().clamp(0.0, 2.0 * HALF - 1.0)
}

/// Where a column or row begins.
fn coordinate(index: f64) -> f64 {
    let s = (index - HALF) / HALF;
    let square = if s >= 0.0 { (1.0 + s) * (1.0 + s) - 1.0 } else { 1.0 - (1.0 - s) * (1.0 - s) };
    square / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_in_its_cell_which_is_as_wide_as_a_finger() {
        for (longitude, latitude) in [(0.0, 0.0), (8.5, 50.1), (-120.0, -33.0), (179.9, 89.0), (90.0, -90.0)] {
            let point = Vector::at(longitude, latitude);
            let cell = Cell::of(point);
            assert!(cell.contains(point), "{longitude} {latitude}");
            for vertex in cell.vertices() {
                assert!(vertex.angle(point) * 6_378_100.0 < 0.02);
            }
            assert!(!cell.is(Cell::of(Vector::at(longitude, latitude * 0.999 - 0.001))));
        }
    }
}
