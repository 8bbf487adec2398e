//! Objects that overlap, or are closer than they should be.

use super::distance::{Body, distance};
use crate::formats::scene::{Object, Scene};

/// What is less deep than this touches and does not overlap: a cup on a table.
pub const TOUCH: f64 = 1e-6;

/// Two objects and how near they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Proximity<'a> {
    /// The one that comes first in the scene.
    pub first: &'a str,
    /// The other.
    pub second: &'a str,
    /// Metres; negative where they overlap: so deep.
    pub distance: f64,
}

/// An object's bodies, and the box around each.
struct Solids {
    index: usize,
    bodies: Vec<Body>,
    least: [f64; 3],
    greatest: [f64; 3],
}

/// The pairs of objects that are closer than `margin`, or overlap by more than [`TOUCH`]; nearest first.
/// Objects that are attached may touch what their `touch` names.
#[must_use]
pub fn check(scene: &Scene, margin: f64) -> Vec<Proximity<'_>> {
    let limit = if margin > 0.0 { margin } else { -TOUCH };
    let mut solids: Vec<Solids> =
        scene.objects.iter().enumerate().filter_map(|(index, object)| solids(index, object)).collect();
    // Along x, only what begins before another ends can be near it.
    solids.sort_by(|a, b| a.least[0].total_cmp(&b.least[0]));
    let mut found = Vec::new();
    for (index, one) in solids.iter().enumerate() {
        let reach = one.greatest[0] + limit.max(0.0);
        let near = solids[index + 1..].iter().take_while(|other| other.least[0] <= reach);
        for other in near.filter(|other| is_near(one, other, limit.max(0.0))) {
            let (first, second) = (one.index.min(other.index), one.index.max(other.index));
            let (first, second) = (&scene.objects[first], &scene.objects[second]);
            if may_touch(first, second) {
                continue;
            }
            let distance = nearest(one, other);
            if distance < limit {
                found.push(Proximity { first: &first.name, second: &second.name, distance });
            }
        }
    }
    found.sort_by(|a, b| a.distance.total_cmp(&b.distance).then_with(|| (a.first, a.second).cmp(&(b.first, b.second))));
    found
}

fn solids(index: usize, object: &Object) -> Option<Solids> {
    let bodies: Vec<Body> = object.shapes.iter().map(|shape| Body::new(shape, &object.pose)).collect();
    let (mut least, mut greatest) = bodies.first()?.bounds();
    for (low, high) in bodies.iter().map(Body::bounds) {
        for axis in 0..3 {
            least[axis] = least[axis].min(low[axis]);
            greatest[axis] = greatest[axis].max(high[axis]);
        }
    }
    Some(Solids { index, bodies, least, greatest })
}

fn is_near(one: &Solids, other: &Solids, margin: f64) -> bool {
    (0..3).all(|axis| {
        one.least[axis] <= other.greatest[axis] + margin && other.least[axis] <= one.greatest[axis] + margin
    })
}

fn nearest(one: &Solids, other: &Solids) -> f64 {
    let pairs = one.bodies.iter().flat_map(|a| other.bodies.iter().map(move |b| distance(a, b)));
    pairs.fold(f64::INFINITY, f64::min)
}

/// Whether one is attached and may touch the other, or both hang on one link.
fn may_touch(first: &Object, second: &Object) -> bool {
    let allows = |one: &Object, other: &Object| {
        one.attachment.as_ref().is_some_and(|held| held.link == other.name || held.touch.contains(&other.name))
    };
    allows(first, second) || allows(second, first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::scene::{Attachment, Pose, Shape, Solid};

    fn cube(name: &str, x: f64) -> Object {
        let pose = Pose { translation: [x, 0.0, 0.0], ..Pose::IDENTITY };
        Object {
            name: name.into(),
            pose,
            shapes: vec![Shape::new(Solid::Box([1.0; 3]), Pose::IDENTITY)],
            ..Object::default()
        }
    }

    #[test]
    fn what_touches_does_not_overlap() {
        let scene =
            Scene { objects: vec![cube("a", 0.0), cube("b", 1.0), cube("c", 1.9), cube("d", 9.0)], ..Scene::default() };
        let pairs = check(&scene, 0.0);
        let [pair] = &pairs[..] else { panic!("{pairs:?}") };
        assert_eq!((pair.first, pair.second), ("b", "c"));
        assert!((pair.distance + 0.1).abs() < 1e-9);
        assert_eq!(check(&scene, 1.0).len(), 3, "{:?}", check(&scene, 1.0));
    }

    #[test]
    fn what_is_attached_may_touch_what_it_names() {
        let mut held = cube("held", 0.5);
        held.attachment = Some(Attachment { link: "hand".into(), touch: vec!["a".into()] });
        let scene = Scene { objects: vec![cube("a", 0.0), held], ..Scene::default() };
        assert_eq!(check(&scene, 0.0), []);
    }
}
