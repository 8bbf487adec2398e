//! Geospatial queries: documents within a region, intersecting one, or near a point.
//!
//! Two geometries: the plane (`$box`, `$center`, `$polygon`, `$near` with a pair of
//! coordinates), in whatever unit the coordinates are, and the sphere (everything
//! else), with longitudes and latitudes in degrees and distances in metres.

mod geometry;
mod keys;
mod near;
mod plane;
mod reader;
mod region;
mod sphere;

pub(super) use keys::{Places, is_place};
pub use near::Near;
pub(super) use near::{Centre, OPERATORS, distance_of};
pub(super) use region::{Region, alone};
