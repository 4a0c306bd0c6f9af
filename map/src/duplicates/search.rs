//! The two places that a loop closure joins, as points for
//! [`match_points`](covis_solvers::point_matching).
//!
//! Each side is what is around one of the closure's keyframes, without what both see. Nothing is
//! estimated or changed here.

use std::collections::BTreeSet;

use covis_solvers::geometry::Se3;
use covis_solvers::information::Information;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::point_matching::{Likeness, match_points};

use super::super::surroundings::{Surroundings, keyframes_around, likeness, seen};
use super::super::{EntityId, Map};
use super::Comparison;

/// Compares the places that a loop closure joins, until `interrupt` is due; then nothing is found.
/// `None` where the map has no such closure that counts.
#[must_use]
pub fn find_duplicates(map: &Map, closure: EntityId, interrupt: &Interrupt) -> Option<Comparison> {
    let constraint = map.active_constraint(closure).filter(|constraint| constraint.is_closure())?;
    let (i, j) = (constraint.keyframe_i, constraint.keyframe_j);
    let keyframes_i = keyframes_around(map, i, &BTreeSet::new());
    let keyframes_j = keyframes_around(map, j, &keyframes_i.iter().map(|&(id, _)| id).collect());
    let (seen_i, seen_j) = (seen(&keyframes_i), seen(&keyframes_j));
    let a = Surroundings::of(map, &keyframes_i, &seen_j, interrupt);
    let b = Surroundings::of(map, &keyframes_j, &seen_i, interrupt);
    let variance = map.client(closure.client).map_or(1.0, |client| client.closure_variance);
    let information: Information<6> = constraint.information.scaled(1.0 / variance);
    let world_from_j: Se3 = map.keyframes().get(&j)?.world_from_camera;
    let likeness = |at_a: usize, at_b: usize| {
        let descriptors = a.descriptors[at_a].zip(b.descriptors[at_b]);
        descriptors.map_or(Likeness::Unknown, |(a, b)| likeness(a, b))
    };
    let (a_points, b_points) = (&a.points, &b.points);
    let pairs = match_points(a_points, b_points, &world_from_j, &information, &likeness, interrupt);
    let pair = |(at_a, at_b): (usize, usize)| (a.landmarks[at_a], b.landmarks[at_b]);
    Some(Comparison { closure, pairs: pairs.into_iter().map(pair).collect() })
}
