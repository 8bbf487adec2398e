//! Geometry on the sphere, as S2 has it: edges are the shortest ways between
//! points, and a point is as large as a cell of about a centimetre.

mod bounds;
mod cap;
mod cell;
mod edge;
mod line;
mod polygon;
mod ring;
mod vector;

pub(super) use cap::Cap;
pub(super) use cell::Cell;
pub(super) use line::Line;
pub(super) use polygon::{BigPolygon, Polygon};
pub(super) use vector::Vector;
