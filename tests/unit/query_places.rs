//! Places in queries: what is in a region, on the plane and on the sphere.

use bson::{Bson, Document, RawDocumentBuf, bson, doc};
use rmem::query::Filter;

fn matches(query: Document, place: impl Into<Bson>) -> bool {
    let document = RawDocumentBuf::try_from(&doc! {"at": place.into()}).unwrap();
    Filter::parse(&doc! {"at": query}).unwrap().matches(&document).unwrap()
}

fn refused(query: Document) -> String {
    let error = Filter::parse(&doc! {"at": query}).unwrap_err();
    assert_eq!(error.code, 2);
    error.message
}

fn point(longitude: f64, latitude: f64) -> Bson {
    bson!({"type": "Point", "coordinates": [longitude, latitude]})
}

fn polygon(corners: &[[f64; 2]]) -> Bson {
    let ring: Vec<Bson> = corners.iter().chain(corners.first()).map(|corner| bson!([corner[0], corner[1]])).collect();
    bson!({"type": "Polygon", "coordinates": [ring]})
}

#[test]
fn a_room_of_the_plane_is_measured_in_any_unit() {
    let area = doc! {"$geoWithin": {"$box": [[0, 0], [6.5, 4]]}};
    assert!(matches(area.clone(), bson!([6.5, 0])));
    assert!(matches(area.clone(), bson!({"x": 1, "y": 2i64})));
    assert!(matches(area.clone(), bson!([{"x": 9, "y": 9}, {"x": 1, "y": 1}])));
    assert!(matches(area.clone(), point(1.0, 1.0)));
    for outside in
        [bson!([7, 1]), bson!([]), bson!(["1", "2"]), Bson::Null, polygon(&[[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]])]
    {
        assert!(!matches(area.clone(), outside));
    }
    assert!(matches(doc! {"$not": area}, bson!([7000, 1])));
    assert!(matches(doc! {"$geoWithin": {"$center": [[1000, 1000], 5]}}, bson!([1003, 1004])));
    assert!(!matches(doc! {"$geoWithin": {"$center": [[1000, 1000], 5]}}, bson!([1003, 1004.01])));
}

#[test]
fn edges_on_the_sphere_are_geodesic() {
    let corners = [[-60.0, 10.0], [60.0, 10.0], [60.0, 40.0], [-60.0, 40.0]];
    let region = doc! {"$geoWithin": {"$geometry": polygon(&corners)}};
    // North of the parallel between the upper corners, and of the one between the lower ones.
    assert!(matches(region.clone(), point(0.0, 55.0)));
    assert!(!matches(region.clone(), point(0.0, 12.0)));
    // The same corners on the plane.
    let flat = doc! {"$geoWithin": {"$polygon": corners.iter().map(|corner| bson!([corner[0], corner[1]])).collect::<Vec<_>>()}};
    assert!(!matches(flat.clone(), bson!([0, 55])));
    assert!(matches(flat, bson!([0, 12])));
    assert!(matches(region, bson!([0, 55])));
}

#[test]
fn a_polygon_has_its_edge_and_not_its_hole() {
    let region = doc! {"$geoWithin": {"$geometry": {"type": "Polygon", "coordinates": [
        [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]], [[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]]
    ]}}};
    assert!(matches(region.clone(), point(0.0, 0.0)) && matches(region.clone(), point(4.0, 5.0)));
    assert!(!matches(region.clone(), point(5.0, 5.0)));
    let line = |from: [f64; 2], to: [f64; 2]| bson!({"type": "LineString", "coordinates": [[from[0], from[1]], [to[0], to[1]]]});
    assert!(matches(region.clone(), line([1.0, 1.0], [1.0, 9.0])));
    assert!(!matches(region.clone(), line([1.0, 5.0], [9.0, 5.0])));
    let several = |points: &[[f64; 2]]| {
        let points: Vec<Bson> = points.iter().map(|point| bson!([point[0], point[1]])).collect();
        bson!({"type": "MultiPoint", "coordinates": points})
    };
    assert!(matches(region.clone(), several(&[[1.0, 1.0], [9.0, 9.0]])));
    assert!(!matches(region, several(&[[1.0, 1.0], [5.0, 5.0]])));
}

#[test]
fn geometries_intersect_where_they_have_a_point_in_common() {
    let corridor = bson!({"type": "LineString", "coordinates": [[0, 0], [10, 0]]});
    let meets = |geometry: &Bson, place: Bson| matches(doc! {"$geoIntersects": {"$geometry": geometry.clone()}}, place);
    assert!(meets(&corridor, bson!({"type": "LineString", "coordinates": [[5, -1], [5, 1]]})));
    assert!(!meets(&corridor, bson!({"type": "LineString", "coordinates": [[5, 1], [5, 2]]})));
    assert!(meets(&corridor, point(5.0, 0.0)) && !meets(&corridor, point(5.0, 0.001)));
    assert!(meets(&corridor, polygon(&[[4.0, -1.0], [6.0, -1.0], [6.0, 1.0], [4.0, 1.0]])));
    assert!(meets(&point(5.0, 0.0), corridor.clone()) && meets(&point(1.0, 2.0), point(1.0, 2.0)));
    let collection = bson!({"type": "GeometryCollection", "geometries": [point(50.0, 50.0), corridor.clone()]});
    assert!(meets(&corridor, collection.clone()) && meets(&collection, point(50.0, 50.0)));
}

#[test]
fn a_cap_is_measured_along_the_sphere() {
    // 100 km around Aachen.
    let around = doc! {"$geoWithin": {"$centerSphere": [[6.08, 50.78], 100.0 / 6378.1]}};
    assert!(matches(around.clone(), point(6.96, 50.94)));
    assert!(!matches(around.clone(), point(8.68, 50.11)));
    assert!(matches(around, bson!({"type": "LineString", "coordinates": [[6.1, 50.8], [6.9, 50.9]]})));
    let all = doc! {"$geoWithin": {"$centerSphere": [[0, 0], 4]}};
    assert!(matches(all, point(180.0, 0.0)));
}

#[test]
fn a_polygon_of_strict_winding_may_be_most_of_the_sphere() {
    let mut region = polygon(&[[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0]]);
    let strict = bson!({"type": "name", "properties": {"name": "urn:x-mongodb:crs:strictwinding:EPSG:4326"}});
    region.as_document_mut().unwrap().insert("crs", strict);
    let region = doc! {"$geoWithin": {"$geometry": region}};
    assert!(matches(region.clone(), point(-100.0, -40.0)));
    assert!(!matches(region.clone(), point(5.0, 5.0)));
    assert!(matches(region.clone(), polygon(&[[20.0, 20.0], [30.0, 20.0], [30.0, 30.0]])));
    assert!(!matches(region, polygon(&[[5.0, 5.0], [30.0, 20.0], [30.0, 30.0]])));
}

#[test]
fn what_is_no_region_is_refused_with_the_reason() {
    let geometry =
        |kind: &str, coordinates: Bson| doc! {"$geoWithin": {"$geometry": {"type": kind, "coordinates": coordinates}}};
    let square = || bson!([[0, 0], [1, 0], [1, 1], [0, 1]]);
    assert!(refused(geometry("Polygon", bson!([square()]))).contains("not closed"));
    assert!(
        refused(geometry("Polygon", bson!([[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]]))).contains("edges 0 and 2 cross")
    );
    assert!(refused(geometry("Polygon", bson!([[[0, 0], [1, 0], [0, 0]]]))).contains("at least 3"));
    assert!(refused(geometry("Polygon", bson!([[[0, 0], [1, 0], [1, 91], [0, 0]]]))).contains("out of bounds"));
    assert!(refused(geometry("Point", bson!([0, 0]))).contains("needs a Polygon"));
    assert!(refused(geometry("Square", bson!([0, 0]))).contains("unknown GeoJSON type"));
    assert!(refused(doc! {"$geoWithin": {"$center": [[0, 0], -1]}}).contains("not negative"));
    assert!(refused(doc! {"$geoWithin": {"$polygon": [[0, 0], [1, 1]]}}).contains("at least 3 points"));
    assert!(refused(doc! {"$geoWithin": {"$circle": [[0, 0], 1]}}).contains("$circle"));
    assert!(refused(doc! {"$geoWithin": {"$box": [[0, 0], [1, 1]]}, "$exists": true}).contains("$exists"));
    assert!(refused(doc! {"$geoIntersects": {"$box": [[0, 0], [1, 1]]}}).contains("$geometry"));
}
