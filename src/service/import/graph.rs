//! A map from a g2o file in space.
//!
//! Vertices become keyframes, a second apart by their ids; edges between consecutive ids become odometry,
//! the others loop closures; priors become priors, and landmarks keep their positions. What a map has no
//! place for is left out and reported to the client, with its number; the numbers of the file are never
//! changed without a word.

use std::collections::BTreeMap;
use std::path::Path;

use covis_solvers::geometry::Se3;
use covis_solvers::io::g2o::{ChangedLines, G2oChanges, G2oGraph, G2oReading};
use covis_solvers::io::reading::Content;
use covis_solvers::problem::PoseGraph;

use super::File;
use super::models::{Building, IMAGE_STEP_NS, LANDMARKS, keyframe, refused, unreadable};
use crate::map::{ConstraintKind, EntityRef, Item, ItemLandmark, MeasuredPosition};
use crate::service::convert::count;
use crate::service::error::ServiceError;
use crate::wire::v1;

/// Adds the only file, of client `client`; what the map does not hold as the file has it. `skip_unknown`
/// leaves out the lines that are not read, which are an error otherwise.
pub(super) fn import(
    building: &mut Building,
    files: &[File],
    client: &str,
    skip_unknown: bool,
) -> Result<Vec<v1::ImportWarning>, ServiceError> {
    let [file] = files else { return Err(refused("a pose graph is one file")) };
    let path = &file.path;
    building.price(Content::Graph, &[&file.bytes])?;
    let reading = G2oReading { skip_unknown, ..G2oReading::default() };
    let read = G2oGraph::parse_with(&file.bytes, Path::new(path), reading);
    let (graph, changes) = read.map_err(|error| unreadable(&error))?;
    let graph = match graph {
        G2oGraph::Se3(graph) if graph.has_vertices() => graph,
        G2oGraph::Se3(_) => return Err(refused(format!("{path}: the graph has edges only"))),
        G2oGraph::Se2(_) => {
            let text =
                "a map is in space, and a graph in the plane does not say height, roll and pitch";
            return Err(refused(format!("{path}: {text}")));
        }
    };
    let graph = graph.to_pose_graph().map_err(|error| unreadable(&error))?;
    let client = building.client(client)?;
    let poses: BTreeMap<i64, Se3> =
        graph.ids.iter().copied().zip(graph.poses.iter().copied()).collect();
    for (index, (&id, &pose)) in (0..).zip(&poses) {
        let item = keyframe(id, IMAGE_STEP_NS.saturating_mul(index), pose);
        building.add(client, format_args!("{path}, vertex {id}"), &item)?;
    }
    let landmarks = graph.landmarks.ids.iter().zip(&graph.landmarks.positions);
    let landmarks: Vec<ItemLandmark> =
        landmarks.map(|(&id, &position)| ItemLandmark { id, position: Some(position) }).collect();
    for batch in landmarks.chunks(LANDMARKS) {
        let first = batch.first().map_or(0, |landmark| landmark.id);
        let item = Item::Landmarks { landmarks: batch.to_vec() };
        building.add(client, format_args!("{path}, landmarks from {first} on"), &item)?;
    }
    let id_of = |pose: usize| graph.ids.get(pose).copied().unwrap_or(-1);
    for (id, edge) in (0..).zip(&graph.edges) {
        let [i, j] = [edge.i, edge.j].map(id_of);
        let kind = match i.abs_diff(j) {
            1 => ConstraintKind::Odometry,
            _ => ConstraintKind::LoopClosure,
        };
        let item = Item::RelativePose {
            id,
            kind,
            keyframe_i: EntityRef::own(i),
            keyframe_j: EntityRef::own(j),
            keyframe_i_from_keyframe_j: edge.i_from_j,
            information: edge.information,
            loss: None,
        };
        building.add(client, format_args!("{path}, edge {id} from {i} to {j}"), &item)?;
    }
    let first_prior = graph.edges.len() as i64;
    for (id, prior) in (first_prior..).zip(&graph.pose_priors) {
        let keyframe = id_of(prior.pose);
        let item = Item::PosePrior {
            id,
            keyframe: EntityRef::own(keyframe),
            world_from_camera: prior.world_from_camera,
            information: prior.information,
            loss: prior.loss,
        };
        building.add(
            client,
            format_args!("{path}, prior on the pose of vertex {keyframe}"),
            &item,
        )?;
    }
    let first_position = first_prior + graph.pose_priors.len() as i64;
    for (id, prior) in (first_position..).zip(&graph.position_priors) {
        let keyframe = id_of(prior.pose);
        let item = Item::PositionPrior {
            id,
            keyframe: EntityRef::own(keyframe),
            position: MeasuredPosition::InWorld(prior.position_in_world),
            point_in_camera: prior.point_in_camera,
            information: prior.information,
            loss: prior.loss,
        };
        let what = format_args!("{path}, prior on the position of vertex {keyframe}");
        building.add(client, what, &item)?;
    }
    Ok(warnings(path, &changes, &graph))
}

/// What the map does not hold as the file has it.
fn warnings(path: &str, changes: &G2oChanges, graph: &PoseGraph<Se3, 6>) -> Vec<v1::ImportWarning> {
    use v1::ImportChange as Change;
    let mut warnings = Vec::new();
    let mut warn = |change: Change, lines: ChangedLines, text: &str| {
        if lines.count == 0 {
            return;
        }
        let ChangedLines { count: records, first_line } = lines;
        let line = match first_line {
            0 => String::new(),
            line => format!(", the first in line {line}"),
        };
        warnings.push(v1::ImportWarning {
            change: change.into(),
            path: path.to_owned(),
            count: count(records),
            first_line: i64::try_from(first_line).unwrap_or(i64::MAX),
            description: format!("{path}: {text}: {records}{line}"),
        });
    };
    let none = ChangedLines { count: 0, first_line: 0 };
    let of = |count: usize| ChangedLines { count, ..none };
    let text = "quaternions far from norm 1 are normalized";
    warn(Change::QuaternionsNormalized, changes.normalized.unwrap_or(none), text);
    let text = "edges from a vertex to itself are left out";
    warn(Change::SelfEdgesLeftOut, changes.self_edges.unwrap_or(none), text);
    for (tag, lines) in &changes.skipped {
        warn(
            Change::UnknownLinesLeftOut,
            *lines,
            &format!("lines with the tag {tag} are left out"),
        );
    }
    // The map holds its first keyframe, which is that of the lowest id, where no prior says more.
    let first = graph.ids.iter().min().filter(|_| !graph.has_priors());
    let poses = graph.ids.iter().zip(&graph.constant).filter(|(id, _)| Some(*id) != first);
    let landmarks = graph.landmarks.ids.iter().zip(&graph.landmarks.constant);
    let freed = poses.chain(landmarks).filter(|&(_, &constant)| constant).count();
    let text = "fixed vertices may move, since a map holds its first keyframe alone";
    warn(Change::FixedVerticesFreed, of(freed), text);
    let measurements = &graph.landmarks.measurements;
    let surveyed = measurements.iter().filter(|measurement| measurement.pose.is_none()).count();
    let text = "measurements of landmarks by position are left out, since a map has pixels";
    warn(Change::LandmarkMeasurementsLeftOut, of(measurements.len() - surveyed), text);
    let text = "priors on landmarks are left out, since those of a map are on keyframes";
    warn(Change::LandmarkPriorsLeftOut, of(surveyed), text);
    warnings
}
