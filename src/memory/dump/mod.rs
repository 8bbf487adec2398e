//! Dumps of world models: written, read, restored, compared.
//!
//! A dump is a world file ([`world_file`]), or a folder or an archive as `mongodump` writes it ([`mod@write`]); [`read`] reads
//! all of them alike.

mod batch;
pub mod diff;
mod dry_run;
mod error;
mod oplog;
pub mod read;
pub mod restore;
pub mod world_file;
pub mod write;

pub use error::RestoreError;
