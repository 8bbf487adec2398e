//! The geospatial keys of an index, and the checks of documents that they require.

use bson::{Bson, Document, RawDocument};

use super::near::Near;
use super::reader;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::path::Path;
use crate::query::view::View;

/// MongoDB's code for a document that has no geometry where a `2dsphere` index wants one.
const NO_GEOMETRY: i32 = 16_755;
/// MongoDB's code for a document that has no pair of coordinates where a `2d` index wants one.
const NO_PAIR: i32 = 13_654;
/// MongoDB's code for a pair that is not within the bounds of a `2d` index.
const OUT_OF_BOUNDS: i32 = 16_433;
/// MongoDB's code for an index that cannot be.
const INVALID_OPTIONS: i32 = 67;
/// MongoDB's code for options of a `2d` index that are not acceptable.
const BAD_OPTION: i32 = 2;

/// The geospatial keys of an index.
#[derive(Debug)]
pub(in crate::query) struct Places {
    keys: Vec<(Path, Surface)>,
}

/// The surface that the coordinates of a key are on.
#[derive(Debug, Clone, Copy)]
enum Surface {
    /// The plane, from the least coordinate to less than the greatest.
    Plane(f64, f64),
    Sphere,
}

impl Places {
    /// Reads a key pattern with the options of the index.
    ///
    /// # Errors
    /// If MongoDB refuses them.
    pub(in crate::query) fn parse(pattern: &Document, options: &Document) -> Result<Self> {
        let plane = read_options(options)?;
        let mut keys = Vec::new();
        for (place, (name, index_type)) in pattern.iter().enumerate() {
            match index_type.as_str() {
                Some("2d") if place > 0 => {
                    return Err(QueryError::invalid(INVALID_OPTIONS, "the 2d key of an index must be its first"));
                }
                Some("2d") => keys.push((Path::parse(name)?, plane)),
                Some(_) => keys.push((Path::parse(name)?, Surface::Sphere)),
                None => {}
            }
        }
        Ok(Self { keys })
    }

    /// Checks that a document has geometries where it has anything.
    ///
    /// # Errors
    /// If it has something else, or a position that is out of bounds.
    pub(in crate::query) fn check(&self, document: &RawDocument) -> Result<()> {
        for (path, surface) in &self.keys {
            let mut checked = Ok(());
            path.any(document.into(), false, &mut |value, _| {
                checked = match (value, surface) {
                    (None | Some(View::Null | View::Undefined), _) => Ok(()),
                    (Some(value), Surface::Sphere) => check_geometry(value),
                    (Some(value), Surface::Plane(least, greatest)) => check_pairs(value, *least, *greatest),
                };
                checked.is_err()
            });
            checked.map_err(|error: QueryError| QueryError {
                message: format!("the index on {} cannot have the document: {}", path.text(), error.message),
                ..error.about(path.text())
            })?;
        }
        Ok(())
    }

    /// Checks that the point of a question is within the bounds.
    ///
    /// # Errors
    /// If it is not.
    pub(in crate::query) fn check_centre(&self, near: &Near) -> Result<()> {
        for (path, surface) in &self.keys {
            if let (Surface::Plane(least, greatest), Some(point)) = (surface, near.flat())
                && path.text() == near.path()
            {
                check_bounds(point, *least, *greatest)?;
            }
        }
        Ok(())
    }
}

/// Checks the options and gives the bounds of the plane: by default those of longitudes.
fn read_options(options: &Document) -> Result<Surface> {
    let bound = |name: &str, default: f64| match options.get(name) {
        None => Ok(default),
        Some(value) => Number::of(value)
            .map(Number::to_double)
            .ok_or_else(|| QueryError::type_mismatch(format!("the option {name} of an index must be a number"))),
    };
    let (least, greatest) = (bound("min", -180.0)?, bound("max", 180.0)?);
    if least >= greatest {
        return Err(QueryError::invalid(BAD_OPTION, "the option min of an index must be less than max"));
    }
    if let Some(version) = options.get("2dsphereIndexVersion") {
        let number = Number::of(version)
            .ok_or_else(|| QueryError::type_mismatch("the option 2dsphereIndexVersion of an index must be a number"))?;
        if !number.integral().is_some_and(|version| (1..=3).contains(&version)) {
            return Err(QueryError::invalid(INVALID_OPTIONS, "the 2dsphereIndexVersion of an index must be 1, 2 or 3"));
        }
    }
    if let Some(bits) = options.get("bits")
        && !Number::of(bits).map(Number::to_long).is_some_and(|bits| (1..=32).contains(&bits))
    {
        return Err(QueryError::invalid(INVALID_OPTIONS, "the option bits of an index must be from 1 to 32"));
    }
    Ok(Surface::Plane(least, greatest))
}

fn check_geometry(value: View<'_>) -> Result<()> {
    match reader::stored(value) {
        _ if is_empty(value) => Ok(()),
        Ok(geometry) if geometry.shapes().is_some() => Ok(()),
        Ok(_) => Err(QueryError::invalid(NO_GEOMETRY, "the geometry is not on the sphere")),
        Err(error) => Err(QueryError { code: NO_GEOMETRY, ..error }),
    }
}

fn check_pairs(value: View<'_>, least: f64, greatest: f64) -> Result<()> {
    let check = |value: View<'_>| match reader::pair(Some(value), true) {
        _ if is_empty(value) => Ok(()),
        Ok(point) => check_bounds(point, least, greatest),
        Err(error) => Err(QueryError { code: NO_PAIR, ..error }),
    };
    // What is neither a pair nor has pairs is passed over, as MongoDB does.
    match value {
        View::Array(items) if matches!(items.get(0), Some(View::Number(_))) => check(value),
        View::Document(fields) if reader::begins_with_number(fields) => check(value),
        View::Array(items) => items.iter().try_for_each(check),
        View::Document(fields) => fields.iter().try_for_each(|(_, value)| check(value)),
        _ => Ok(()),
    }
}

fn is_empty(value: View<'_>) -> bool {
    match value {
        View::Array(items) => items.is_empty(),
        View::Document(fields) => fields.iter().next().is_none(),
        _ => false,
    }
}

fn check_bounds((x, y): (f64, f64), least: f64, greatest: f64) -> Result<()> {
    let inside = |number: f64| number >= least && number <= greatest;
    if inside(x) && inside(y) {
        return Ok(());
    }
    let message = format!("the point ({x}, {y}) is not between {least} and {greatest}, the bounds of the 2d index");
    Err(QueryError::invalid(OUT_OF_BOUNDS, message))
}

/// Returns whether a key of a pattern is `2d` or `2dsphere`.
pub(in crate::query) fn is_place(direction: &Bson) -> bool {
    matches!(direction.as_str(), Some("2d" | "2dsphere"))
}
