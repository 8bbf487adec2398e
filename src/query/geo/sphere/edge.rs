//! Edges: the shortest way between two points, and where two of them meet.

use super::vector::{Vector, in_order, turn};

/// How two edges meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    /// In a point inside of both.
    Crossing,
    /// In a point where one of both ends.
    Vertex,
    Apart,
}

/// How the edges AB and CD meet.
pub(super) fn meeting(a: Vector, b: Vector, c: Vector, d: Vector) -> Meeting {
    // Edges cross where the triangles ACB, CBD, BDA and DAC all turn the same way.
    let (acb, bda) = (-turn(a, b, c), turn(a, b, d));
    if bda != 0 && bda == -acb {
        Meeting::Apart
    } else if acb == 0 || bda == 0 {
        Meeting::Vertex
    } else if -turn(c, d, b) == acb && turn(c, d, a) == acb {
        Meeting::Crossing
    } else {
        Meeting::Apart
    }
}

/// Returns whether edges that share a vertex count as crossing there: of all edges that end in
/// a vertex, as many on each side of a path through it.
pub(super) fn crosses_in_vertex(a: Vector, b: Vector, c: Vector, d: Vector) -> bool {
    if a == b || c == d {
        false
    } else if a == d {
        in_order(a.orthogonal(), c, b, a)
    } else if b == c {
        in_order(b.orthogonal(), d, a, b)
    } else if a == c {
        in_order(a.orthogonal(), d, b, a)
    } else if b == d {
        in_order(b.orthogonal(), c, a, b)
    } else {
        false
    }
}

/// Returns whether going along AB passes over CD.
pub(super) fn passes(a: Vector, b: Vector, c: Vector, d: Vector) -> bool {
    match meeting(a, b, c, d) {
        Meeting::Crossing => true,
        Meeting::Vertex => crosses_in_vertex(a, b, c, d),
        Meeting::Apart => false,
    }
}

/// Returns the point in which two edges cross.
pub(super) fn crossing(a: (Vector, Vector), b: (Vector, Vector)) -> Vector {
    let (normal_a, normal_b) = (a.0.normal(a.1).unit(), b.0.normal(b.1).unit());
    let mut point = normal_a.normal(normal_b).unit();
    if point.dot((a.0 + a.1) + (b.0 + b.1)) < 0.0 {
        point = -point;
    }
    let on_a = |point| in_order(a.0, point, a.1, normal_a);
    let on_b = |point| in_order(b.0, point, b.1, normal_b);
    if on_a(point) && on_b(point) {
        return point;
    }
    // Nearly parallel: the closest end of one that lies on the other.
    let ends = [a.0, a.1].into_iter().filter(|end| on_b(*end)).chain([b.0, b.1].into_iter().filter(|end| on_a(*end)));
    ends.min_by(|p, q| (point - *p).square().total_cmp(&(point - *q).square())).unwrap_or(point)
}

/// Returns the angle from a point to the closest point of some edges. Which edge that is on is
/// found as S2 finds it, which beyond a quarter of the sphere can be the wrong one.
pub(super) fn distance(point: Vector, edges: impl Iterator<Item = (Vector, Vector)>) -> f64 {
    let closest_edge =
        edges.min_by(|(a, b), (c, d)| rough_distance(point, *a, *b).total_cmp(&rough_distance(point, *c, *d)));
    closest_edge.map_or(f64::INFINITY, |(a, b)| point.angle(closest(point, a, b)))
}

/// Returns the angle from a point to an edge, good for small ones.
fn rough_distance(point: Vector, a: Vector, b: Vector) -> f64 {
    let normal = a.normal(b);
    if left(normal, a, point) && left(point, b, normal) {
        return (point.dot(normal).abs() / normal.length()).min(1.0).asin();
    }
    let square = (point - a).square().min((point - b).square());
    2.0 * (0.5 * square.sqrt()).min(1.0).asin()
}

/// Returns the point of the edge that is closest.
fn closest(point: Vector, a: Vector, b: Vector) -> Vector {
    let normal = a.normal(b);
    let on_circle = point - normal * (point.dot(normal) / normal.square());
    if left(normal, a, on_circle) && left(on_circle, b, normal) {
        on_circle.unit()
    } else if (point - a).square() <= (point - b).square() {
        a
    } else {
        b
    }
}

fn left(a: Vector, b: Vector, c: Vector) -> bool {
    c.cross(a).dot(b) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_cross_touch_or_are_apart() {
        let at = Vector::at;
        assert_eq!(meeting(at(0.0, -1.0), at(0.0, 1.0), at(-1.0, 0.0), at(1.0, 0.0)), Meeting::Crossing);
        assert_eq!(meeting(at(0.0, -1.0), at(0.0, 1.0), at(0.0, 1.0), at(1.0, 0.0)), Meeting::Vertex);
        assert_eq!(meeting(at(0.0, -1.0), at(0.0, 1.0), at(2.0, 0.0), at(1.0, 0.0)), Meeting::Apart);
        let found = crossing((at(0.0, -1.0), at(0.0, 1.0)), (at(-1.0, 0.0), at(1.0, 0.0)));
        assert!(found.angle(at(0.0, 0.0)) < 1e-15);
    }

    #[test]
    fn the_closest_point_is_on_the_edge_or_one_of_its_ends() {
        let (a, b) = (Vector::at(0.0, 0.0), Vector::at(10.0, 0.0));
        assert!(closest(Vector::at(5.0, 3.0), a, b).angle(Vector::at(5.0, 0.0)) < 1e-15);
        assert_eq!(closest(Vector::at(20.0, 3.0), a, b), b);
    }
}
