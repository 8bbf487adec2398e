//! `$near`, `$nearSphere` and `$geoNear`: documents by their distance from a point.

use bson::{Bson, Document, RawDocument, RawDocumentBuf};

use super::geometry::{Geometry, Position, Spot};
use super::plane;
use super::reader;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::path::Path;
use crate::query::view::{Fields, View};

/// The radius of the earth in metres, as MongoDB has it.
const EARTH: f64 = 6_378_100.0;

/// Operators that ask for what is near.
pub(in crate::query) const OPERATORS: [&str; 3] = ["$near", "$nearSphere", "$geoNear"];

/// A point with the distances from it that are asked for.
#[derive(Debug)]
pub struct Near {
    path: Path,
    centre: Centre,
    /// In the unit of the centre.
    least: f64,
    most: f64,
}

/// A point, and how distances from it are measured.
#[derive(Debug, Clone, Copy)]
pub(in crate::query) enum Centre {
    /// On the plane, in the unit of the coordinates.
    Plane(Plane),
    /// On the sphere, in radians: a pair of coordinates with `$nearSphere`.
    Radians(SpherePoint),
    /// On the sphere, in metres: GeoJSON.
    Metres(SpherePoint),
}

/// A point of the plane.
#[derive(Debug, Clone, Copy)]
pub(in crate::query) struct Plane(plane::Point);

/// A point of the sphere.
#[derive(Debug, Clone, Copy)]
pub(in crate::query) struct SpherePoint(Spot);

/// A point with the distances, without the path of the documents' points.
struct Asked {
    centre: Centre,
    least: f64,
    most: f64,
}

impl Near {
    /// Reads the operators under a path, of which the first is one of [`OPERATORS`].
    ///
    /// # Errors
    /// If they do not describe one point, or something else stands beside them.
    pub(in crate::query) fn parse(path: &str, operators: &Document) -> Result<Self> {
        let asked = match pair_form(operators)? {
            Some(asked) => asked,
            None => geojson_form(operators)?,
        };
        Ok(Self { path: Path::parse(path)?, centre: asked.centre, least: asked.least, most: asked.most })
    }

    /// What is within two distances of a point, by what documents have at the path.
    ///
    /// # Errors
    /// If the path is too long.
    pub(in crate::query) fn new(path: &str, centre: Centre, least: f64, most: f64) -> Result<Self> {
        Ok(Self { path: Path::parse(path)?, centre, least, most })
    }

    /// Where documents have their place.
    #[must_use]
    pub fn path(&self) -> &str {
        self.path.text()
    }

    /// Returns whether an index of this type can answer; without one MongoDB refuses the query.
    #[must_use]
    pub fn is_answered_by(&self, index_type: &str) -> bool {
        match self.centre {
            Centre::Plane(_) => index_type == "2d",
            Centre::Radians(_) => index_type == "2d" || index_type == "2dsphere",
            Centre::Metres(_) => index_type == "2dsphere",
        }
    }

    /// Returns the type of index that can answer.
    #[must_use]
    pub fn index_type(&self) -> &'static str {
        if let Centre::Plane(_) = self.centre { "2d" } else { "2dsphere" }
    }

    /// Returns the point on the plane that is asked about, where it is there.
    pub(in crate::query) fn flat(&self) -> Option<(f64, f64)> {
        if let Centre::Plane(Plane(point)) = self.centre { Some(point) } else { None }
    }

    /// How far off a document is, where it has a place within the distances.
    #[must_use]
    pub fn distance(&self, document: &RawDocument) -> Option<f64> {
        Some(self.nearest(document.into())?.0)
    }

    /// [`Near::distance`] with the value of the document that is so far off.
    pub(in crate::query) fn nearest<'a>(&self, fields: Fields<'a>) -> Option<(f64, View<'a>)> {
        let mut nearest: Option<(f64, View<'a>)> = None;
        let mut take = |value: View<'a>, geometry: &Geometry| {
            let distance = self.centre.distance(geometry);
            if let Some(distance) = distance.filter(|new| nearest.is_none_or(|(old, _)| *new < old)) {
                nearest = Some((distance, value));
            }
        };
        self.path.any(fields, false, &mut |value, _| {
            if let Some(value @ (View::Document(_) | View::Array(_))) = value {
                match (reader::stored(value), value) {
                    (Ok(geometry), _) => take(value, &geometry),
                    (Err(_), View::Array(items)) => {
                        let places = items.iter().filter_map(|item| Some((item, reader::stored(item).ok()?)));
                        places.for_each(|(item, geometry)| take(item, &geometry));
                    }
                    (Err(_), _) => {}
                }
            }
            false
        });
        nearest.filter(|(distance, _)| (self.least..=self.most).contains(distance))
    }

    /// Returns the documents that are within the distances, the nearest first; equally near ones stay in their order.
    ///
    /// # Errors
    /// The first error of the input.
    pub fn sort<E>(
        &self,
        documents: impl Iterator<Item = std::result::Result<RawDocumentBuf, E>>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut placed = Vec::new();
        for document in documents {
            let document = document?;
            if let Some(distance) = self.distance(&document) {
                placed.push((distance, document));
            }
        }
        placed.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(placed.into_iter().map(|(_, document)| document).collect())
    }
}

impl Centre {
    /// Reads a point: GeoJSON, or a pair of coordinates, which is on the sphere where the operator asks for that.
    ///
    /// # Errors
    /// If it is neither, or not on the sphere.
    pub(in crate::query) fn parse(value: View<'_>, on_sphere: bool) -> Result<Self> {
        match value {
            View::Document(fields) if !reader::begins_with_number(fields) => {
                let position = reader::point(fields)?;
                spot(position).map(|spot| Self::Metres(SpherePoint(spot)))
            }
            value => {
                let point = reader::pair(Some(value), false)?;
                match on_sphere {
                    true => spot(reader::on_sphere(point)?).map(|spot| Self::Radians(SpherePoint(spot))),
                    false => Ok(Self::Plane(Plane(point))),
                }
            }
        }
    }

    fn distance(&self, geometry: &Geometry) -> Option<f64> {
        match self {
            Self::Plane(Plane(centre)) => Some(plane::distance(*centre, geometry.flat()?)),
            // By way of metres, as MongoDB does, which costs a digit.
            Self::Radians(SpherePoint(spot)) => Some(geometry.distance(spot.point)? * EARTH / EARTH),
            Self::Metres(SpherePoint(spot)) => Some(geometry.distance(spot.point)? * EARTH),
        }
    }
}

fn spot(position: Position) -> Result<Spot> {
    position.sphere.ok_or_else(|| QueryError::bad_value("the point is not on the sphere"))
}

/// `{$near: [x, y], $maxDistance: d}`, and GeoJSON in the place of the pair.
fn pair_form(operators: &Document) -> Result<Option<Asked>> {
    let (mut centre, mut least, mut most) = (None, 0.0, f64::INFINITY);
    for (name, value) in operators {
        match name.as_str() {
            "$minDistance" => least = distance_of(name, value).map_err(|error| beside(error, value, LEAST))?,
            "$maxDistance" => most = distance_of(name, value).map_err(|error| beside(error, value, MOST))?,
            "$uniqueDocs" => {}
            name if OPERATORS.contains(&name) => {
                let sphere = name == "$nearSphere";
                match value {
                    // Without `$geometry` the document is the point itself.
                    Bson::Document(point) if point.keys().any(|key| key.starts_with('$')) => return Ok(None),
                    Bson::Document(_) => match Centre::parse(value.into(), sphere) {
                        Ok(point) => centre = Some(point),
                        Err(error) if is_about_bounds(value, sphere) => return Err(error),
                        Err(_) => return Ok(None),
                    },
                    Bson::Array(items) => {
                        let (point, limit) = array_point(items, sphere)?;
                        centre = Some(point);
                        most = limit.unwrap_or(most);
                    }
                    _ => {
                        return Err(QueryError::bad_value(format!("{name} needs a point, an array or an object")));
                    }
                }
            }
            other => return Err(QueryError::invalid(34_413, format!("{other} cannot stand beside a geo near query"))),
        }
    }
    Ok(centre.map(|centre| Asked { centre, least, most }))
}

/// Returns whether a pair is one, but of no longitude and latitude.
fn is_about_bounds(value: &Bson, on_sphere: bool) -> bool {
    on_sphere && reader::pair(Some(value.into()), false).is_ok()
}

/// `[x, y]`, or `[x, y, greatest distance]`.
fn array_point(items: &[Bson], on_sphere: bool) -> Result<(Centre, Option<f64>)> {
    let with_limit = items.len() == 3;
    let point = Bson::Array(items.iter().take(if with_limit { 2 } else { items.len() }).cloned().collect());
    let limit = match items.get(2) {
        Some(limit) if with_limit => Some(distance_of("the third number of a point", limit)?),
        _ => None,
    };
    Ok((Centre::parse((&point).into(), on_sphere)?, limit))
}

/// `{$near: {$geometry: POINT, $maxDistance: metres}}`.
fn geojson_form(operators: &Document) -> Result<Asked> {
    let (1, Some((_, Bson::Document(arguments)))) = (operators.len(), operators.iter().next()) else {
        return Err(QueryError::bad_value("nothing can stand beside a geo near query with a $geometry"));
    };
    let (mut centre, mut least, mut most) = (None, 0.0, f64::INFINITY);
    for (name, value) in arguments {
        match (name.as_str(), value) {
            ("$geometry", Bson::Document(_) | Bson::Array(_)) => match Centre::parse(value.into(), true)? {
                point @ Centre::Metres(_) => centre = Some(point),
                _ => return Err(QueryError::bad_value("the $geometry of a geo near query must be a GeoJSON Point")),
            },
            ("$geometry", _) => {}
            ("$minDistance", _) => least = finite_distance(name, value)?,
            ("$maxDistance", _) => most = finite_distance(name, value)?,
            _ => return Err(QueryError::bad_value(format!("{name} is not an argument of a geo near query"))),
        }
    }
    let centre = centre.ok_or_else(|| QueryError::bad_value("a geo near query needs a point, or a $geometry"))?;
    Ok(Asked { centre, least, most })
}

/// MongoDB's codes for distances beside a legacy point that are no numbers; the next one is for negative distances.
const LEAST: i32 = 16_893;
const MOST: i32 = 16_895;

/// Returns the error for a distance beside a legacy point, with MongoDB's code.
fn beside(error: QueryError, value: &Bson, code: i32) -> QueryError {
    QueryError { code: if Number::of(value).is_some() { code + 1 } else { code }, ..error }
}

/// Returns a distance, which is not negative.
///
/// # Errors
/// If it is, or no number.
pub(in crate::query) fn distance_of(name: &str, value: &Bson) -> Result<f64> {
    let number = Number::of(value).ok_or_else(|| QueryError::bad_value(format!("{name} must be a number")))?;
    let distance = number.to_double();
    if distance >= 0.0 { Ok(distance) } else { Err(QueryError::bad_value(format!("{name} must not be negative"))) }
}

/// Returns a distance, which is not negative and not infinite.
fn finite_distance(name: &str, value: &Bson) -> Result<f64> {
    let distance = distance_of(name, value)?;
    if distance.is_finite() { Ok(distance) } else { Err(QueryError::bad_value(format!("{name} must be finite"))) }
}
