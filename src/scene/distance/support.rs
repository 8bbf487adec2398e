//! Support functions: the point of a solid that is furthest in a direction.

use crate::formats::scene::pose::{add, dot, sub};
use crate::formats::scene::{Mesh, Pose, Shape, Solid};

/// A solid at its place in the scene.
#[derive(Debug, Clone)]
pub struct Body {
    pose: Pose,
    core: Core,
}

/// A convex set, without its margin.
#[derive(Debug, Clone)]
enum Core {
    /// Half edges.
    Box([f64; 3]),
    /// A point, with a radius as its margin.
    Sphere(f64),
    /// Radius and half length.
    Cylinder(f64, f64),
    /// Radius and half length.
    Cone(f64, f64),
    /// Points, of which the hull counts.
    Points(Vec<[f64; 3]>),
    /// Normal and offset in the scene.
    Plane([f64; 3], f64),
}

impl Body {
    /// The shape of an object at `pose`. Meshes have to be loaded; one in a file is a point.
    #[must_use]
    pub fn new(shape: &Shape, pose: &Pose) -> Self {
        let place = pose.around(&shape.pose);
        let core = match &shape.solid {
            Solid::Box(size) => Core::Box(size.map(|length| length / 2.0)),
            Solid::Sphere(radius) => Core::Sphere(*radius),
            Solid::Cylinder { radius, length } => Core::Cylinder(*radius, length / 2.0),
            Solid::Cone { radius, length } => Core::Cone(*radius, length / 2.0),
            Solid::Mesh(Mesh::Triangles(triangles)) => Core::Points(triangles.vertices.clone()),
            Solid::Mesh(Mesh::File { .. }) => Core::Sphere(0.0),
            Solid::Plane { normal, offset } => {
                let normal = pose.rotate(*normal);
                Core::Plane(normal, offset + dot(normal, pose.translation))
            }
        };
        Self { pose: place, core }
    }

    /// Normal and offset of a plane.
    pub(super) fn plane(&self) -> Option<([f64; 3], f64)> {
        match self.core {
            Core::Plane(normal, offset) => Some((normal, offset)),
            _ => None,
        }
    }

    /// What a sphere is larger than its core.
    pub(super) fn margin(&self) -> f64 {
        match self.core {
            Core::Sphere(radius) => radius,
            _ => 0.0,
        }
    }

    /// The point of the core that is furthest in a direction of the scene.
    pub(super) fn support(&self, direction: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.pose.inverse().rotate(direction);
        let rim = |radius: f64| {
            let length = x.hypot(y);
            if length > 0.0 { [radius * x / length, radius * y / length] } else { [radius, 0.0] }
        };
        let local = match &self.core {
            Core::Box([hx, hy, hz]) => [hx.copysign(x), hy.copysign(y), hz.copysign(z)],
            Core::Sphere(_) | Core::Plane(..) => [0.0; 3],
            Core::Cylinder(radius, half) => {
                let [rx, ry] = rim(*radius);
                [rx, ry, half.copysign(z)]
            }
            Core::Cone(radius, half) => {
                let [rx, ry] = rim(*radius);
                if half * z > rx * x + ry * y - half * z { [0.0, 0.0, *half] } else { [rx, ry, -half] }
            }
            Core::Points(points) => {
                let further = |a: &&[f64; 3], b: &&[f64; 3]| dot(**a, [x, y, z]).total_cmp(&dot(**b, [x, y, z]));
                points.iter().max_by(further).copied().unwrap_or_default()
            }
        };
        self.pose.place(local)
    }

    /// The least coordinate along a unit vector, with the margin.
    pub(super) fn lowest(&self, normal: [f64; 3]) -> f64 {
        dot(self.support(normal.map(|part| -part)), normal) - self.margin()
    }

    /// A point inside.
    pub(super) fn center(&self) -> [f64; 3] {
        match &self.core {
            Core::Points(points) => {
                let sum = points.iter().fold([0.0; 3], |sum, point| add(sum, *point));
                self.pose.place(sum.map(|part| part / points.len().max(1) as f64))
            }
            _ => self.pose.translation,
        }
    }

    /// The box along the axes of the scene around it: least and greatest coordinates.
    #[must_use]
    pub fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        if matches!(self.core, Core::Plane(..)) {
            return ([f64::NEG_INFINITY; 3], [f64::INFINITY; 3]);
        }
        let (mut least, mut greatest) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            let mut direction = [0.0; 3];
            direction[axis] = 1.0;
            greatest[axis] = self.support(direction)[axis] + self.margin();
            direction[axis] = -1.0;
            least[axis] = self.support(direction)[axis] - self.margin();
        }
        (least, greatest)
    }
}

/// The Minkowski difference of two cores: all differences of their points.
pub(super) struct Difference<'a> {
    pub(super) a: &'a Body,
    pub(super) b: &'a Body,
}

impl Difference<'_> {
    pub(super) fn support(&self, direction: [f64; 3]) -> [f64; 3] {
        sub(self.a.support(direction), self.b.support(direction.map(|part| -part)))
    }

    pub(super) fn center(&self) -> [f64; 3] {
        sub(self.a.center(), self.b.center())
    }
}
