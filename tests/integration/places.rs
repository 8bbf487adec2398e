//! Places on a real mongod and on the embedded store: random geometries, stored and asked for.
//!
//! Every failure prints the seed; `RMEM_TEST_SEED` runs it again, and
//! `RMEM_TEST_PLACES` says how many rounds of 32 documents and 64 questions there are.

use std::collections::BTreeMap;

use bson::{Bson, Document, bson, doc};
use libtest_mimic::Failed;
use rmem::store::{Embedded, Find, Index, Namespace, Role, Store, StoreUri, open};

use crate::processes::seed;

type Case = fn(&str) -> Result<(), Failed>;

/// The cases, each over the address of a server.
pub(crate) const CASES: [(&str, Case); 3] = [
    ("mongodb::places::the_same_documents_are_in_the_same_regions", regions),
    ("mongodb::places::the_same_documents_are_as_near", distances),
    ("mongodb::places::the_same_documents_are_refused_by_an_index_of_places", refusals),
];

/// Random numbers from a seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit as u64) as usize
    }

    /// From 0 to less than 1.
    fn part(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn of<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }
}

type Point = [f64; 2];

/// A part of the world, and how coordinates are chosen in it.
#[derive(Clone, Copy)]
struct Area {
    centre: Point,
    size: f64,
    /// Coordinates on a lattice, so that edges touch and overlap.
    lattice: bool,
}

impl Area {
    fn random(random: &mut Random) -> Self {
        let size = *random.of(&[60.0, 20.0, 5.0, 0.1, 0.0005]);
        let lattice = random.below(2) == 0;
        let centre = [random.part() * 230.0 - 115.0, random.part() * 50.0 - 25.0];
        let centre = if random.below(3) == 0 { [0.0, 0.0] } else { centre.map(f64::round) };
        Self { centre, size, lattice }
    }

    fn point(self, random: &mut Random) -> Point {
        let step = self.size / 4.0;
        let mut offset = || {
            let offset = random.part() * 2.0 * self.size - self.size;
            if self.lattice { (offset / step).round() * step } else { offset }
        };
        let (x, y) = (offset(), offset());
        [self.centre[0] + x, self.centre[1] + y]
    }

    /// A ring around a point, seldom one that crosses itself.
    fn ring(self, random: &mut Random, scale: f64) -> (Point, Vec<Point>) {
        let middle = self.point(random);
        if self.lattice {
            let step = self.size / 4.0 * scale.max(0.25);
            let (width, height) = ((1 + random.below(4)) as f64 * step, (1 + random.below(4)) as f64 * step);
            let (x, y) = (middle[0], middle[1]);
            return (middle, vec![[x, y], [x + width, y], [x + width, y + height], [x, y + height]]);
        }
        let count = 3 + random.below(6);
        let mut angles: Vec<f64> = (0..count).map(|_| random.part() * std::f64::consts::TAU).collect();
        angles.sort_by(f64::total_cmp);
        let corner = |angle: f64, length: f64| {
            [middle[0] + self.size * scale * length * angle.cos(), middle[1] + self.size * scale * length * angle.sin()]
        };
        let corners = angles.into_iter().map(|angle| corner(angle, 0.2 + 0.8 * random.part())).collect();
        (middle, corners)
    }

    /// The rings of a polygon, sometimes with a hole.
    fn polygon(self, random: &mut Random) -> Vec<Vec<Point>> {
        let (middle, outer) = self.ring(random, 1.0);
        let mut rings = vec![outer.clone()];
        if random.below(4) == 0 {
            let middle = if self.lattice {
                [(outer[0][0] + outer[2][0]) / 2.0, (outer[0][1] + outer[2][1]) / 2.0]
            } else {
                middle
            };
            let inward = |point: &Point| [0, 1].map(|i| middle[i] + (point[i] - middle[i]) * 0.4);
            rings.push(outer.iter().map(inward).collect());
        }
        if random.below(2) == 0 {
            rings.iter_mut().for_each(|ring| ring.reverse());
        }
        rings
    }

    fn line(self, random: &mut Random) -> Vec<Point> {
        (0..2 + random.below(3)).map(|_| self.point(random)).collect()
    }
}

fn pairs(points: &[Point]) -> Bson {
    Bson::Array(points.iter().map(|point| bson!([point[0], point[1]])).collect())
}

fn closed(rings: &[Vec<Point>]) -> Bson {
    let close = |ring: &Vec<Point>| pairs(&ring.iter().chain(ring.first()).copied().collect::<Vec<_>>());
    Bson::Array(rings.iter().map(close).collect())
}

fn geojson(kind: &str, coordinates: Bson) -> Document {
    doc! {"type": kind, "coordinates": coordinates}
}

/// A GeoJSON geometry of any kind.
fn geometry(random: &mut Random, area: Area) -> Document {
    let point = |random: &mut Random| pairs(&[area.point(random)]).as_array().unwrap()[0].clone();
    let several = |random: &mut Random, one: &dyn Fn(&mut Random) -> Bson| {
        Bson::Array((0..1 + random.below(3)).map(|_| one(random)).collect())
    };
    match random.below(9) {
        0 | 1 => geojson("Point", point(random)),
        2 | 3 => geojson("LineString", pairs(&area.line(random))),
        4 | 5 => geojson("Polygon", closed(&area.polygon(random))),
        6 => geojson("MultiPoint", several(random, &point)),
        7 => match random.below(2) {
            0 => geojson("MultiLineString", several(random, &|random| pairs(&area.line(random)))),
            _ => geojson("MultiPolygon", several(random, &|random| closed(&area.polygon(random)))),
        },
        _ => {
            let parts: Vec<Document> = vec![
                geojson("Point", point(random)),
                geojson("LineString", pairs(&area.line(random))),
                geojson("Polygon", closed(&area.polygon(random))),
            ];
            let from = random.below(3);
            doc! {"type": "GeometryCollection", "geometries": parts[from..].to_vec()}
        }
    }
}

/// What a document has at its place.
fn place(random: &mut Random, area: Area) -> Bson {
    let point = area.point(random);
    match random.below(6) {
        0 => bson!([point[0], point[1]]),
        1 => bson!({"lng": point[0], "lat": point[1]}),
        _ => geometry(random, area).into(),
    }
}

fn question(random: &mut Random, area: Area) -> Document {
    let (a, b) = (area.point(random), area.point(random));
    match random.below(12) {
        0 => doc! {"$geoWithin": {"$box": pairs(&[a, b])}},
        1 => doc! {"$geoWithin": {"$polygon": pairs(&area.ring(random, 1.0).1)}},
        2 => doc! {"$geoWithin": {"$center": [pairs(&[a]).as_array().unwrap()[0].clone(), area.size * random.part()]}},
        3 | 4 => {
            let radius = area.size.to_radians() * *random.of(&[0.25, 0.5, 1.0, 2.0]) * random.part().max(0.5);
            doc! {"$geoWithin": {"$centerSphere": [pairs(&[a]).as_array().unwrap()[0].clone(), radius]}}
        }
        5 => {
            doc! {"$geoWithin": {"$geometry": geojson("MultiPolygon", bson!([closed(&area.polygon(random)), closed(&area.polygon(random))]))}}
        }
        6 => {
            let mut polygon = geojson("Polygon", closed(&area.polygon(random)[..1]));
            let name = "urn:x-mongodb:crs:strictwinding:EPSG:4326";
            polygon.insert("crs", doc! {"type": "name", "properties": {"name": name}});
            let operator = *random.of(&["$geoWithin", "$geoIntersects"]);
            doc! {operator: {"$geometry": polygon}}
        }
        7 | 8 => doc! {"$geoWithin": {"$geometry": geojson("Polygon", closed(&area.polygon(random)))}},
        _ => doc! {"$geoIntersects": {"$geometry": geometry(random, area)}},
    }
}

/// The two stores, with a collection of their own.
struct Both {
    server: Box<dyn Store>,
    embedded: Embedded,
    ns: Namespace,
    seed: u64,
}

impl Both {
    fn new(uri: &str, collection: &str) -> Result<Self, Failed> {
        let ns = Namespace { database: "places".to_owned(), collection: collection.to_owned() };
        let server = open(&StoreUri::parse(uri)?, Role::Shared)?;
        Ok(Self { server, embedded: Embedded::in_memory()?, ns, seed: seed() })
    }

    fn fresh(&self, indexes: &[Index]) -> Result<(), Failed> {
        for store in [self.server.as_ref(), &self.embedded] {
            store.drop(&self.ns)?;
            for index in indexes {
                store.create_index(&self.ns, index)?;
            }
        }
        Ok(())
    }

    /// Stores a document in both, or in neither; says whether that went well.
    fn insert(&self, document: &Document) -> Result<bool, Failed> {
        let there = self.server.insert(&self.ns, vec![document.clone()]);
        let here = self.embedded.insert(&self.ns, vec![document.clone()]);
        match (&there, &here) {
            (Ok(_), Ok(_)) => Ok(true),
            (Err(_), Err(_)) => Ok(false),
            _ => {
                let text = document.to_string();
                Err(format!("seed {}: storing {text}: mongod {there:?}, embedded {here:?}", self.seed).into())
            }
        }
    }

    fn failed(&self, question: &Document, there: &dyn std::fmt::Debug, here: &dyn std::fmt::Debug) -> Failed {
        let text = question.to_string();
        format!("seed {}: {text}\n mongod   {there:?}\n embedded {here:?}", self.seed).into()
    }
}

fn rounds(default: usize) -> usize {
    std::env::var("RMEM_TEST_PLACES").ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// The `_id`s of the matches, sorted; nothing where the question is refused.
fn matches(store: &dyn Store, ns: &Namespace, filter: Document) -> Option<Vec<i32>> {
    let found = store.find(ns, &Find { filter, ..Find::default() }).ok()?;
    let mut ids = found.map(|raw| Some(raw.ok()?.get_i32("_id").unwrap())).collect::<Option<Vec<_>>>()?;
    ids.sort_unstable();
    Some(ids)
}

fn regions(uri: &str) -> Result<(), Failed> {
    let both = Both::new(uri, "regions")?;
    let random = &mut Random(both.seed);
    for _ in 0..rounds(12) {
        both.fresh(&[])?;
        let area = Area::random(random);
        let mut stored = BTreeMap::new();
        for id in 0..32 {
            let at = place(random, area);
            both.insert(&doc! {"_id": id, "at": at.clone()})?;
            stored.insert(id, at);
        }
        for _ in 0..64 {
            let question = question(random, area);
            let filter = doc! {"at": question.clone()};
            let there = matches(both.server.as_ref(), &both.ns, filter.clone());
            let here = matches(&both.embedded, &both.ns, filter);
            if there != here && !is_excused(area, &there, &here, &stored) {
                let of = |ids: &Option<Vec<i32>>| ids.clone().unwrap_or_default();
                let differ: Vec<&Bson> = stored
                    .iter()
                    .filter(|(id, _)| of(&there).contains(id) != of(&here).contains(id))
                    .map(|(_, at)| at)
                    .collect();
                return Err(both.failed(&question, &there, &(here, differ)));
            }
        }
    }
    Ok(())
}

/// Known: whether a polygon is within another whose edge it shares, or meets it, is decided in
/// mongod by rectangles around the two, and so by rounding. The embedded store says that it is.
fn is_excused(area: Area, there: &Option<Vec<i32>>, here: &Option<Vec<i32>>, stored: &BTreeMap<i32, Bson>) -> bool {
    let (Some(there), Some(here)) = (there, here) else { return false };
    let only_here =
        |id: &i32| !there.contains(id) && stored.get(id).is_some_and(|at| at.to_string().contains("Polygon"));
    area.lattice
        && there.iter().all(|id| here.contains(id))
        && here.iter().all(|id| there.contains(id) || only_here(id))
}

/// The `_id`s with their distances, in order.
fn measured(store: &dyn Store, ns: &Namespace, near: &Document) -> Option<Vec<(i32, f64)>> {
    let found = store.aggregate(ns, (&[doc! {"$geoNear": near.clone()}]).into()).ok()?;
    found.map(|raw| raw.ok().map(|raw| (raw.get_i32("_id").unwrap(), raw.get_f64("far").unwrap()))).collect()
}

fn distances(uri: &str) -> Result<(), Failed> {
    let both = Both::new(uri, "distances")?;
    let random = &mut Random(both.seed);
    for round in 0..rounds(12) {
        let flat = round % 3 == 0;
        let kind = if flat { "2d" } else { "2dsphere" };
        both.fresh(&[Index::on(doc! {"at": kind})])?;
        let area = Area::random(random);
        for id in 0..32 {
            let at = if flat { bson!([area.point(random)[0], area.point(random)[1]]) } else { place(random, area) };
            both.insert(&doc! {"_id": id, "at": at})?;
        }
        for _ in 0..24 {
            let from = area.point(random);
            let pair = random.below(2) == 0 || flat;
            let near = if pair {
                bson!([from[0], from[1]])
            } else {
                bson!({"type": "Point", "coordinates": [from[0], from[1]]})
            };
            let spherical = !flat || random.below(2) == 0;
            let unit = match (pair, spherical) {
                (true, true) => area.size.to_radians(),
                (true, false) => area.size,
                (false, _) => area.size.to_radians() * 6_378_100.0,
            };
            let mut stage = doc! {"near": near.clone(), "distanceField": "far", "spherical": spherical};
            let (least, most) = (unit * random.part() * 0.5, unit * (0.5 + random.part()));
            if random.below(2) == 0 {
                stage.extend(doc! {"minDistance": least, "maxDistance": most});
            }
            let there = measured(both.server.as_ref(), &both.ns, &stage);
            let here = measured(&both.embedded, &both.ns, &stage);
            if !is_close(&there, &here, unit) {
                return Err(both.failed(&stage, &there, &here));
            }
            let operator = if spherical && pair { "$nearSphere" } else { "$near" };
            let filter = match pair {
                true => doc! {"at": {operator: near, "$minDistance": least, "$maxDistance": most}},
                false => doc! {"at": {operator: {"$geometry": near, "$minDistance": least, "$maxDistance": most}}},
            };
            let there = matches(both.server.as_ref(), &both.ns, filter.clone());
            let here = matches(&both.embedded, &both.ns, filter.clone());
            if there != here {
                return Err(both.failed(&filter, &there, &here));
            }
        }
    }
    Ok(())
}

/// Whether the same documents are as far, in the same order but for those that are equally far.
fn is_close(there: &Option<Vec<(i32, f64)>>, here: &Option<Vec<(i32, f64)>>, unit: f64) -> bool {
    let (Some(there), Some(here)) = (there, here) else { return there.is_none() && here.is_none() };
    let near = |a: f64, b: f64| (a - b).abs() <= unit * 1e-9 + a.abs() * 1e-9;
    let own: BTreeMap<i32, f64> = here.iter().copied().collect();
    there.len() == here.len()
        && there.iter().all(|(id, far)| own.get(id).is_some_and(|own| near(*far, *own)))
        && there.iter().zip(here).all(|((_, there), (_, here))| near(*there, *here))
}

fn refusals(uri: &str) -> Result<(), Failed> {
    let both = Both::new(uri, "refusals")?;
    let odd = [
        bson!(null),
        bson!([]),
        bson!({}),
        bson!("here"),
        bson!(5),
        bson!(true),
        bson!([1]),
        bson!([1, 2, 3]),
        bson!(["1", "2"]),
        bson!([[1, 2], [3, 4]]),
        bson!([[1, 2], 3]),
        bson!([[1, 2], [3]]),
        bson!([{"x": 1, "y": 2}, {"x": 3, "y": 4}]),
        bson!({"x": 1}),
        bson!({"x": 1, "y": "2"}),
        bson!({"x": 1, "y": 2, "z": "more"}),
        bson!({"a": [1, 2]}),
        bson!([181, 0]),
        bson!([180, 90]),
        bson!([0, 91]),
        bson!([-180, -180]),
        bson!([180, 0]),
        bson!([1e300, 0]),
        bson!([f64::NAN, 0]),
        bson!({"type": "Point"}),
        bson!({"type": "Point", "coordinates": [1, 2, 3]}),
        bson!({"type": "Point", "coordinates": [200, 2]}),
        bson!({"type": "point", "coordinates": [1, 2]}),
        bson!([{"type": "Point", "coordinates": [1, 2]}]),
        bson!({"type": "LineString", "coordinates": [[1, 2]]}),
        bson!({"type": "LineString", "coordinates": [[1, 2], [1, 2]]}),
        bson!({"type": "LineString", "coordinates": [[0, 0], [180, 0]]}),
        bson!({"type": "Polygon", "coordinates": []}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]]]}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 0], [1, 1], [0, 0]]]}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]], [[1, 1], [2, 1], [2, 2], [1, 1]]]}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]], [[0, 0], [2, 1], [2, 2], [0, 0]]]}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]], [[0, 0], [4, 4], [1, 3], [0, 0]]]}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]], [[1, 1], [9, 1], [9, 9], [1, 1]]]}),
        bson!({"type": "MultiPoint", "coordinates": []}),
        bson!({"type": "MultiPoint", "coordinates": [[1, 2]]}),
        bson!({"type": "MultiPolygon", "coordinates": [[[[0, 0], [1, 0], [1, 1], [0, 0]]], [[[0, 0], [1, 0], [1, 1], [0, 0]]]]}),
        bson!({"type": "GeometryCollection", "geometries": []}),
        bson!({"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [1, 2]}]}),
        bson!({"type": "GeometryCollection", "geometries": [[1, 2]]}),
        bson!({"type": "Point", "coordinates": [1, 2], "crs": {"type": "name", "properties": {"name": "EPSG:4326"}}}),
        bson!({"type": "Point", "coordinates": [1, 2], "crs": {"type": "name", "properties": {"name": "EPSG:3857"}}}),
        bson!({"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]],
            "crs": {"type": "name", "properties": {"name": "urn:x-mongodb:crs:strictwinding:EPSG:4326"}}}),
    ];
    let mut faults = Vec::new();
    for keys in [doc! {"at": "2dsphere"}, doc! {"at": "2d"}, doc! {"at.in": "2dsphere"}] {
        both.fresh(&[Index::on(keys.clone())])?;
        for (id, place) in odd.iter().enumerate() {
            for (nested, at) in
                [(0, place.clone()), (1, bson!({"in": place.clone()})), (2, bson!([{"in": place.clone()}]))]
            {
                let document = doc! {"_id": (id * 3 + nested) as i32, "at": at};
                if let Err(fault) = both.insert(&document) {
                    faults.push(format!("{keys}: {}", fault.message().unwrap_or_default()));
                }
            }
        }
    }
    if faults.is_empty() { Ok(()) } else { Err(faults.join("\n").into()) }
}
