//! How deep the origin is in a convex set that is known by its support function.

use super::support::Difference;
use crate::formats::scene::pose::{cross, dot, norm, sub};

/// Rounds at most; curved surfaces take some hundred.
const ROUNDS: usize = 1_000;

/// A triangle of the growing polytope, its corners counter-clockwise from outside.
struct Face {
    corners: [usize; 3],
    normal: [f64; 3],
    /// Of its plane to the origin.
    distance: f64,
}

/// Lets a polytope inside the set grow where it is nearest to the origin, until it does not.
pub(super) fn depth(set: &Difference<'_>, simplex: Vec<[f64; 3]>) -> f64 {
    let Some(mut points) = tetrahedron(set, simplex) else { return 0.0 };
    let mut faces: Vec<Face> = Vec::new();
    for corners in [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] {
        faces.push(face(&points, corners));
    }
    let mut depth = 0.0;
    for _ in 0..ROUNDS {
        let Some(nearest) = faces.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)) else { return depth };
        let (normal, distance) = (nearest.normal, nearest.distance);
        depth = f64::max(depth, distance);
        let next = set.support(normal);
        if dot(next, normal) - distance <= 1e-10 * (1.0 + distance) {
            return depth.max(0.0);
        }
        points.push(next);
        if !grow(&mut faces, &points) {
            return depth.max(0.0);
        }
    }
    depth.max(0.0)
}

/// Takes away the faces that see the last point, and joins the edges of the hole with it.
fn grow(faces: &mut Vec<Face>, points: &[[f64; 3]]) -> bool {
    let last = points.len() - 1;
    let mut edges: Vec<[usize; 2]> = Vec::new();
    faces.retain(|face| {
        let sees = dot(face.normal, sub(points[last], points[face.corners[0]])) > 1e-13;
        if sees {
            let [a, b, c] = face.corners;
            for edge in [[a, b], [b, c], [c, a]] {
                // An edge between two faces that go is inside the hole.
                match edges.iter().position(|other| *other == [edge[1], edge[0]]) {
                    Some(other) => drop(edges.swap_remove(other)),
                    None => edges.push(edge),
                }
            }
        }
        !sees
    });
    for [a, b] in &edges {
        faces.push(face(points, [*a, *b, last]));
    }
    !edges.is_empty()
}

fn face(points: &[[f64; 3]], corners: [usize; 3]) -> Face {
    let [a, b, c] = corners.map(|corner| points[corner]);
    let across = cross(sub(b, a), sub(c, a));
    let length = norm(&across);
    if length < 1e-18 {
        // No area, no normal: nothing grows from it.
        return Face { corners, normal: [0.0; 3], distance: f64::INFINITY };
    }
    let normal = across.map(|part| part / length);
    Face { corners, normal, distance: dot(normal, a) }
}

/// Four points of the set with the origin among them, from the one to four that are known. There
/// are none where the set is flat.
fn tetrahedron(set: &Difference<'_>, mut points: Vec<[f64; 3]>) -> Option<Vec<[f64; 3]>> {
    let directions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    while points.len() < 4 {
        let candidates: Vec<[f64; 3]> = match points[..] {
            [a, b] => directions.iter().map(|axis| cross(sub(b, a), *axis)).collect(),
            [a, b, c] => vec![cross(sub(b, a), sub(c, a))],
            _ => directions.to_vec(),
        };
        let both = candidates.iter().flat_map(|candidate| [*candidate, candidate.map(|part| -part)]);
        let next = both
            .map(|direction| set.support(direction))
            .max_by(|a, b| spread(&points, *a).total_cmp(&spread(&points, *b)))?;
        if spread(&points, next) < 1e-12 {
            return None;
        }
        points.push(next);
    }
    // Faces are counter-clockwise from outside where the fourth point is behind the first three.
    let [a, b, c, d] = points[..] else { return None };
    if dot(cross(sub(b, a), sub(c, a)), sub(d, a)) > 0.0 {
        points.swap(1, 2);
    }
    Some(points)
}

/// How far a point is from the hull of the others: length, area or volume.
fn spread(points: &[[f64; 3]], next: [f64; 3]) -> f64 {
    match points {
        [a] => norm(&sub(next, *a)),
        [a, b] => norm(&cross(sub(*b, *a), sub(next, *a))),
        [a, b, c] => dot(cross(sub(*b, *a), sub(*c, *a)), sub(next, *a)).abs(),
        _ => 1.0,
    }
}
