//! Shapes: what an object looks like to a motion planner.

use super::pose::{Pose, dot, norm};

/// A solid in an object.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// Where it is in the object's frame.
    pub pose: Pose,
    /// Its kind and dimensions.
    pub solid: Solid,
    /// Red, green, blue and opacity from 0 to 1; `None` leaves it to the reader.
    pub color: Option<[f64; 4]>,
}

/// A kind of solid with its full dimensions in metres, centred on its own origin.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// Full edge lengths along x, y and z.
    Box([f64; 3]),
    /// A radius.
    Sphere(f64),
    /// Its axis is z.
    Cylinder {
        /// The radius.
        radius: f64,
        /// The full length.
        length: f64,
    },
    /// Its axis is z, its tip is up, its origin is half-way between base and tip.
    Cone {
        /// The radius of the base.
        radius: f64,
        /// From base to tip.
        length: f64,
    },
    /// All points `p` with `normal · p = offset`; solid is what lies below.
    Plane {
        /// A unit vector.
        normal: [f64; 3],
        /// Metres.
        offset: f64,
    },
    /// Triangles.
    Mesh(Mesh),
}

/// The triangles of a mesh: in a file, or here.
#[derive(Debug, Clone, PartialEq)]
pub enum Mesh {
    /// In a file.
    File {
        /// Its name, as the document has it.
        file: String,
        /// What its coordinates are multiplied with.
        scale: [f64; 3],
    },
    /// Here.
    Triangles(Triangles),
}

/// Vertices, and triangles as indices of three of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Triangles {
    /// Metres.
    pub vertices: Vec<[f64; 3]>,
    /// Indices into the vertices.
    pub faces: Vec<[usize; 3]>,
}

/// Kinds of solids, as what a format can express.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// [`Solid::Box`]
    Box,
    /// [`Solid::Sphere`]
    Sphere,
    /// [`Solid::Cylinder`]
    Cylinder,
    /// [`Solid::Cone`]
    Cone,
    /// [`Solid::Plane`]
    Plane,
    /// [`Mesh::File`]
    MeshFile,
    /// [`Mesh::Triangles`]
    Triangles,
}

impl Kind {
    /// What documents and messages call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Sphere => "sphere",
            Self::Cylinder => "cylinder",
            Self::Cone => "cone",
            Self::Plane => "plane",
            Self::MeshFile | Self::Triangles => "mesh",
        }
    }
}

impl Solid {
    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Box(_) => Kind::Box,
            Self::Sphere(_) => Kind::Sphere,
            Self::Cylinder { .. } => Kind::Cylinder,
            Self::Cone { .. } => Kind::Cone,
            Self::Plane { .. } => Kind::Plane,
            Self::Mesh(Mesh::File { .. }) => Kind::MeshFile,
            Self::Mesh(Mesh::Triangles(_)) => Kind::Triangles,
        }
    }

    /// Checks dimensions, for a message that follows the name of the kind.
    ///
    /// # Errors
    /// Which dimension is not a positive, finite number, or which triangle has no vertices.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Box(size) => positive("size", size),
            Self::Sphere(radius) => positive("radius", &[*radius]),
            Self::Cylinder { radius, length } | Self::Cone { radius, length } => {
                positive("radius", &[*radius]).and_then(|()| positive("length", &[*length]))
            }
            Self::Plane { normal, offset } => {
                let length = norm(normal);
                if !((length - 1.0).abs() < 1e-3 && offset.is_finite()) {
                    return Err(format!(
                        "has the normal {normal:?} and the offset {offset}; expected a unit vector and a number"
                    ));
                }
                Ok(())
            }
            Self::Mesh(Mesh::File { file, scale }) => {
                if file.is_empty() {
                    return Err("names no file".to_owned());
                }
                let usable = |part: &f64| part.is_finite() && *part != 0.0;
                if scale.iter().all(usable) {
                    Ok(())
                } else {
                    Err(format!("has the scale {scale:?}; expected numbers other than 0"))
                }
            }
            Self::Mesh(Mesh::Triangles(triangles)) => triangles.check(),
        }
    }
}

impl Triangles {
    fn check(&self) -> Result<(), String> {
        let count = self.vertices.len();
        if self.vertices.iter().flatten().any(|part| !part.is_finite()) {
            return Err("has a vertex that is not three finite numbers".to_owned());
        }
        match self.faces.iter().flatten().find(|index| **index >= count) {
            Some(index) => Err(format!("has a triangle with the vertex {index}, and {count} vertices, counted from 0")),
            None if count < 3 => Err(format!("has {count} vertices; expected 3 at least")),
            None => Ok(()),
        }
    }
}

fn positive(what: &str, values: &[f64]) -> Result<(), String> {
    if values.iter().all(|value| value.is_finite() && *value > 0.0) {
        return Ok(());
    }
    let shown: Vec<String> = values.iter().map(f64::to_string).collect();
    let shown = if let [one] = &shown[..] { one.clone() } else { format!("[{}]", shown.join(", ")) };
    Err(format!("has the {what} {shown}; expected more than 0 metres"))
}

impl Shape {
    /// A shape without a colour. A plane is given in the object's frame: its own pose becomes
    /// part of normal and offset, since formats have one or the other.
    #[must_use]
    pub fn new(solid: Solid, pose: Pose) -> Self {
        match solid {
            Solid::Plane { normal, offset } => {
                let length = norm(&normal);
                let normal = pose.rotate(normal.map(|part| part / length));
                let offset = offset / length + dot(normal, pose.translation);
                Self { pose: Pose::IDENTITY, solid: Solid::Plane { normal, offset }, color: None }
            }
            solid => Self { pose, solid, color: None },
        }
    }

    /// Whether two shapes differ by at most `tolerance` in each number.
    #[must_use]
    pub fn is_near(&self, other: &Self, tolerance: f64) -> bool {
        let near = |one: &[f64], other: &[f64]| {
            one.len() == other.len() && one.iter().zip(other).all(|(a, b)| (a - b).abs() <= tolerance)
        };
        let solids = match (&self.solid, &other.solid) {
            (Solid::Box(a), Solid::Box(b)) => near(a, b),
            (Solid::Sphere(a), Solid::Sphere(b)) => near(&[*a], &[*b]),
            (Solid::Cylinder { radius: r, length: l }, Solid::Cylinder { radius: s, length: m })
            | (Solid::Cone { radius: r, length: l }, Solid::Cone { radius: s, length: m }) => {
                near(&[*r, *l], &[*s, *m])
            }
            (Solid::Plane { normal: n, offset: o }, Solid::Plane { normal: m, offset: p }) => {
                near(n, m) && near(&[*o], &[*p])
            }
            (Solid::Mesh(Mesh::File { file: f, scale: s }), Solid::Mesh(Mesh::File { file: g, scale: t })) => {
                f == g && near(s, t)
            }
            (Solid::Mesh(Mesh::Triangles(a)), Solid::Mesh(Mesh::Triangles(b))) => {
                a.faces == b.faces && near(a.vertices.as_flattened(), b.vertices.as_flattened())
            }
            _ => false,
        };
        let colors = match (&self.color, &other.color) {
            (Some(a), Some(b)) => near(a, b),
            (None, None) => true,
            _ => false,
        };
        solids && colors && self.pose.is_near(&other.pose, tolerance)
    }
}
