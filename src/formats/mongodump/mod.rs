//! What `mongodump` writes: a folder a database, and in it, a collection each,
//! `COLL.bson` and `COLL.metadata.json`; or all in one file, an archive. Plain
//! or compressed with gzip.
//!
//! Source: the manual of MongoDB's database tools and their specification of archives, and the BSON specification
//! (a document starts with its length, little-endian, and ends with a zero).
//! Nothing here trusts a file: each length is checked before memory is
//! allocated, and what is wrong is reported with its place in bytes.

mod archive;
mod checksum;
mod metadata;
mod name;
mod packing;
mod stream;

pub use archive::{Archive, ArchiveWriter, Archived, MAGIC};
pub use metadata::{CollectionKind, Metadata};
pub use name::{decode, encode};
pub use packing::{Packer, unpack};
pub use stream::{Damage, Documents, decode_document};
