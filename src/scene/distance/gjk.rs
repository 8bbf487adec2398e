//! The distance of the origin to a convex set that is known by its support function.

use super::support::Difference;
use crate::formats::scene::pose::{dot, norm, sub};

/// Rounds at most; a few dozen are usual.
const ROUNDS: usize = 256;

/// What was found.
pub(super) enum Answer {
    /// So far away.
    Apart(f64),
    /// The origin is inside, or on the surface: points of the set around it.
    Overlapping(Vec<[f64; 3]>),
}

/// Finds the point of the set that is nearest to the origin, as that of a growing simplex.
pub(super) fn distance(set: &Difference<'_>) -> Answer {
    let start = set.center();
    let mut nearest = set.support(start.map(|part| -part));
    let mut simplex = vec![nearest];
    let mut scale = norm(&nearest);
    for _ in 0..ROUNDS {
        let square = dot(nearest, nearest);
        if square.sqrt() <= 1e-10 * scale.max(1e-3) {
            return Answer::Overlapping(simplex);
        }
        let next = set.support(nearest.map(|part| -part));
        scale = scale.max(norm(&next));
        // The set is beyond the plane through `next`: nothing of it is nearer than that.
        let is_done = square - dot(nearest, next) <= 1e-13 * square.max(scale * scale * 1e-3);
        if is_done || simplex.contains(&next) {
            break;
        }
        simplex.push(next);
        let Some((closer, kept)) = closest(&simplex) else { break };
        if dot(closer, closer) >= square {
            break;
        }
        (nearest, simplex) = (closer, kept);
        if simplex.len() == 4 {
            return Answer::Overlapping(simplex);
        }
    }
    Answer::Apart(norm(&nearest))
}

/// The point of a simplex that is nearest to the origin, and the corners that it is between. All
/// faces are tried, and the nearest is taken: there are fifteen at most.
fn closest(simplex: &[[f64; 3]]) -> Option<([f64; 3], Vec<[f64; 3]>)> {
    let mut best: Option<([f64; 3], Vec<[f64; 3]>)> = None;
    for mask in 1_usize..1 << simplex.len() {
        let corners: Vec<[f64; 3]> = simplex
            .iter()
            .enumerate()
            .filter(|(index, _)| mask & (1 << index) != 0)
            .map(|(_, corner)| *corner)
            .collect();
        let Some(point) = foot(&corners) else { continue };
        if best.as_ref().is_none_or(|(other, _)| dot(point, point) < dot(*other, *other)) {
            best = Some((point, corners));
        }
    }
    best
}

/// Where the perpendicular from the origin meets the hull of the corners, if it is inside.
fn foot(corners: &[[f64; 3]]) -> Option<[f64; 3]> {
    let (first, rest) = corners.split_first()?;
    let edges: Vec<[f64; 3]> = rest.iter().map(|corner| sub(*corner, *first)).collect();
    let weights = solve(&edges, first.map(|part| -part))?;
    let inside = weights.iter().all(|weight| *weight >= 0.0) && weights.iter().sum::<f64>() <= 1.0;
    inside.then(|| {
        let mut point = *first;
        for (edge, weight) in edges.iter().zip(weights) {
            for (part, step) in point.iter_mut().zip(edge) {
                *part += step * weight;
            }
        }
        point
    })
}

/// The weights with which the edges come nearest to the target: normal equations, by Gauss's elimination.
fn solve(edges: &[[f64; 3]], target: [f64; 3]) -> Option<Vec<f64>> {
    let size = edges.len();
    let mut rows: Vec<Vec<f64>> = edges
        .iter()
        .map(|edge| edges.iter().map(|other| dot(*edge, *other)).chain([dot(*edge, target)]).collect())
        .collect();
    for pivot in 0..size {
        let best = (pivot..size).max_by(|a, b| rows[*a][pivot].abs().total_cmp(&rows[*b][pivot].abs()))?;
        rows.swap(pivot, best);
        let scale = dot(edges[pivot], edges[pivot]);
        if rows[pivot][pivot].abs() <= 1e-14 * scale || scale == 0.0 {
            // The corners are no simplex; one of its faces will do.
            return None;
        }
        for row in 0..size {
            if row != pivot {
                let factor = rows[row][pivot] / rows[pivot][pivot];
                let scaled: Vec<f64> = rows[pivot].iter().map(|part| factor * part).collect();
                rows[row].iter_mut().zip(scaled).for_each(|(part, scaled)| *part -= scaled);
            }
        }
    }
    Some((0..size).map(|row| rows[row][size] / rows[row][row]).collect())
}
