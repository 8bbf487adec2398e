//! What is different between two scenes, as operations.

use bson::{Document, doc};

use super::{Attachment, Object, Pose, document};

/// A change of a scene. Poses are in the scene's frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// There is a new object.
    Add(Box<Object>),
    /// There is an object no more.
    Remove {
        /// Its name.
        name: String,
    },
    /// An object is elsewhere.
    Move {
        /// Its name.
        name: String,
        /// Where it is now.
        pose: Pose,
    },
    /// An object was taken.
    Attach {
        /// Its name.
        name: String,
        /// By what.
        attachment: Attachment,
    },
    /// An object was let go.
    Detach {
        /// Its name.
        name: String,
        /// By what.
        link: String,
    },
    /// Everything but pose and attachment is as in this object: its shapes, colours, mass, or
    /// whether it moves.
    Reshape(Box<Object>),
}

impl Operation {
    /// What it is called.
    #[must_use]
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Add(_) => "add",
            Self::Remove { .. } => "remove",
            Self::Move { .. } => "move",
            Self::Attach { .. } => "attach",
            Self::Detach { .. } => "detach",
            Self::Reshape(_) => "reshape",
        }
    }

    /// The object that it is about.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Add(object) | Self::Reshape(object) => &object.name,
            Self::Remove { name } | Self::Move { name, .. } | Self::Attach { name, .. } | Self::Detach { name, .. } => {
                name
            }
        }
    }

    /// The operation as a document: `operation`, `name`, `frame`, and the keys of an object
    /// that it is about.
    #[must_use]
    pub fn to_document(&self, frame: Option<&str>) -> Document {
        let mut written = doc! { "operation": self.word(), "name": self.name() };
        let mut framed = || written.extend(frame.map(|frame| ("frame".to_owned(), frame.into())));
        match self {
            Self::Add(object) => {
                framed();
                written.extend(document::write(object));
            }
            Self::Move { pose, .. } => {
                framed();
                written.extend(document::pose_keys(pose));
            }
            Self::Attach { attachment, .. } => {
                drop(written.insert("attached_to", document::attachment_value(attachment)))
            }
            Self::Detach { link, .. } => drop(written.insert("attached_to", doc! { "link": link })),
            Self::Reshape(object) => written.extend(shape_keys(object)),
            Self::Remove { .. } => {}
        }
        written
    }

    /// Reads what [`Operation::to_document`] wrote, but for the frame.
    ///
    /// # Errors
    /// Which key is wrong.
    pub fn read(written: &Document) -> Result<Self, String> {
        let word = written.get_str("operation").map_err(|_| "it has no `operation`".to_owned())?;
        let name = written.get_str("name").map_err(|_| "it has no `name`".to_owned())?.to_owned();
        let object = || document::read(written).map(|object| Box::new(Object { name: name.clone(), ..object }));
        Ok(match word {
            "add" => Self::Add(object()?),
            "remove" => Self::Remove { name },
            "move" => Self::Move { pose: document::pose(written)?, name },
            "attach" | "detach" => {
                let attachment = attachment(written)?;
                if word == "attach" {
                    Self::Attach { name, attachment }
                } else {
                    Self::Detach { name, link: attachment.link }
                }
            }
            "reshape" => {
                let mut placed = written.clone();
                placed.extend(document::pose_keys(&Pose::IDENTITY));
                Self::Reshape(Box::new(Object { name, ..document::read(&placed)? }))
            }
            other => {
                return Err(format!(
                    "there is no operation `{other}`; expected add, remove, move, attach, detach or reshape"
                ));
            }
        })
    }
}

/// The keys of an object but for its pose and attachment.
#[must_use]
pub fn shape_keys(object: &Object) -> Document {
    let mut written = document::write(&Object { attachment: None, ..object.clone() });
    written.remove("translation");
    written.remove("rotation");
    written
}

/// Reads `attached_to` through an object that has nothing else.
fn attachment(written: &Document) -> Result<Attachment, String> {
    let mut placed = document::pose_keys(&Pose::IDENTITY);
    placed.extend(written.get("attached_to").map(|value| ("attached_to".to_owned(), value.clone())));
    document::read(&placed)?.attachment.ok_or_else(|| "it has no `attached_to`".to_owned())
}
