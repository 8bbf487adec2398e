//! Rings: closed lines, and what lies to their left.

use std::f64::consts::PI;

use super::bounds::Bounds;
use super::edge::{Meeting, meeting, passes};
use super::vector::{Vector, in_order, turn};

/// A point that is no vertex of any ring. A point is inside a ring if the edge from here to it crosses the ring an odd
/// number of times.
const ORIGIN: Vector = Vector::new(0.004_567_620_772_30, 0.999_474_766_130_78, 0.032_083_153_029_33);
/// Turning angles below this count as zero, so that half of the sphere counts as the smaller part.
const TURN_ERROR: f64 = 1e-14;
/// Margin of the circle around a ring, which only rejects distant points early.
const MARGIN: f64 = 1e-6;

/// A ring of at least three different vertices.
#[derive(Debug, Clone)]
pub(super) struct Ring {
    vertices: Vec<Vector>,
    /// Whether [`ORIGIN`] is inside.
    has_origin: bool,
    /// A centre and the least cosine of any point in or on the ring, where it is small.
    around: Option<(Vector, f64)>,
    bounds: Bounds,
}

/// A vertex that two rings share, with the vertices before and after it in both.
#[derive(Debug, Clone, Copy)]
struct Shared {
    vertex: Vector,
    own: (Vector, Vector),
    other: (Vector, Vector),
}

/// How the insides of two rings lie at a vertex that they share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wedge {
    Same,
    Contains,
    Contained,
    Overlaps,
    Apart,
}

impl Ring {
    /// Returns the ring with its inside to the left.
    pub(super) fn new(vertices: Vec<Vector>) -> Self {
        let mut ring = Self { vertices, has_origin: false, around: None, bounds: Bounds::ALL };
        if let [first, second, third, ..] = *ring.vertices.as_slice() {
            let inside = in_order(second.orthogonal(), first, third, second);
            ring.has_origin = inside != ring.has(second);
            ring.bounds = Bounds::around(ring.edges(), |pole| ring.has(pole));
        }
        ring
    }

    /// Returns the ring around the smaller part of the sphere; half of it is left as it is.
    pub(super) fn around_less(self) -> Self {
        let mut ring = if self.is_less() { self } else { self.inverted() };
        ring.around = ring.circle();
        ring
    }

    /// Returns whether the inside is at most half of the sphere.
    pub(super) fn is_less(&self) -> bool {
        let turns = self.wedges().map(|(a, b, c)| {
            let angle = b.normal(a).angle(c.normal(b));
            if turn(a, b, c) > 0 { angle } else { -angle }
        });
        turns.sum::<f64>() >= -TURN_ERROR
    }

    pub(super) fn inverted(&self) -> Self {
        Self::new(self.vertices.iter().rev().copied().collect())
    }

    /// Returns a circle around the ring that is less than half of the sphere, so that its inside is in it too.
    fn circle(&self) -> Option<(Vector, f64)> {
        let sum = self.vertices.iter().fold(Vector::new(0.0, 0.0, 0.0), |sum, vertex| sum + *vertex);
        let centre = sum.unit();
        let radius = self.vertices.iter().map(|vertex| vertex.angle(centre)).fold(0.0, f64::max) + MARGIN;
        (radius < PI / 2.0 - MARGIN).then(|| (centre, radius.cos()))
    }

    /// Returns whether a point is so far off that it is neither in nor on the ring.
    pub(super) fn is_far_from(&self, point: Vector) -> bool {
        self.around.is_some_and(|(centre, cosine)| centre.dot(point) < cosine)
    }

    pub(super) fn edges(&self) -> impl Iterator<Item = (Vector, Vector)> + Clone + '_ {
        self.vertices.iter().copied().zip(self.vertices.iter().copied().cycle().skip(1))
    }

    /// Each vertex with the one before and the one after it.
    fn wedges(&self) -> impl Iterator<Item = (Vector, Vector, Vector)> + Clone + '_ {
        let following = self.vertices.iter().copied().cycle();
        self.edges().zip(following.skip(2)).map(|((a, b), c)| (a, b, c))
    }

    fn has_vertex(&self, point: Vector) -> bool {
        self.vertices.contains(&point)
    }

    /// Returns whether a point is inside. Of rings that share a vertex or an edge without
    /// overlapping, one has it.
    pub(super) fn has(&self, point: Vector) -> bool {
        if self.is_far_from(point) {
            return false;
        }
        self.edges().fold(self.has_origin, |inside, (a, b)| inside ^ passes(ORIGIN, point, a, b))
    }

    /// What is wrong with the ring, where something is.
    pub(super) fn fault(&self) -> Option<String> {
        for (index, vertex) in self.vertices.iter().enumerate() {
            if let Some(other) = self.vertices.iter().take(index).position(|other| other == vertex) {
                return Some(format!("duplicate vertices: {other} and {index}"));
            }
        }
        let last = self.vertices.len().saturating_sub(1);
        for (i, (a, b)) in self.edges().enumerate() {
            for (j, (c, d)) in self.edges().enumerate().skip(i + 2) {
                if !(i == 0 && j == last) && meeting(a, b, c, d) == Meeting::Crossing {
                    return Some(format!("edges {i} and {j} cross"));
                }
            }
        }
        None
    }

    /// Calls `look` for each vertex that the rings share, until it says no more is wanted; says
    /// whether edges cross before that.
    fn crosses(&self, other: &Self, look: &mut dyn FnMut(Shared) -> bool) -> bool {
        for (a0, a1, a2) in self.wedges() {
            for (b0, b1, b2) in other.wedges() {
                match meeting(a0, a1, b0, b1) {
                    Meeting::Crossing => return true,
                    Meeting::Vertex if a1 == b1 => {
                        if look(Shared { vertex: a1, own: (a0, a2), other: (b0, b2) }) {
                            return false;
                        }
                    }
                    Meeting::Vertex | Meeting::Apart => {}
                }
            }
        }
        false
    }

    /// Returns whether all of another ring's inside is inside of this one.
    pub(super) fn contains(&self, other: &Self) -> bool {
        if !self.bounds.contains(other.bounds) {
            return false;
        }
        let Some(first) = other.vertices.first() else { return false };
        if !self.has(*first) && !self.has_vertex(*first) {
            return false;
        }
        let mut outside = false;
        let crosses = self.crosses(other, &mut |shared| {
            outside = !shared.contains();
            outside
        });
        if crosses || outside {
            return false;
        }
        // Without a crossing the two could still cover the whole sphere.
        !self.vertices.first().is_some_and(|own| other.has(*own) && !other.has_vertex(*own))
    }

    /// Returns whether the insides have something in common.
    pub(super) fn meets(&self, other: &Self) -> bool {
        if !self.bounds.meets(other.bounds) {
            return false;
        }
        let begins_in = |inner: &Self, outer: &Self| {
            inner.vertices.first().is_some_and(|first| outer.has(*first) && !outer.has_vertex(*first))
        };
        if begins_in(other, self) {
            return true;
        }
        let mut common = false;
        let crosses = self.crosses(other, &mut |shared| {
            common = shared.meets();
            common
        });
        crosses || common || begins_in(self, other)
    }

    /// Returns whether another ring is inside (and its edge too), or nothing where the edges cross.
    pub(super) fn nests(&self, other: &Self) -> Option<bool> {
        if !self.bounds.meets(other.bounds) {
            return Some(false);
        }
        let (mut more, mut less, mut crossed, mut apart) = (false, false, false, false);
        let crosses = self.crosses(other, &mut |shared| {
            let wedge = shared.wedge();
            more |= wedge == Wedge::Contains;
            less |= wedge == Wedge::Contained;
            apart |= wedge == Wedge::Apart;
            crossed |= wedge == Wedge::Overlaps || (more && less);
            crossed
        });
        if crosses || crossed {
            return None;
        }
        let first = *other.vertices.first()?;
        Some(!apart && !less && (self.has(first) || self.has_vertex(first)))
    }

    /// How many vertices the rings share.
    pub(super) fn shared(&self, other: &Self) -> usize {
        self.vertices.iter().filter(|vertex| other.has_vertex(**vertex)).count()
    }
}

impl Shared {
    /// Returns whether the inside of the other ring is within that of the own one here.
    fn contains(self) -> bool {
        let Self { vertex, own: (a0, a2), other: (b0, b2) } = self;
        in_order(a2, b2, b0, vertex) && in_order(b0, a0, a2, vertex)
    }

    /// Returns whether the insides have something in common here.
    fn meets(self) -> bool {
        let Self { vertex, own: (a0, a2), other: (b0, b2) } = self;
        !(in_order(a0, b2, b0, vertex) && in_order(b0, a2, a0, vertex))
    }

    fn wedge(self) -> Wedge {
        let Self { vertex, own: (a0, a2), other: (b0, b2) } = self;
        if a0 == b0 && a2 == b2 {
            Wedge::Same
        } else if in_order(a0, a2, b2, vertex) {
            match in_order(b2, b0, a0, vertex) {
                true => Wedge::Contains,
                false if a2 == b2 => Wedge::Contained,
                false => Wedge::Overlaps,
            }
        } else if in_order(a0, b0, b2, vertex) {
            Wedge::Contained
        } else if in_order(a0, b0, a2, vertex) {
            Wedge::Apart
        } else {
            Wedge::Overlaps
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(corners: &[(f64, f64)]) -> Ring {
        Ring::new(corners.iter().map(|(longitude, latitude)| Vector::at(*longitude, *latitude)).collect()).around_less()
    }

    fn square(low: f64, high: f64) -> Ring {
        ring(&[(low, low), (high, low), (high, high), (low, high)])
    }

    #[test]
    fn a_ring_has_what_is_inside_of_its_geodesic_edges() {
        let broad = ring(&[(-60.0, 0.0), (60.0, 0.0), (60.0, 40.0), (-60.0, 40.0)]);
        assert!(broad.has(Vector::at(0.0, 20.0)));
        assert!(!broad.has(Vector::at(0.0, -1.0)));
        // The way from corner to corner bends towards the pole.
        assert!(broad.has(Vector::at(0.0, 50.0)));
        assert!(!broad.has(Vector::at(0.0, 70.0)));
        assert!(!broad.has(Vector::at(180.0, -20.0)));
    }

    #[test]
    fn a_ring_is_around_the_smaller_part_whichever_way_it_is_written() {
        let clockwise = ring(&[(0.0, 0.0), (0.0, 10.0), (10.0, 10.0), (10.0, 0.0)]);
        assert!(clockwise.has(Vector::at(5.0, 5.0)));
        assert!(clockwise.inverted().has(Vector::at(50.0, 50.0)));
        assert!(!clockwise.inverted().is_less());
    }

    #[test]
    fn rings_contain_meet_and_nest() {
        let (large, small, far) = (square(0.0, 10.0), square(2.0, 4.0), square(20.0, 30.0));
        assert!(large.contains(&small) && !small.contains(&large) && !large.contains(&far));
        assert!(large.meets(&small) && small.meets(&large) && !large.meets(&far));
        assert_eq!(
            (large.nests(&small), small.nests(&large), large.nests(&far)),
            (Some(true), Some(false), Some(false))
        );
        assert_eq!(large.nests(&square(5.0, 15.0)), None);
        // Neighbours that share an edge have no inside in common.
        let neighbour = ring(&[(10.0, 0.0), (20.0, 0.0), (20.0, 10.0), (10.0, 10.0)]);
        assert!(!large.meets(&neighbour));
        assert_eq!(large.shared(&neighbour), 2);
        assert!(large.contains(&large) && large.meets(&large));
    }

    #[test]
    fn a_ring_that_crosses_itself_is_at_fault() {
        let corners = [(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)];
        let bow = Ring::new(corners.iter().map(|(x, y)| Vector::at(*x, *y)).collect());
        assert_eq!(bow.fault().as_deref(), Some("edges 0 and 2 cross"));
        assert_eq!(square(0.0, 1.0).fault(), None);
    }
}
