//! A scene: objects with shapes, in one frame.

use super::pose::Pose;
use super::shape::{Kind, Shape};

/// Objects in one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// What the scene is called, where it has a name.
    pub name: Option<String>,
    /// The frame of all poses; `None` where the format does not say.
    pub frame: Option<String>,
    /// In order; names differ.
    pub objects: Vec<Object>,
    /// The robots beside them in the file, which are no objects of a scene, by their names.
    pub robots: Vec<String>,
}

/// A thing that can be moved, or is in the way.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Object {
    /// Unique in a scene.
    pub name: String,
    /// Where it is in the scene's frame.
    pub pose: Pose,
    /// What it is made of; may be nothing.
    pub shapes: Vec<Shape>,
    /// Kilograms.
    pub mass: Option<f64>,
    /// Whether it never moves.
    pub fixed: bool,
    /// What it is attached to.
    pub attachment: Option<Attachment>,
    /// Named poses in the object's frame: where to grasp it, say.
    pub subframes: Vec<(String, Pose)>,
    /// A file that describes it, for formats that name files.
    pub model: Option<String>,
}

/// What an object is attached to.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Attachment {
    /// The link of a robot.
    pub link: String,
    /// Links, or objects, that may touch it.
    pub touch: Vec<String>,
}

impl Object {
    /// The colour of all its shapes, where they have one and the same.
    #[must_use]
    pub fn color(&self) -> Option<[f64; 4]> {
        let first = self.shapes.first()?.color?;
        self.shapes.iter().all(|shape| shape.color == Some(first)).then_some(first)
    }

    /// Whether it has a plane, which no format lets move.
    #[must_use]
    pub fn has_plane(&self) -> bool {
        self.shapes.iter().any(|shape| shape.solid.kind() == Kind::Plane)
    }

    /// Whether two objects differ by at most `tolerance` in each number.
    #[must_use]
    pub fn is_near(&self, other: &Self, tolerance: f64) -> bool {
        let masses = match (self.mass, other.mass) {
            (Some(one), Some(other)) => (one - other).abs() <= tolerance,
            (None, None) => true,
            _ => false,
        };
        let subframes =
            |(one, other): (&(String, Pose), &(String, Pose))| one.0 == other.0 && one.1.is_near(&other.1, tolerance);
        self.name == other.name
            && self.pose.is_near(&other.pose, tolerance)
            && self.has_shapes_near(other, tolerance)
            && masses
            && (self.fixed, &self.attachment, &self.model) == (other.fixed, &other.attachment, &other.model)
            && self.subframes.len() == other.subframes.len()
            && self.subframes.iter().zip(&other.subframes).all(subframes)
    }

    /// Whether the shapes differ by at most `tolerance` in each number.
    #[must_use]
    pub fn has_shapes_near(&self, other: &Self, tolerance: f64) -> bool {
        self.shapes.len() == other.shapes.len()
            && self.shapes.iter().zip(&other.shapes).all(|(one, other)| one.is_near(other, tolerance))
    }
}
