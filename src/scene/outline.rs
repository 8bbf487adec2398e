//! What is seen of a scene from above: the outline of each shape in the plane of x and y.

use crate::formats::scene::{Mesh, Object, Pose, Shape, Solid};

/// Corners of a circle's outline.
const CORNERS: usize = 48;

/// The outlines of an object's shapes, each a convex polygon in the scene's x and y. Planes have none.
#[must_use]
pub fn outlines(object: &Object) -> Vec<Vec<[f64; 2]>> {
    object.shapes.iter().map(|shape| outline(shape, &object.pose)).filter(|outline| outline.len() >= 3).collect()
}

fn outline(shape: &Shape, pose: &Pose) -> Vec<[f64; 2]> {
    let place = pose.around(&shape.pose);
    let points: Vec<[f64; 3]> = match &shape.solid {
        Solid::Box([x, y, z]) => corners([x / 2.0, y / 2.0, z / 2.0]),
        Solid::Sphere(radius) => {
            let [x, y, _] = place.translation;
            return circle(*radius).map(|[cx, cy]| [x + cx, y + cy]).collect();
        }
        Solid::Cylinder { radius, length } => {
            circle(*radius).flat_map(|[x, y]| [[x, y, -length / 2.0], [x, y, length / 2.0]]).collect()
        }
        Solid::Cone { radius, length } => {
            circle(*radius).map(|[x, y]| [x, y, -length / 2.0]).chain([[0.0, 0.0, length / 2.0]]).collect()
        }
        Solid::Mesh(Mesh::Triangles(triangles)) => triangles.vertices.clone(),
        Solid::Mesh(Mesh::File { .. }) | Solid::Plane { .. } => Vec::new(),
    };
    hull(points.into_iter().map(|point| place.place(point)).map(|[x, y, _]| [x, y]).collect())
}

fn corners([x, y, z]: [f64; 3]) -> Vec<[f64; 3]> {
    (0..8)
        .map(|bits| {
            [if bits & 1 == 0 { x } else { -x }, if bits & 2 == 0 { y } else { -y }, if bits & 4 == 0 { z } else { -z }]
        })
        .collect()
}

fn circle(radius: f64) -> impl Iterator<Item = [f64; 2]> {
    (0..CORNERS).map(move |corner| {
        let (sin, cos) = (corner as f64 / CORNERS as f64 * std::f64::consts::TAU).sin_cos();
        [radius * cos, radius * sin]
    })
}

/// The convex hull, counter-clockwise: Andrew's monotone chain.
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..] {
                if turn(a, b, point) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut lower = chain(&mut points.iter().copied());
    lower.extend(chain(&mut points.iter().rev().copied()));
    lower
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::scene::pose::from_rpy;

    #[test]
    fn a_turned_box_is_seen_as_a_turned_rectangle() {
        let turned = Pose::turned(from_rpy([0.0, 0.0, std::f64::consts::FRAC_PI_4]));
        let object = Object {
            pose: turned,
            shapes: vec![Shape::new(Solid::Box([2.0, 2.0, 1.0]), Pose::IDENTITY)],
            ..Object::default()
        };
        let outlines = outlines(&object);
        assert_eq!(outlines.len(), 1);
        let furthest = outlines[0].iter().map(|[x, _]| *x).fold(0.0, f64::max);
        assert!((furthest - 2.0_f64.sqrt()).abs() < 1e-12 && outlines[0].len() == 4, "{outlines:?}");
    }

    #[test]
    fn a_lying_cylinder_is_seen_as_a_rectangle() {
        let lying = Pose::turned(from_rpy([std::f64::consts::FRAC_PI_2, 0.0, 0.0]));
        let solid = Solid::Cylinder { radius: 0.5, length: 4.0 };
        let object = Object { pose: lying, shapes: vec![Shape::new(solid, Pose::IDENTITY)], ..Object::default() };
        let tallest = outlines(&object)[0].iter().map(|[_, y]| *y).fold(0.0, f64::max);
        assert!((tallest - 2.0).abs() < 1e-12);
    }
}
