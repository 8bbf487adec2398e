//! Places: which documents lie in a region, have a part of one, or are near a point.
//!
//! Two geometries: the plane (`$box`, `$center`, `$polygon`, `$near` with a pair of
//! coordinates), in whatever unit the coordinates are, and the sphere (everything
//! else), with longitudes and latitudes in degrees and distances in metres.

mod geometry;
mod plane;
mod reader;
mod region;
mod sphere;

pub(super) use region::{Region, alone};
