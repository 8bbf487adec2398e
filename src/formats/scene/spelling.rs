//! A format of scenes: what it can express, and how it is written and read.

use super::model::{Object, Scene};
use super::operation::Operation;
use super::shape::{Kind, Solid};
use crate::formats::{Diagnostic, Source};

/// What a scene file has: a whole scene, or what is different from another.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// A scene.
    Scene(Scene),
    /// Operations, in order, and the frame of their poses, if the text names one.
    Operations(Vec<Operation>, Option<String>),
}

/// What a format can express beside names, poses and dimensions.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Kinds of solids.
    pub kinds: &'static [Kind],
    /// The name of the scene.
    pub name: bool,
    /// The frame of the poses.
    pub frame: bool,
    /// Whether frames and objects may not have one name.
    pub framed: bool,
    /// Colours.
    pub color: Color,
    /// Masses of objects.
    pub mass: Mass,
    /// Whether an object never moves.
    pub fixed: bool,
    /// Attachments.
    pub attachment: bool,
    /// Subframes.
    pub subframes: bool,
    /// Files that describe objects.
    pub model: Model,
    /// Objects without shapes.
    pub empty: bool,
    /// Whether shapes come in groups: primitives, meshes, planes.
    pub grouped: bool,
}

/// Of which objects a format has masses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mass {
    /// Of none.
    None,
    /// Of those that are attached.
    Attached,
    /// Of all.
    All,
}

/// Where a format has colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Color {
    /// At each shape.
    Shape,
    /// At each object.
    Object,
}

/// What a format does with a file that describes an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// It has none.
    None,
    /// It names the file beside the shapes.
    Beside,
    /// It names the file, which then has the shapes.
    Instead,
}

/// A format: its name, what it can express, its writer and its reader.
pub struct Spelling {
    /// The word on the command line.
    pub name: &'static str,
    /// What it can express.
    pub limits: Limits,
    /// Says why an object's name cannot be written.
    pub fits: fn(&Object) -> Result<(), String>,
    /// Writes a scene whose objects fit.
    pub write: fn(&Scene) -> String,
    /// Reads a file.
    pub read: fn(&Source) -> Result<Content, Diagnostic>,
    /// Whether a text looks like this format.
    pub recognizes: fn(&str) -> bool,
}

impl Spelling {
    /// Says why an object cannot be written in this format.
    ///
    /// # Errors
    /// The name or the shape that the format cannot express, and what it can.
    pub fn check(&self, object: &Object) -> Result<(), String> {
        (self.fits)(object)?;
        let (limits, format) = (&self.limits, self.name);
        if limits.model == Model::Instead && object.model.is_some() {
            return Ok(());
        }
        if object.shapes.is_empty() && !limits.empty {
            return Err(format!(
                "it has no geometry, which {format} needs; give it `geometry`, or a [[scene.object]] in rmem.toml"
            ));
        }
        match object.shapes.iter().map(|shape| shape.solid.kind()).find(|kind| !limits.kinds.contains(kind)) {
            None => Ok(()),
            Some(Kind::MeshFile) => Err(format!("{format} has no files of meshes")),
            Some(Kind::Triangles) => Err(format!("{format} has meshes in files only; expected `file`")),
            Some(kind) => {
                let mut known: Vec<&str> = limits.kinds.iter().map(|kind| kind.name()).collect();
                known.dedup();
                Err(format!("{format} has no {}; it has {}", kind.name(), known.join(", ")))
            }
        }
    }

    /// Says why an object cannot be written in this format, into a scene in a frame.
    ///
    /// # Errors
    /// See [`Spelling::check`]; or it has the frame's name, where frames and objects have their names in common.
    pub fn check_in(&self, object: &Object, frame: &str) -> Result<(), String> {
        self.check(object)?;
        match self.limits.framed && object.name == frame {
            true => Err(format!("its name is that of the scene's frame, which {} cannot express", self.name)),
            false => Ok(()),
        }
    }

    /// Says why a frame cannot be named in this format.
    ///
    /// # Errors
    /// What its name has that the format cannot express.
    pub fn check_frame(&self, frame: &str) -> Result<(), String> {
        // A frame of this name is that of the format itself.
        if !self.limits.frame || frame == "world" {
            return Ok(());
        }
        (self.fits)(&Object { name: frame.to_owned(), ..Object::default() })
    }

    fn weighs(&self, object: &Object) -> bool {
        match self.limits.mass {
            Mass::None => false,
            Mass::Attached => object.attachment.is_some(),
            Mass::All => true,
        }
    }

    /// What of an object is left out when it is written in this format.
    #[must_use]
    pub fn loses(&self, object: &Object) -> Vec<&'static str> {
        let limits = &self.limits;
        let colors = || object.shapes.windows(2).any(|pair| pair[0].color != pair[1].color);
        [
            (!limits.attachment && object.attachment.is_some(), "attachments"),
            (object.mass.is_some() && !self.weighs(object), "masses"),
            (!limits.fixed && object.fixed, "`static` flags"),
            (!limits.subframes && !object.subframes.is_empty(), "subframes"),
            (limits.color == Color::Object && colors(), "colours of single shapes"),
        ]
        .into_iter()
        .filter_map(|(lost, what)| lost.then_some(what))
        .collect()
    }

    /// The object as it reads back from this format.
    #[must_use]
    pub fn expressible(&self, object: &Object) -> Object {
        let limits = &self.limits;
        if let (Model::Instead, Some(model)) = (limits.model, &object.model) {
            let (name, pose) = (object.name.clone(), object.pose);
            return Object { name, pose, model: Some(model.clone()), ..Object::default() };
        }
        let mut object = object.clone();
        if limits.color == Color::Object {
            let first = object.shapes.first().and_then(|shape| shape.color);
            object.shapes.iter_mut().for_each(|shape| shape.color = first);
        }
        if limits.grouped {
            object.shapes.sort_by_key(|shape| group(&shape.solid));
        }
        Object {
            mass: object.mass.filter(|_| self.weighs(&object)),
            fixed: object.fixed && limits.fixed,
            attachment: object.attachment.filter(|_| limits.attachment),
            subframes: if limits.subframes { object.subframes } else { Vec::new() },
            model: object.model.filter(|_| limits.model != Model::None),
            ..object
        }
    }
}

/// Primitives, meshes and planes, in this order.
pub(super) fn group(solid: &Solid) -> u8 {
    match solid {
        Solid::Mesh(_) => 1,
        Solid::Plane { .. } => 2,
        _ => 0,
    }
}
