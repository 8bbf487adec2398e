//! Scenes: what a motion planner has to know of the world, as plain types, and the formats
//! in which it is written.
//!
//! A [`Scene`] has objects with shapes, in one frame. Every format is one file here, which says
//! what it can express ([`Limits`]), and turns scenes into text and text into scenes. All lengths
//! are full and in metres, all quaternions are x, y, z, w, and cylinders stand along z; what a
//! format does otherwise is converted in its own file.

pub mod document;
pub mod inertia;
pub mod json;
pub mod mesh;
pub mod message;
pub mod mjcf;
pub mod model;
pub mod moveit;
mod number;
pub mod openrave;
pub mod operation;
pub mod pose;
pub mod sdf;
pub mod shape;
pub mod spelling;
pub mod urdf;
mod xml;

pub use model::{Attachment, Object, Scene};
pub use operation::Operation;
pub use pose::Pose;
pub use shape::{Kind, Mesh, Shape, Solid, Triangles};
pub use spelling::{Color, Content, Limits, Mass, Model, Spelling};

/// All formats; JSON, the default, is the first. A text that several recognise is in the last of these.
pub const SPELLINGS: &[&Spelling] = &[
    &json::SPELLING,
    &moveit::SPELLING,
    &message::SPELLING,
    &mjcf::SPELLING,
    &sdf::SPELLING,
    &urdf::SPELLING,
    &openrave::SPELLING,
];

/// The format of that name.
#[must_use]
pub fn by_name(name: &str) -> Option<&'static Spelling> {
    SPELLINGS.iter().copied().find(|spelling| spelling.name == name)
}

/// The format that a text looks like.
#[must_use]
pub fn recognize(text: &str) -> Option<&'static Spelling> {
    SPELLINGS.iter().rev().copied().find(|spelling| (spelling.recognizes)(text))
}
