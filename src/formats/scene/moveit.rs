//! MoveIt's `.scene` files, which RViz and `moveit_core` write and read, in both versions.
//!
//! The grammar, found by reading what MoveIt writes (it is documented nowhere):
//!
//! ```text
//! scene  := NAME newline object* "." newline
//! object := "* " ID newline [pose] N newline shape{N} [M newline (SUBFRAME newline pose){M}]
//! pose   := "x y z" newline "qx qy qz qw" newline
//! shape  := kind newline dimensions newline pose "r g b a" newline
//! ```
//!
//! The parts in brackets are missing in the older version, which shows in a line after `* ID` without a
//! blank in it. Quaternions are x, y, z, w; a box has full sizes, a cylinder or cone radius and then length; a
//! plane is `a b c d` with `ax + by + cz + d = 0`; a mesh is `V T` and their lines; `0 0 0 0` is no colour.
//! Frames, attachments and masses are not in it.

use std::fmt::Write as _;

use super::number::{number, numbers};
use super::{Color, Content, Kind, Limits, Mass, Mesh, Model, Object, Pose, Scene, Shape, Solid, Spelling, Triangles};
use crate::formats::{Diagnostic, Source, Span};

/// MoveIt's `.scene`.
pub const SPELLING: Spelling = Spelling {
    name: "moveit",
    limits: Limits {
        kinds: &[Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::Cone, Kind::Plane, Kind::Triangles],
        name: true,
        frame: false,
        framed: false,
        color: Color::Shape,
        mass: Mass::None,
        fixed: false,
        attachment: false,
        subframes: true,
        model: Model::None,
        empty: true,
        grouped: false,
    },
    fits,
    write,
    read,
    recognizes: |text| text.lines().nth(1).is_some_and(|line| line.starts_with("* ") || line.trim() == "."),
};

fn fits(object: &Object) -> Result<(), String> {
    let name = &object.name;
    if name.is_empty() || name.trim() != name || name.contains(char::is_control) {
        return Err(format!(
            "its name `{}` begins or ends with a blank, is empty, or is not a single line, which moveit cannot express",
            name.escape_debug()
        ));
    }
    if let Some((frame, _)) =
        object.subframes.iter().find(|(frame, _)| frame.is_empty() || frame.contains(char::is_whitespace))
    {
        return Err(format!(
            "its subframe `{}` has a blank in its name, which moveit cannot express",
            frame.escape_debug()
        ));
    }
    let invisible = |shape: &Shape| shape.color == Some([0.0; 4]);
    if object.shapes.iter().any(invisible) {
        return Err("its colour is 0 0 0 0, which means no colour to moveit".to_owned());
    }
    Ok(())
}

fn write(scene: &Scene) -> String {
    let name = scene.name.as_deref().unwrap_or("scene");
    let mut text = format!("{}\n", name.replace(['\n', '\r'], " "));
    for object in &scene.objects {
        let _ = writeln!(text, "* {}", object.name);
        pose(&object.pose, &mut text);
        let _ = writeln!(text, "{}", object.shapes.len());
        for shape in &object.shapes {
            solid(&shape.solid, &mut text);
            pose(&shape.pose, &mut text);
            let _ = writeln!(text, "{}", numbers(&shape.color.unwrap_or_default()));
        }
        let _ = writeln!(text, "{}", object.subframes.len());
        for (name, place) in &object.subframes {
            let _ = writeln!(text, "{name}");
            pose(place, &mut text);
        }
    }
    text.push_str(".\n");
    text
}

fn pose(pose: &Pose, text: &mut String) {
    let _ = write!(text, "{}\n{}\n", numbers(&pose.translation), numbers(&pose.rotation));
}

fn solid(solid: &Solid, text: &mut String) {
    let _ = match solid {
        Solid::Box(size) => writeln!(text, "box\n{}", numbers(size)),
        Solid::Sphere(radius) => writeln!(text, "sphere\n{}", number(*radius)),
        Solid::Cylinder { radius, length } => writeln!(text, "cylinder\n{}", numbers(&[*radius, *length])),
        Solid::Cone { radius, length } => writeln!(text, "cone\n{}", numbers(&[*radius, *length])),
        Solid::Plane { normal: [a, b, c], offset } => writeln!(text, "plane\n{}", numbers(&[*a, *b, *c, -offset])),
        Solid::Mesh(Mesh::Triangles(Triangles { vertices, faces })) => {
            let _ = writeln!(text, "mesh\n{} {}", vertices.len(), faces.len());
            for vertex in vertices {
                let _ = writeln!(text, "{}", numbers(vertex));
            }
            for [a, b, c] in faces {
                let _ = writeln!(text, "{a} {b} {c}");
            }
            Ok(())
        }
        // `check` lets none come here.
        Solid::Mesh(Mesh::File { .. }) => Ok(()),
    };
}

/// The lines of a file, with their places.
struct Lines<'a> {
    source: &'a Source,
    at: usize,
}

fn read(source: &Source) -> Result<Content, Diagnostic> {
    let mut lines = Lines { source, at: 0 };
    let name = lines.next("the name of the scene")?;
    let mut scene = Scene { name: Some(name.trim().to_owned()), ..Scene::default() };
    loop {
        let start = lines.at;
        let line = lines.next("`* ID` or `.`")?;
        if line.trim() == "." {
            return Ok(Content::Scene(scene));
        }
        let Some(id) = line.strip_prefix('*').filter(|id| id.starts_with([' ', '\t'])) else {
            return Err(lines.wrong(start, format!("expected `* ID` or `.`, found `{}`", line.trim())));
        };
        scene.objects.push(lines.object(id.trim())?);
    }
}

impl<'a> Lines<'a> {
    /// The next line; `expected` is what messages say where there is none.
    fn next(&mut self, expected: &str) -> Result<&'a str, Diagnostic> {
        let rest = self.source.text().get(self.at..).unwrap_or_default();
        let line = rest.split_inclusive('\n').next();
        let line = line.ok_or_else(|| {
            Diagnostic::new(self.source, Span::at(self.at), format!("expected {expected}, found the end of the file"))
        })?;
        self.at += line.len();
        Ok(line.trim_end_matches(['\n', '\r']))
    }

    fn wrong(&self, start: usize, message: impl Into<String>) -> Diagnostic {
        let end = self.at.min(self.source.text().len());
        let line = self.source.text().get(start..end).unwrap_or_default();
        Diagnostic::new(self.source, Span::new(start, start + line.trim_end().len()), message)
    }

    fn object(&mut self, id: &str) -> Result<Object, Diagnostic> {
        let rest = self.source.text().get(self.at..).unwrap_or_default();
        let has_pose = rest.lines().next().is_some_and(|line| line.trim().contains(' '));
        let mut object = Object { name: id.to_owned(), ..Object::default() };
        if has_pose {
            object.pose = self.pose()?;
        }
        for _ in 0..self.count("the number of shapes")? {
            object.shapes.push(self.shape()?);
        }
        if has_pose {
            for _ in 0..self.count("the number of subframes")? {
                let name = self.next("the name of a subframe")?.trim().to_owned();
                object.subframes.push((name, self.pose()?));
            }
        }
        Ok(object)
    }

    fn shape(&mut self) -> Result<Shape, Diagnostic> {
        let start = self.at;
        let kind = self.next("the kind of a shape")?.trim();
        let solid = match kind {
            "box" => Solid::Box(self.numbers("the size of a box: x y z")?),
            "sphere" => Solid::Sphere(self.numbers::<1>("the radius of a sphere")?[0]),
            "cylinder" | "cone" => {
                let [radius, length] = self.numbers("radius and length")?;
                if kind == "cone" { Solid::Cone { radius, length } } else { Solid::Cylinder { radius, length } }
            }
            "plane" => {
                let [a, b, c, d] = self.numbers("the coefficients of a plane: a b c d")?;
                let length = super::pose::norm(&[a, b, c]);
                if length == 0.0 {
                    return Err(self.wrong(start, "a plane without a normal"));
                }
                Solid::Plane { normal: [a / length, b / length, c / length], offset: -d / length }
            }
            "mesh" => Solid::Mesh(Mesh::Triangles(self.triangles()?)),
            other => {
                return Err(self.wrong(
                    start,
                    format!("unknown shape `{other}`; expected box, sphere, cylinder, cone, plane or mesh"),
                ));
            }
        };
        solid.check().map_err(|wrong| self.wrong(start, format!("a {kind} that {wrong}")))?;
        let pose = self.pose()?;
        let start = self.at;
        let color: [f64; 4] = self.numbers("a colour: r g b a")?;
        if !color.iter().all(|part| (0.0..=1.0).contains(part)) {
            return Err(self.wrong(start, "expected a colour from 0 to 1: r g b a"));
        }
        Ok(Shape { color: Some(color).filter(|color| *color != [0.0; 4]), ..Shape::new(solid, pose) })
    }

    fn triangles(&mut self) -> Result<Triangles, Diagnostic> {
        let start = self.at;
        let [vertices, faces] = self.numbers::<2>("the numbers of vertices and triangles")?.map(|count| count as usize);
        if vertices.max(faces) > self.source.text().len() {
            return Err(self.wrong(start, "more vertices and triangles than the file has lines"));
        }
        let mut triangles = Triangles::default();
        for _ in 0..vertices {
            triangles.vertices.push(self.numbers("a vertex: x y z")?);
        }
        for _ in 0..faces {
            let start = self.at;
            let indices: [f64; 3] = self.numbers("a triangle: three indices")?;
            if indices.iter().any(|index| *index < 0.0 || index.fract() != 0.0) {
                return Err(self.wrong(start, "expected three indices of vertices"));
            }
            triangles.faces.push(indices.map(|index| index as usize));
        }
        Ok(triangles)
    }

    fn pose(&mut self) -> Result<Pose, Diagnostic> {
        let translation = self.numbers("a position: x y z")?;
        let start = self.at;
        let rotation: [f64; 4] = self.numbers("a quaternion: x y z w")?;
        let length = super::pose::norm(&rotation);
        Pose::new(translation, rotation).filter(|_| (length - 1.0).abs() <= 1e-3).ok_or_else(|| {
            self.wrong(start, format!("a quaternion of length {length:.6}; expected a unit quaternion x y z w"))
        })
    }

    fn count(&mut self, what: &str) -> Result<usize, Diagnostic> {
        let start = self.at;
        let line = self.next(what)?;
        line.trim().parse().map_err(|_| self.wrong(start, format!("expected {what}, found `{}`", line.trim())))
    }

    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N], Diagnostic> {
        let start = self.at;
        let line = self.next(what)?;
        let found: Option<Vec<f64>> =
            line.split_whitespace().map(|word| word.parse().ok().filter(|number: &f64| number.is_finite())).collect();
        let found: Option<[f64; N]> = found.and_then(|found| found.try_into().ok());
        found.ok_or_else(|| self.wrong(start, format!("expected {what}, found `{}`", line.trim())))
    }
}
