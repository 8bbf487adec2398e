//! Polygons: rings within rings, every other one a hole.

use super::cell::Cell;
use super::edge::{Meeting, crosses_in_vertex, crossing, distance, meeting};
use super::line::Line;
use super::ring::Ring;
use super::vector::Vector;

/// How close, in radians, the pieces of a line are to be to count as one.
const JOINT: f64 = 1.5e-15;
/// How much of a line, in radians, may stick out.
const OVERHANG: f64 = 1e-10 * std::f64::consts::PI / 180.0;

/// A polygon of one outer ring, with holes.
#[derive(Debug, Clone)]
pub(in crate::query::geo) struct Polygon {
    /// The outer ring first.
    rings: Vec<Ring>,
    /// For each ring, whether it is a hole.
    holes: Vec<bool>,
}

impl Polygon {
    /// Returns the polygon of rings of vertices, each around the smaller part of the sphere.
    ///
    /// # Errors
    /// What is wrong with the rings.
    pub(in crate::query::geo) fn new(rings: Vec<Vec<Vector>>) -> Result<Self, String> {
        let mut sound: Vec<Ring> = Vec::with_capacity(rings.len());
        for vertices in rings {
            let ring = sound_ring(vertices)?.around_less();
            if sound.first().is_some_and(|outer| !outer.contains(&ring)) {
                return Err("the rings after the first must be holes in it".to_owned());
            }
            sound.push(ring);
        }
        if sound.is_empty() {
            return Err("a polygon needs a ring".to_owned());
        }
        check_together(&sound)?;
        let depth = |ring: &Ring| sound.iter().filter(|other| other.nests(ring) == Some(true)).count();
        // Each ring nests itself.
        let holes = sound.iter().map(|ring| depth(ring) % 2 == 0).collect();
        Ok(Self { rings: sound, holes })
    }

    fn single(ring: Ring) -> Self {
        Self { rings: vec![ring], holes: vec![false] }
    }

    fn only_ring(&self) -> Option<&Ring> {
        match self.rings.as_slice() {
            [ring] => Some(ring),
            _ => None,
        }
    }

    fn rings(&self, holes: bool) -> impl Iterator<Item = &Ring> {
        self.rings.iter().zip(&self.holes).filter(move |(_, hole)| **hole == holes).map(|(ring, _)| ring)
    }

    /// Returns whether a point is inside; of one on the edge that is as the edge's direction has it.
    pub(in crate::query::geo) fn has(&self, point: Vector) -> bool {
        self.rings.iter().fold(false, |inside, ring| inside ^ ring.has(point))
    }

    /// Returns whether a point is inside or, as near as a cell can say it, on the edge.
    pub(in crate::query::geo) fn has_or_touches(&self, point: Vector, cell: Cell) -> bool {
        self.has(point) || self.touches_cell(point, cell)
    }

    /// Returns whether a part of the cell, in which the point is, is inside.
    pub(in crate::query::geo) fn touches_cell(&self, point: Vector, cell: Cell) -> bool {
        if self.rings.first().is_some_and(|outer| outer.is_far_from(point)) {
            return false;
        }
        let cell = Self::single(Ring::new(cell.vertices().to_vec()));
        self.meets(&cell)
    }

    /// Returns whether all of another polygon is inside.
    pub(in crate::query::geo) fn contains(&self, other: &Self) -> bool {
        match (self.only_ring(), other.only_ring()) {
            (Some(own), Some(other)) => own.contains(other),
            _ => {
                other.rings(false).all(|ring| self.encloses(ring) == Some(true))
                    && self.rings(true).all(|hole| other.encloses(hole) == Some(false))
            }
        }
    }

    /// Returns whether a ring is inside of an odd number of rings; `None` if an edge crosses it.
    fn encloses(&self, ring: &Ring) -> Option<bool> {
        self.rings.iter().try_fold(false, |inside, own| Some(inside ^ own.nests(ring)?))
    }

    /// Returns whether two polygons have something in common.
    pub(in crate::query::geo) fn meets(&self, other: &Self) -> bool {
        match (self.only_ring(), other.only_ring()) {
            (Some(own), Some(other)) => own.meets(other),
            _ => {
                other.rings(false).any(|ring| self.meets_ring(ring))
                    || self.rings(false).any(|ring| other.meets_ring(ring))
            }
        }
    }

    fn meets_ring(&self, ring: &Ring) -> bool {
        let mut inside = false;
        for own in &self.rings {
            if own.contains(ring) {
                inside = !inside;
            } else if !ring.contains(own) && own.meets(ring) {
                return true;
            }
        }
        inside
    }

    /// Returns the pieces of a line that are inside, or outside, as the points where each begins and ends.
    fn clip(&self, line: &Line, outside: bool) -> Vec<(Vector, Vector)> {
        let mut pieces = Vec::new();
        let mut inside = line.vertices().first().is_some_and(|first| self.has(*first) != outside);
        for (a, b) in line.edges() {
            let mut cuts: Vec<(f64, Vector)> = Vec::new();
            if inside {
                cuts.push((0.0, a));
            }
            for (c, d) in self.rings.iter().flat_map(Ring::edges) {
                match meeting(a, b, c, d) {
                    Meeting::Crossing => {
                        let point = crossing((a, b), (c, d));
                        let (from, to) = (point.angle(a), point.angle(b));
                        cuts.push((from / (from + to), point));
                    }
                    Meeting::Vertex if crosses_in_vertex(a, b, c, d) => {
                        cuts.push(if a == c || a == d { (0.0, a) } else { (1.0, b) });
                    }
                    Meeting::Vertex | Meeting::Apart => {}
                }
            }
            inside = cuts.len() % 2 == 1;
            if inside {
                cuts.push((1.0, b));
            }
            cuts.sort_by(|p, q| p.0.total_cmp(&q.0));
            let pairs = cuts.chunks_exact(2).filter_map(|pair| match pair {
                [from, to] if from != to => Some((from.1, to.1)),
                _ => None,
            });
            pieces.extend(pairs);
        }
        pieces
    }

    /// Returns whether a line is inside at some place.
    pub(in crate::query::geo) fn meets_line(&self, line: &Line) -> bool {
        !self.clip(line, false).is_empty()
    }

    /// Returns whether all of a line is inside: each of its edges from end to end.
    pub(in crate::query::geo) fn contains_line(&self, line: &Line) -> bool {
        line.edges().all(|(a, b)| Line::new(vec![a, b]).is_some_and(|edge| self.contains_edge(&edge, a, b)))
    }

    fn contains_edge(&self, edge: &Line, a: Vector, b: Vector) -> bool {
        let pieces = self.clip(edge, false);
        let joined = pieces.windows(2).all(|pair| match pair {
            [(_, end), (start, _)] => end.angle(*start) <= JOINT,
            _ => true,
        });
        let ends = pieces.first().zip(pieces.last());
        joined && ends.is_some_and(|(first, last)| first.0.angle(a) <= OVERHANG && last.1.angle(b) <= OVERHANG)
    }

    /// Returns the angle from a point to the closest point; 0 for one inside.
    pub(in crate::query::geo) fn distance(&self, point: Vector) -> f64 {
        if self.has(point) {
            return 0.0;
        }
        distance(point, self.rings.iter().flat_map(Ring::edges))
    }
}

/// A polygon of one ring whose inside is to its left, however large: MongoDB's
/// `strictwinding` reference system, for queries only.
#[derive(Debug, Clone)]
pub(in crate::query::geo) struct BigPolygon {
    /// The smaller part of the two.
    smaller: Polygon,
    /// The other part, where that is meant.
    larger: Option<Ring>,
    border: Line,
}

impl BigPolygon {
    /// Returns the polygon left of a ring of vertices.
    ///
    /// # Errors
    /// What is wrong with the ring.
    pub(in crate::query::geo) fn new(vertices: Vec<Vector>) -> Result<Self, String> {
        let around = vertices.iter().chain(vertices.first()).copied().collect();
        let border = Line::new(around).ok_or("a ring cannot go to the opposite of a vertex")?;
        let ring = sound_ring(vertices)?;
        let larger = (!ring.is_less()).then(|| ring.clone());
        Ok(Self { smaller: Polygon::single(ring.around_less()), larger, border })
    }

    pub(in crate::query::geo) fn has_or_touches(&self, point: Vector, cell: Cell) -> bool {
        match &self.larger {
            Some(larger) => larger.has(point) || larger.meets(&Ring::new(cell.vertices().to_vec())),
            None => self.smaller.has_or_touches(point, cell),
        }
    }

    pub(in crate::query::geo) fn contains(&self, polygon: &Polygon) -> bool {
        if self.larger.is_some() { !self.smaller.meets(polygon) } else { self.smaller.contains(polygon) }
    }

    pub(in crate::query::geo) fn contains_line(&self, line: &Line) -> bool {
        self.smaller.clip(line, self.larger.is_none()).is_empty()
    }

    pub(in crate::query::geo) fn meets(&self, polygon: &Polygon) -> bool {
        if self.larger.is_some() { !self.smaller.contains(polygon) } else { self.smaller.meets(polygon) }
    }

    pub(in crate::query::geo) fn meets_line(&self, line: &Line) -> bool {
        let begins_inside =
            |first: &Vector| self.larger.as_ref().map_or_else(|| self.smaller.has(*first), |larger| larger.has(*first));
        self.border.meets(line) || line.vertices().first().is_some_and(begins_inside)
    }
}

fn sound_ring(vertices: Vec<Vector>) -> Result<Ring, String> {
    let count = vertices.len();
    if count < 3 {
        return Err(format!("a ring must have at least 3 different vertices, here are {count}"));
    }
    let ring = Ring::new(vertices);
    ring.fault().map_or(Ok(ring), Err)
}

/// Checks that no two rings cross, share an edge, or more than a vertex.
fn check_together(rings: &[Ring]) -> Result<(), String> {
    for (index, ring) in rings.iter().enumerate() {
        for other in rings.iter().take(index) {
            let shares_edge = |(a, b)| other.edges().any(|(c, d)| (a, b) == (c, d) || (a, b) == (d, c));
            if ring.edges().any(shares_edge) {
                return Err("two rings share an edge".to_owned());
            }
            if ring.nests(other).is_none() {
                return Err("two rings cross".to_owned());
            }
            if ring.shared(other) > 1 {
                return Err("two rings share more than a vertex".to_owned());
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(corners: &[(f64, f64)]) -> Vec<Vector> {
        corners.iter().map(|(longitude, latitude)| Vector::at(*longitude, *latitude)).collect()
    }

    fn square(low: f64, high: f64) -> Vec<Vector> {
        ring(&[(low, low), (high, low), (high, high), (low, high)])
    }

    fn line(points: &[(f64, f64)]) -> Line {
        Line::new(ring(points)).unwrap()
    }

    #[test]
    fn a_hole_is_outside() {
        let polygon = Polygon::new(vec![square(0.0, 10.0), square(4.0, 6.0)]).unwrap();
        let has = |x, y| polygon.has_or_touches(Vector::at(x, y), Cell::of(Vector::at(x, y)));
        assert!(has(1.0, 1.0) && !has(5.0, 5.0) && !has(11.0, 5.0));
        assert!(has(0.0, 0.0) && has(4.0, 5.0));
        let within = |rings| polygon.contains(&Polygon::new(rings).unwrap());
        assert!(within(vec![square(1.0, 2.0)]) && !within(vec![square(3.0, 7.0)]) && !within(vec![square(4.5, 5.5)]));
        assert!(within(vec![square(3.0, 7.0), square(3.5, 6.5)]));
        assert!(!polygon.meets(&Polygon::new(vec![square(4.5, 5.5)]).unwrap()));
        assert!(polygon.meets(&Polygon::new(vec![square(-5.0, 50.0)]).unwrap()));
    }

    #[test]
    fn a_line_is_inside_as_a_whole_or_in_part() {
        let polygon = Polygon::new(vec![square(0.0, 10.0), square(4.0, 6.0)]).unwrap();
        assert!(polygon.contains_line(&line(&[(1.0, 1.0), (2.0, 2.0), (3.0, 1.0)])));
        assert!(!polygon.contains_line(&line(&[(1.0, 1.0), (9.0, 9.0)])));
        // Out and back by the same way.
        assert!(!polygon.contains_line(&line(&[(1.0, 1.0), (-9.0, 1.0), (1.0, 1.0)])));
        assert!(polygon.meets_line(&line(&[(5.0, 5.0), (9.0, 9.0)])));
        assert!(!polygon.meets_line(&line(&[(4.5, 4.5), (5.5, 5.5)])));
    }

    #[test]
    fn a_big_polygon_is_left_of_its_ring() {
        let point = Vector::at(50.0, 50.0);
        let has = |corners: Vec<Vector>| BigPolygon::new(corners).unwrap().has_or_touches(point, Cell::of(point));
        assert!(!has(square(0.0, 10.0)));
        assert!(has(square(0.0, 10.0).into_iter().rev().collect()));
    }

    #[test]
    fn rings_that_do_not_fit_are_refused() {
        assert!(Polygon::new(vec![]).is_err());
        assert!(Polygon::new(vec![square(0.0, 10.0), square(20.0, 30.0)]).is_err());
        assert!(Polygon::new(vec![square(0.0, 10.0), square(5.0, 30.0)]).is_err());
        assert!(Polygon::new(vec![square(0.0, 10.0), square(0.0, 5.0)]).is_err());
    }
}
