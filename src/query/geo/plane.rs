//! Shapes of the plane: what `$box`, `$center` and `$polygon` are.

/// A point of the plane.
pub(super) type Point = (f64, f64);

/// How far apart two points are.
pub(super) fn distance(a: Point, b: Point) -> f64 {
    let (x, y) = (b.0 - a.0, b.1 - a.1);
    (x * x + y * y).sqrt()
}

/// A rectangle along the axes, with its edges.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    least: Point,
    greatest: Point,
}

impl Rectangle {
    /// Returns the rectangle between two opposite corners.
    pub(super) fn between(a: Point, b: Point) -> Self {
        Self { least: (a.0.min(b.0), a.1.min(b.1)), greatest: (a.0.max(b.0), a.1.max(b.1)) }
    }

    pub(super) fn has(&self, (x, y): Point) -> bool {
        (self.least.0..=self.greatest.0).contains(&x) && (self.least.1..=self.greatest.1).contains(&y)
    }
}

/// A disc with its edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub(super) centre: Point,
    pub(super) radius: f64,
}

impl Disc {
    pub(super) fn has(&self, point: Point) -> bool {
        let (x, y) = (point.0 - self.centre.0, point.1 - self.centre.1);
        // Along an axis nothing needs to be squared, which would lose digits.
        if x == 0.0 || y == 0.0 {
            return x.abs().max(y.abs()) <= self.radius;
        }
        x * x + y * y <= self.radius * self.radius
    }
}

/// A polygon of at least three corners.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    corners: Vec<Point>,
}

impl Outline {
    /// Returns the polygon, where it has enough corners.
    pub(super) fn new(corners: Vec<Point>) -> Option<Self> {
        (corners.len() >= 3).then_some(Self { corners })
    }

    /// Returns whether a point is a corner, on a level or upright edge, or one from which a ray
    /// to the right passes an odd number of edges.
    pub(super) fn has(&self, (x, y): Point) -> bool {
        let mut inside = false;
        for (a, b) in self.corners.iter().zip(self.corners.iter().cycle().skip(1)) {
            let level_edge = a.1 == b.1 && y == a.1;
            if (x, y) == *a || level_edge && x >= a.0.min(b.0) && x <= a.0.max(b.0) {
                return true;
            }
            let level = y > a.1.min(b.1) && y <= a.1.max(b.1);
            if !level || x > a.0.max(b.0) {
                continue;
            }
            if a.0 == x && b.0 == x {
                return true;
            }
            if a.0 == b.0 || x <= (y - a.1) * (b.0 - a.0) / (b.1 - a.1) + a.0 {
                inside = !inside;
            }
        }
        inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_belong_to_rectangles_and_discs() {
        let rectangle = Rectangle::between((4.0, 0.0), (0.0, 2.0));
        assert!(rectangle.has((0.0, 0.0)) && rectangle.has((4.0, 2.0)) && !rectangle.has((4.1, 1.0)));
        let disc = Disc { centre: (0.0, 0.0), radius: 5.0 };
        assert!(disc.has((3.0, 4.0)) && disc.has((0.0, -5.0)) && !disc.has((3.1, 4.0)));
    }

    #[test]
    fn an_outline_has_what_is_inside_and_its_corners_and_straight_edges() {
        let hook = Outline::new(vec![(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (3.0, 4.0), (3.0, 1.0), (0.0, 1.0)]).unwrap();
        assert!(hook.has((1.0, 0.5)) && hook.has((3.5, 3.0)) && !hook.has((1.0, 3.0)));
        assert!(hook.has((0.0, 0.0)) && hook.has((2.0, 0.0)) && hook.has((4.0, 2.0)) && hook.has((0.0, 0.5)));
        assert!(Outline::new(vec![(0.0, 0.0), (1.0, 1.0)]).is_none());
    }
}
