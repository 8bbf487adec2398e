//! A scene from above: outlines, names and frames, to scale.

use super::chart::{Axis, Chart, Kind, Point, Series};
use crate::formats::scene::{Object, Pose, Scene};
use crate::scene::outline::outlines;

/// A map of the scene, with these frames in it.
#[must_use]
pub fn top(scene: &Scene, frames: &[(String, Pose)], size: (f64, f64)) -> Chart {
    let mut series = Vec::new();
    for name in ["static", "movable", "attached"] {
        let objects: Vec<&Object> = scene.objects.iter().filter(|object| kind(object) == name).collect();
        let points = objects.iter().map(|object| point(&object.name, &object.pose, false));
        let outlines = objects.iter().flat_map(|object| outlines(object));
        series.push(Series {
            name: name.to_owned(),
            points: points.collect(),
            outlines: outlines.collect(),
            ..Series::default()
        });
    }
    let points = frames.iter().map(|(name, pose)| point(name, pose, true));
    series.push(Series { name: "frames".to_owned(), points: points.collect(), ..Series::default() });
    series.retain(|series| !series.is_empty());
    let frame = scene.frame.as_deref().unwrap_or_default();
    Chart {
        title: scene.name.clone().unwrap_or_else(|| format!("scene in the frame {frame}")),
        x: Axis { label: "x (m)".to_owned(), ..Axis::default() },
        y: Axis { label: "y (m)".to_owned(), ..Axis::default() },
        kind: Kind::Map,
        series,
        size,
    }
}

fn kind(object: &Object) -> &'static str {
    match (&object.attachment, object.fixed) {
        (Some(_), _) => "attached",
        (None, true) => "static",
        (None, false) => "movable",
    }
}

fn point(name: &str, pose: &Pose, has_heading: bool) -> Point {
    let [x, y, _] = pose.translation;
    let [along, across, _] = pose.rotate([1.0, 0.0, 0.0]);
    // An x axis that points up or down has no heading.
    let heading = (has_heading && along.hypot(across) > 1e-6).then(|| across.atan2(along));
    Point { x, y, label: name.to_owned(), heading }
}
