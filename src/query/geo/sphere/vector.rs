//! Points of the sphere as unit vectors, and which way three of them turn.
//!
//! The arithmetic follows what S2 (the library that MongoDB uses) does in
//! doubles, so that points on the very edge of something fall on the same side.

use std::cmp::Ordering;
use std::ops::{Add, Mul, Neg, Sub};

/// A determinant this far from zero has the right sign.
const DETERMINANT_ERROR: f64 = 0.8e-15;

/// A vector in space; mostly of length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::query::geo) struct Vector {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
}

impl Vector {
    /// Returns the point at a longitude and latitude in degrees.
    pub(in crate::query::geo) fn at(longitude: f64, latitude: f64) -> Self {
        let (theta, phi) = (longitude.to_radians(), latitude.to_radians());
        Self { x: theta.cos() * phi.cos(), y: theta.sin() * phi.cos(), z: phi.sin() }
    }

    pub(super) const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { x, y, z }
    }

    pub(super) fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    pub(super) fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    /// Returns the square of the length.
    pub(super) fn square(self) -> f64 {
        self.dot(self)
    }

    pub(super) fn length(self) -> f64 {
        self.square().sqrt()
    }

    /// Returns the same direction with length 1.
    pub(super) fn unit(self) -> Self {
        let length = self.length();
        if length == 0.0 { self } else { self * (1.0 / length) }
    }

    /// Returns the angle between two vectors, in radians.
    pub(in crate::query::geo) fn angle(self, other: Self) -> f64 {
        self.cross(other).length().atan2(self.dot(other))
    }

    /// Returns a vector at right angles to both, exact also where they are nearly parallel.
    pub(super) fn normal(self, other: Self) -> Self {
        let normal = (other + self).cross(other - self);
        if normal == Self::new(0.0, 0.0, 0.0) { self.orthogonal() } else { normal }
    }

    /// Some unit vector at right angles to this one, always the same.
    pub(super) fn orthogonal(self) -> Self {
        let (mut x, mut y, mut z) = (0.012, 0.0053, 0.00457);
        match self.largest() {
            0 => z = 1.0,
            1 => x = 1.0,
            _ => y = 1.0,
        }
        self.cross(Self::new(x, y, z)).unit()
    }

    /// Which component is the largest, without its sign.
    pub(super) fn largest(self) -> usize {
        let (x, y, z) = (self.x.abs(), self.y.abs(), self.z.abs());
        match (x > y, x > z, y > z) {
            (true, true, _) => 0,
            (false, _, true) => 1,
            _ => 2,
        }
    }

    /// Order by components.
    pub(super) fn before(self, other: Self) -> bool {
        let order = self.x.total_cmp(&other.x).then(self.y.total_cmp(&other.y)).then(self.z.total_cmp(&other.z));
        order == Ordering::Less
    }
}

impl Add for Vector {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl Sub for Vector {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Neg for Vector {
    type Output = Self;

    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl Mul<f64> for Vector {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

/// Which way the path A, B, C turns: 1 left, -1 right, and 0 only where two of the points are one.
pub(super) fn turn(a: Vector, b: Vector, c: Vector) -> i8 {
    let determinant = a.cross(b).dot(c);
    if determinant > DETERMINANT_ERROR {
        1
    } else if determinant < -DETERMINANT_ERROR {
        -1
    } else {
        close_turn(a, b, c)
    }
}

/// [`turn`] of points that are nearly on one great circle: by the differences of the
/// points, from the one opposite the longest edge.
fn close_turn(a: Vector, b: Vector, c: Vector) -> i8 {
    if a == b || b == c || c == a {
        return 0;
    }
    let side = |p: Vector, q: Vector| if p.dot(q) > 0.0 { -1.0 } else { 1.0 };
    let (side_ab, side_bc, side_ca) = (side(a, b), side(b, c), side(c, a));
    let (ab, bc, ca) = (a + b * side_ab, b + c * side_bc, c + a * side_ca);
    let (length_ab, length_bc, length_ca) = (ab.square(), bc.square(), ca.square());
    let shorter = |one: f64, other: f64, tie: bool| one < other || (one == other && tie);
    let from_c = || ca.cross(bc).dot(c) * side_ca;
    let determinant = if shorter(length_ca, length_bc, a.before(b)) {
        if shorter(length_ab, length_bc, a.before(c)) { ab.cross(ca).dot(a) * side_ab } else { from_c() }
    } else if shorter(length_ab, length_ca, b.before(c)) {
        bc.cross(ab).dot(b) * side_bc
    } else {
        from_c()
    };
    match sign(determinant) {
        0 => moved_turn(a, b, c),
        turn => turn,
    }
}

/// [`turn`] of points on one great circle: as if all of them were moved by a vector
/// too small to see, which is how they lie in each coordinate plane.
fn moved_turn(a: Vector, b: Vector, c: Vector) -> i8 {
    let planes: [fn(Vector) -> (f64, f64); 3] = [|v| (v.y, v.z), |v| (v.z, v.x), |v| (v.x, v.y)];
    let turns = planes.map(|plane| {
        let (a, b, c) = (plane(a), plane(b), plane(c));
        (planar_turn(a, b) + planar_turn(b, c) + planar_turn(c, a)).signum()
    });
    turns.into_iter().find(|turn| *turn != 0).unwrap_or(0)
}

/// Which way B lies of A, seen from the origin of a plane.
fn planar_turn(a: (f64, f64), b: (f64, f64)) -> i8 {
    let cross = |p: (f64, f64), q: (f64, f64)| p.0 * q.1 - p.1 * q.0;
    let square = |p: (f64, f64)| p.0 * p.0 + p.1 * p.1;
    let side = if a.0 * b.0 + a.1 * b.1 > 0.0 { -1.0 } else { 1.0 };
    let difference = (a.0 + side * b.0, a.1 + side * b.1);
    let (length_a, length_b) = (square(a), square(b));
    if length_a < length_b || (length_a == length_b && a < b) {
        sign(cross(a, difference) * side)
    } else {
        sign(cross(difference, b))
    }
}

fn sign(value: f64) -> i8 {
    i8::from(value > 0.0) - i8::from(value < 0.0)
}

/// Returns whether A, B, C come in this order going left around O; also where A is B or B is C, not where A is C.
pub(super) fn in_order(a: Vector, b: Vector, c: Vector, o: Vector) -> bool {
    let count = u8::from(turn(b, o, a) >= 0) + u8::from(turn(c, o, b) >= 0) + u8::from(turn(a, o, c) > 0);
    count >= 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_left_and_right_also_on_a_great_circle() {
        let (a, b, c) = (Vector::at(0.0, 0.0), Vector::at(10.0, 0.0), Vector::at(5.0, 5.0));
        assert_eq!(turn(a, b, c), 1);
        assert_eq!(turn(b, a, c), -1);
        let on_equator = Vector::at(20.0, 0.0);
        assert_ne!(turn(a, b, on_equator), 0);
        assert_eq!(turn(a, b, on_equator), -turn(on_equator, b, a));
        assert_eq!(turn(a, b, b), 0);
    }

    #[test]
    fn goes_around_a_point_in_order() {
        let o = Vector::at(0.0, 0.0);
        let (east, north, west) = (Vector::at(1.0, 0.0), Vector::at(0.0, 1.0), Vector::at(-1.0, 0.0));
        assert!(in_order(east, north, west, o));
        assert!(!in_order(west, north, east, o));
        assert!(in_order(east, east, west, o));
        assert!(!in_order(east, north, east, o));
    }
}
