//! Inertia of objects, for formats that want it beside the mass.
//!
//! Solids are of one density; where they overlap, that counts twice. Of meshes and planes only
//! a small cube is known. Moments are about the centre of mass, in the object's orientation.

use super::pose::sub;
use super::{Object, Shape, Solid};

/// How mass is distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// The centre of mass in the object's frame.
    pub center: [f64; 3],
    /// ixx, ixy, ixz, iyy, iyz, izz in kg m².
    pub moments: [f64; 6],
}

/// The edge of the cube that stands for what has no volume, in metres.
const CUBE: f64 = 0.1;

/// The inertia of an object of this mass.
#[must_use]
pub fn inertia(object: &Object, mass: f64) -> Inertia {
    let cube = [Shape::new(Solid::Box([CUBE; 3]), super::Pose::IDENTITY)];
    let shapes = if object.shapes.is_empty() { &cube[..] } else { &object.shapes };
    let total: f64 = shapes.iter().map(|shape| volume(&shape.solid)).sum();
    let share = |shape: &Shape| mass * volume(&shape.solid) / total;
    let mut center = [0.0; 3];
    for shape in shapes {
        let own = shape.pose.place(centroid(&shape.solid));
        for (sum, part) in center.iter_mut().zip(own) {
            *sum += part * share(shape) / mass;
        }
    }
    let mut matrix = [[0.0; 3]; 3];
    for shape in shapes {
        let own = turned(shape, share(shape));
        let away = sub(shape.pose.place(centroid(&shape.solid)), center);
        let square: f64 = away.iter().map(|part| part * part).sum();
        for (row, line) in matrix.iter_mut().enumerate() {
            for (column, cell) in line.iter_mut().enumerate() {
                let diagonal = if row == column { square } else { 0.0 };
                *cell += own[row][column] + share(shape) * (diagonal - away[row] * away[column]);
            }
        }
    }
    let [[xx, xy, xz], [_, yy, yz], [.., zz]] = matrix;
    Inertia { center, moments: [xx, xy, xz, yy, yz, zz] }
}

/// The share of the mass that each shape has, by volume.
#[must_use]
pub fn masses(object: &Object, mass: f64) -> Vec<f64> {
    let total: f64 = object.shapes.iter().map(|shape| volume(&shape.solid)).sum();
    object.shapes.iter().map(|shape| mass * volume(&shape.solid) / total).collect()
}

fn volume(solid: &Solid) -> f64 {
    use std::f64::consts::PI;
    match solid {
        Solid::Box([x, y, z]) => x * y * z,
        Solid::Sphere(radius) => 4.0 / 3.0 * PI * radius.powi(3),
        Solid::Cylinder { radius, length } => PI * radius * radius * length,
        Solid::Cone { radius, length } => PI * radius * radius * length / 3.0,
        Solid::Plane { .. } | Solid::Mesh(_) => CUBE.powi(3),
    }
}

fn centroid(solid: &Solid) -> [f64; 3] {
    match solid {
        // A quarter of the length above the base.
        Solid::Cone { length, .. } => [0.0, 0.0, -length / 4.0],
        _ => [0.0; 3],
    }
}

/// The principal moments of a solid, turned as its shape is.
fn turned(shape: &Shape, mass: f64) -> [[f64; 3]; 3] {
    let principal = match &shape.solid {
        Solid::Box([x, y, z]) => [y * y + z * z, x * x + z * z, x * x + y * y].map(|sum| mass * sum / 12.0),
        Solid::Sphere(radius) => [0.4 * mass * radius * radius; 3],
        Solid::Cylinder { radius, length } => {
            let across = mass * (3.0 * radius * radius + length * length) / 12.0;
            [across, across, mass * radius * radius / 2.0]
        }
        Solid::Cone { radius, length } => {
            let across = mass * (0.15 * radius * radius + 0.0375 * length * length);
            [across, across, 0.3 * mass * radius * radius]
        }
        Solid::Plane { .. } | Solid::Mesh(_) => [mass * CUBE * CUBE / 6.0; 3],
    };
    let matrix = shape.pose.matrix();
    let mut out = [[0.0; 3]; 3];
    for (row, line) in out.iter_mut().enumerate() {
        for (column, cell) in line.iter_mut().enumerate() {
            *cell = (0..3).map(|axis| matrix[row][axis] * principal[axis] * matrix[column][axis]).sum();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::scene::Pose;

    #[test]
    fn two_halves_of_a_box_are_as_inert_as_the_whole() {
        let half =
            |x: f64| Shape::new(Solid::Box([1.0, 2.0, 3.0]), Pose { translation: [x, 0.0, 0.0], ..Pose::IDENTITY });
        let whole =
            Object { shapes: vec![Shape::new(Solid::Box([2.0, 2.0, 3.0]), Pose::IDENTITY)], ..Object::default() };
        let halves = Object { shapes: vec![half(-0.5), half(0.5)], ..Object::default() };
        let (whole, halves) = (inertia(&whole, 6.0), inertia(&halves, 6.0));
        assert_eq!(whole.moments, [6.5, 0.0, 0.0, 6.5, 0.0, 4.0]);
        let apart: f64 = whole.moments.iter().zip(halves.moments).map(|(a, b)| (a - b).abs()).sum();
        assert!(apart < 1e-12 && halves.center == [0.0; 3], "{halves:?}");
    }
}
