//! Scenes of a memory: what a motion planner has to know, from documents and back.
//!
//! [`extract`] reads documents into a [`crate::formats::scene::Scene`], every pose resolved into one frame;
//! [`diff`] compares two scenes as operations, [`apply`] brings a scene or operations back into documents,
//! [`follow`] gives operations as they happen, [`check`] finds objects that overlap, and [`outline`] gives
//! what is seen from above. How scenes are spelled is the business of [`crate::formats::scene`].

pub mod apply;
pub mod check;
pub mod diff;
pub mod distance;
pub mod extract;
pub mod follow;
pub mod kind;
pub mod mesh;
pub mod outline;
pub mod reported;

pub use extract::{Extraction, Invalid, Located, Reason, Sources};
pub use kind::ObjectKind;
