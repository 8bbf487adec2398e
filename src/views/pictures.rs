//! Charts as pictures, where rmem was built with the feature `pictures` (a fifth of the time that its build takes).

#[cfg(feature = "pictures")]
pub use super::drawing::{Picture, grid};
#[cfg(not(feature = "pictures"))]
pub use super::undrawn::{Picture, grid};
use crate::fault::{AtFault, Fault};

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[error("this rmem was built without pictures; build it with --features pictures")]
pub struct Undrawn;

impl AtFault for Undrawn {
    fn fault(&self) -> Fault {
        Fault::Usage
    }
}

/// Whether this rmem can draw, for who wants to know before long work.
///
/// # Errors
/// If it was built without pictures.
pub const fn ready() -> Result<(), Undrawn> {
    if cfg!(feature = "pictures") { Ok(()) } else { Err(Undrawn) }
}
