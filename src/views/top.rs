//! A scene from above: outlines, names and frames, to scale.

use super::chart::{Axis, Chart, Kind, Point, Series};
use crate::formats::scene::{Object, Pose, Scene};
use crate::scene::outline::outlines;

/// A map of the scene, with these frames in it.
#[must_use]
pub fn top(scene: &Scene, frames: &[(String, Pose)], size: (f64, f64)) -> Chart {
    let mut series = Vec::new();
    let kinds: [(&str, fn(&Object) -> bool); 3] = [
        ("static", |object| object.fixed && object.attachment.is_none()),
        ("movable", |object| !object.fixed && object.attachment.is_none()),
        ("attached", |object| object.attachment.is_some()),
    ];
    for (name, is_of) in kinds {
        let objects: Vec<&Object> = scene.objects.iter().filter(|object| is_of(object)).collect();
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

fn point(name: &str, pose: &Pose, has_heading: bool) -> Point {
    let [x, y, _] = pose.translation;
    let [along, across, _] = pose.rotate([1.0, 0.0, 0.0]);
    // An x axis that points up or down has no heading.
    let heading = (has_heading && along.hypot(across) > 1e-6).then(|| across.atan2(along));
    Point { x, y, label: name.to_owned(), heading }
}
