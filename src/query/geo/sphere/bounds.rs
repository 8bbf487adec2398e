//! Rectangles of latitudes and longitudes around rings.
//!
//! Whether rings touch is asked of their rectangles first, as in S2: of edges that lie on one great circle far from
//! each other, rounding alone would decide.

use std::f64::consts::{FRAC_PI_2, PI};

use super::vector::Vector;

const NORTH: Vector = Vector::new(0.0, 0.0, 1.0);
const SOUTH: Vector = Vector::new(0.0, 0.0, -1.0);
/// An edge that comes so close to a pole may pass it on either side, in radians.
const AT_POLE: f64 = 1e-15;

/// The latitudes and longitudes of what is around something, in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    south: f64,
    north: f64,
    longitudes: Longitudes,
}

/// An interval of longitudes, going east.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Longitudes {
    All,
    /// Where the first is greater, it goes over 180°.
    Between(f64, f64),
}

impl Bounds {
    /// All of the sphere.
    pub(super) const ALL: Self = Self { south: -FRAC_PI_2, north: FRAC_PI_2, longitudes: Longitudes::All };

    /// Returns the rectangle around a ring, which has the poles as `has` says.
    pub(super) fn around(edges: impl Iterator<Item = (Vector, Vector)>, has: impl Fn(Vector) -> bool) -> Self {
        let around_edges = edges.map(|(a, b)| Self::around_edge(a, b)).reduce(Self::and);
        let mut bounds = around_edges.unwrap_or(Self::ALL);
        if has(NORTH) {
            bounds = Self { north: FRAC_PI_2, longitudes: Longitudes::All, ..bounds };
        }
        // A ring around the south pole has all longitudes.
        if bounds.longitudes == Longitudes::All && has(SOUTH) {
            bounds.south = -FRAC_PI_2;
        }
        bounds
    }

    fn around_edge(a: Vector, b: Vector) -> Self {
        let ((latitude_a, longitude_a), (latitude_b, longitude_b)) = (place(a), place(b));
        let mut bounds = Self {
            south: latitude_a.min(latitude_b),
            north: latitude_a.max(latitude_b),
            longitudes: Longitudes::shortest(longitude_a, longitude_b),
        };
        // The edge may come closest to a pole between its ends.
        let normal = a.normal(b);
        let ahead = normal.cross(NORTH);
        let (at_a, at_b) = (ahead.dot(a), ahead.dot(b));
        if at_a * at_b < 0.0 {
            let latitude = (normal.z / normal.length()).abs().acos();
            if at_a < 0.0 {
                bounds.north = bounds.north.max(latitude);
            } else {
                bounds.south = bounds.south.min(-latitude);
            }
            if latitude >= FRAC_PI_2 - AT_POLE {
                bounds.longitudes = Longitudes::All;
            }
        }
        bounds
    }

    fn and(self, other: Self) -> Self {
        Self {
            south: self.south.min(other.south),
            north: self.north.max(other.north),
            longitudes: self.longitudes.and(other.longitudes),
        }
    }

    pub(super) fn contains(self, other: Self) -> bool {
        self.south <= other.south && other.north <= self.north && self.longitudes.contains(other.longitudes)
    }

    pub(super) fn meets(self, other: Self) -> bool {
        self.south <= other.north && other.south <= self.north && self.longitudes.meets(other.longitudes)
    }
}

/// Latitude and longitude.
fn place(point: Vector) -> (f64, f64) {
    let longitude = point.y.atan2(point.x);
    // The one meridian that has two names.
    let longitude = if longitude == -PI { PI } else { longitude };
    (point.z.atan2(point.x.hypot(point.y)), longitude)
}

/// How far it is to go east.
fn eastward(from: f64, to: f64) -> f64 {
    let distance = to - from;
    if distance >= 0.0 { distance } else { (to + PI) - (from - PI) }
}

impl Longitudes {
    /// Returns the shorter way around.
    fn shortest(a: f64, b: f64) -> Self {
        if eastward(a, b) <= PI { Self::Between(a, b) } else { Self::Between(b, a) }
    }

    fn has(self, longitude: f64) -> bool {
        match self {
            Self::All => true,
            Self::Between(west, east) if west <= east => (west..=east).contains(&longitude),
            Self::Between(west, east) => longitude >= west || longitude <= east,
        }
    }

    fn contains(self, other: Self) -> bool {
        match (self, other) {
            (Self::All, _) => true,
            (_, Self::All) => false,
            // Both ends, and not the long way from one to the other.
            (Self::Between(west, _), Self::Between(start, end)) => {
                self.has(start) && self.has(end) && eastward(west, start) <= eastward(west, end)
            }
        }
    }

    fn meets(self, other: Self) -> bool {
        match (self, other) {
            (Self::All, _) | (_, Self::All) => true,
            (Self::Between(west, _), Self::Between(start, _)) => self.has(start) || other.has(west),
        }
    }

    /// Returns the shortest interval around both.
    fn and(self, other: Self) -> Self {
        let (Self::Between(west, east), Self::Between(start, end)) = (self, other) else { return Self::All };
        match (self.has(start), self.has(end)) {
            (true, true) if self.contains(other) => self,
            (true, true) => Self::All,
            (true, false) => Self::Between(west, end),
            (false, true) => Self::Between(start, east),
            (false, false) if other.has(west) => other,
            (false, false) if eastward(end, west) < eastward(east, start) => Self::Between(start, east),
            (false, false) => Self::Between(west, end),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around(corners: &[(f64, f64)]) -> Bounds {
        let points: Vec<Vector> = corners.iter().map(|(x, y)| Vector::at(*x, *y)).collect();
        let edges = points.iter().copied().zip(points.iter().copied().cycle().skip(1));
        Bounds::around(edges.take(points.len()), |_| false)
    }

    fn square(low: f64, high: f64) -> Bounds {
        around(&[(low, low), (high, low), (high, high), (low, high)])
    }

    #[test]
    fn rectangles_contain_and_meet() {
        let (large, small, far) = (square(0.0, 10.0), square(2.0, 4.0), square(20.0, 30.0));
        assert!(large.contains(small) && !small.contains(large) && !large.contains(far));
        assert!(large.meets(small) && small.meets(large) && !large.meets(far));
        // An edge from corner to corner bends towards the pole.
        let broad = around(&[(-60.0, 0.0), (60.0, 0.0), (60.0, 40.0), (-60.0, 40.0)]);
        assert!(broad.contains(square(40.0, 50.0)));
    }

    #[test]
    fn rectangles_go_over_the_line_where_longitudes_begin_again() {
        let over = around(&[(170.0, 0.0), (-170.0, 0.0), (-170.0, 10.0), (170.0, 10.0)]);
        let (west, east) = (
            around(&[(171.0, 1.0), (175.0, 1.0), (173.0, 5.0)]),
            around(&[(-175.0, 1.0), (-171.0, 1.0), (-173.0, 5.0)]),
        );
        assert!(over.contains(west) && over.contains(east) && over.meets(west));
        assert!(!over.meets(square(0.0, 10.0)) && !west.meets(east));
    }
}
