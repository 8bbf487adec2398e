//! A browser of the memory in a terminal: collections, their documents, one document, plans and computables.
//!
//! [`Browser`] is what is seen and how keys change it; it knows nothing of terminals. [`draw`] puts it on a frame.
//! A collection that is open is watched, and read again when it changes.

mod draw;
mod state;

pub use draw::draw;
pub use state::{Browser, Key};
