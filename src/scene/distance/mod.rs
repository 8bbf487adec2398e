//! How far apart two solids are, or how deep one is in the other.
//!
//! Solids are convex; of a mesh it is the convex hull that counts, and a plane is solid below. The distance is
//! found by the algorithm of Gilbert, Johnson and Keerthi (1988) and the depth by the expanding polytope of van
//! den Bergen (2001), both over the Minkowski difference. Spheres are points with a margin, so that they are exact.

mod gjk;
mod penetration;
mod support;

pub use support::Body;

use support::Difference;

/// The distance in metres; where the solids overlap, the depth as a negative number: the
/// shortest way that brings them apart.
#[must_use]
pub fn distance(a: &Body, b: &Body) -> f64 {
    match (a.plane(), b.plane()) {
        (None, None) => convex(a, b),
        (Some((normal, offset)), None) => b.lowest(normal) - offset,
        (None, Some((normal, offset))) => a.lowest(normal) - offset,
        (Some(one), Some(other)) => planes(one, other),
    }
}

fn convex(a: &Body, b: &Body) -> f64 {
    let difference = Difference { a, b };
    let cores = match gjk::distance(&difference) {
        gjk::Answer::Apart(distance) => distance,
        gjk::Answer::Overlapping(simplex) => -penetration::depth(&difference, simplex),
    };
    cores - a.margin() - b.margin()
}

/// Half spaces overlap without end, unless they look away from each other.
fn planes((normal, offset): ([f64; 3], f64), (other, other_offset): ([f64; 3], f64)) -> f64 {
    let dot: f64 = normal.iter().zip(other).map(|(a, b)| a * b).sum();
    if dot < -1.0 + 1e-12 { -offset - other_offset } else { f64::NEG_INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::scene::{Pose, Shape, Solid};

    fn body(solid: Solid, translation: [f64; 3]) -> Body {
        Body::new(&Shape::new(solid, Pose::IDENTITY), &Pose { translation, ..Pose::IDENTITY })
    }

    #[test]
    fn distances_and_depths_along_an_axis_are_exact() {
        let cylinder = Solid::Cylinder { radius: 0.5, length: 2.0 };
        let cube = Solid::Box([1.0; 3]);
        for (a, b, apart, expected) in [
            (cube.clone(), cube.clone(), [2.0, 0.0, 0.0], 1.0),
            (cube.clone(), cube.clone(), [0.9, 0.0, 0.0], -0.1),
            (cube.clone(), cube.clone(), [0.0, 0.0, 0.0], -1.0),
            (cube.clone(), cube.clone(), [1.0, 0.0, 0.0], 0.0),
            (Solid::Sphere(0.5), Solid::Sphere(0.25), [0.0, 2.0, 0.0], 1.25),
            (Solid::Sphere(0.5), Solid::Sphere(0.25), [0.0, 0.5, 0.0], -0.25),
            (Solid::Sphere(0.5), Solid::Sphere(0.25), [0.0, 0.0, 0.0], -0.75),
            (Solid::Sphere(0.5), cube.clone(), [0.0, 0.0, 1.5], 0.5),
            (Solid::Sphere(0.5), cube.clone(), [0.0, 0.0, 0.0], -1.0),
            (cylinder.clone(), cube.clone(), [0.0, 0.0, 2.0], 0.5),
            (cylinder.clone(), cube.clone(), [0.0, 0.0, 1.4], -0.1),
            (cylinder.clone(), cylinder.clone(), [1.5, 0.0, 0.0], 0.5),
            (cylinder.clone(), cylinder, [0.6, 0.0, 0.0], -0.4),
            (Solid::Cone { radius: 1.0, length: 2.0 }, Solid::Sphere(0.5), [0.0, 0.0, 2.0], 0.5),
            (Solid::Plane { normal: [0.0, 0.0, 1.0], offset: 0.5 }, cube.clone(), [0.0, 0.0, 2.0], 1.0),
            (Solid::Plane { normal: [0.0, 0.0, 1.0], offset: 0.5 }, cube, [0.0, 0.0, 0.9], -0.1),
        ] {
            let found = distance(&body(a.clone(), [0.0; 3]), &body(b.clone(), apart));
            assert!((found - expected).abs() < 1e-9, "{a:?} {b:?} {apart:?}: {found}, expected {expected}");
            let found = distance(&body(b, apart), &body(a, [0.0; 3]));
            assert!((found - expected).abs() < 1e-9, "the other way round: {found}");
        }
    }
}
