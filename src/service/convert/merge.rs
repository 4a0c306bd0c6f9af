//! `MergeMaps`: from the request to the engine's terms, and from its outcome to the answer. Names are those
//! that the caller uses; whether they exist is not known here.

use std::collections::BTreeMap;

use super::geometry::{information, rigid_transform, to_rigid_transform};
use super::ids::{keyframe_ref, name};
use super::{Path, Violations, all, count};
use crate::map::{EntityRef, Reason};
use crate::service::access::Caller;
use crate::service::engine::{LinkRequest, MergeOutcome, MergeRequest};
use crate::wire::v1;

/// Most constraints of a request.
const CONSTRAINTS: usize = 1024;
/// Scales that a caller may give.
const SCALES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// Reads a request to merge maps.
pub(in crate::service) fn merge(
    request: v1::MergeMapsRequest,
    caller: &Caller,
    out: &mut Violations,
) -> Option<MergeRequest> {
    let target = name(Path::root("target_map_id"), &request.target_map_id, out);
    let at = Path::root("source_map_id");
    let source = name(at, &request.source_map_id, out);
    if source.is_some() && source == target {
        out.report::<()>(at, Reason::Duplicate, "a map cannot become part of itself");
    }
    let transform = request.target_from_source.as_ref();
    let target_from_source = match transform {
        None => Some(None),
        Some(_) => rigid_transform(Path::root("target_from_source"), transform, out).map(Some),
    };
    let at = Path::root("scale");
    // 0 is the default.
    let scale = if request.scale == 0.0 { 1.0 } else { request.scale };
    if !SCALES.contains(&scale) {
        let text = format!("{scale} is not from {} to {}", SCALES.start(), SCALES.end());
        out.report::<()>(at, Reason::OutOfRange, text);
    }
    if request.scale != 0.0 && transform.is_none() && request.constraints.is_empty() {
        let text =
            "allowed only with target_from_source or constraints; without them the server finds it";
        out.report::<()>(at, Reason::Inconsistent, text);
    }
    let at = Path::root("constraints");
    out.at_most(at, &request.constraints, CONSTRAINTS)?;
    let constraints = all(at, request.constraints, out, link);
    let mut renamed = BTreeMap::new();
    let clients =
        all(Path::root("renamed_clients"), request.renamed_clients, out, |at, client, out| {
            let from = name(at.field("client_id"), &client.client_id, out);
            let to = name(at.field("new_client_id"), &client.new_client_id, out);
            let (from, to) = (from?, to?);
            if renamed.contains_key(&from) {
                let text = format!("client {from:?} is named twice");
                return out.report(at.field("client_id"), Reason::Duplicate, text);
            }
            renamed.insert(from, to);
            Some(())
        });
    clients?;
    Some(MergeRequest {
        target: caller.engine_name(&target?),
        source: caller.engine_name(&source?),
        target_from_source: target_from_source?,
        scale,
        constraints: constraints?,
        renamed,
    })
}

/// The answer, with the message of the target.
pub(in crate::service) fn to_response(
    outcome: &MergeOutcome,
    map: v1::Map,
) -> v1::MergeMapsResponse {
    v1::MergeMapsResponse {
        map: Some(map),
        target_from_source: Some(to_rigid_transform(&outcome.target_from_source.rigid())),
        closure_count: count(outcome.closures),
        scale: outcome.target_from_source.scale,
    }
}

fn link(
    at: Path<'_>,
    message: v1::RelativePoseConstraint,
    out: &mut Violations,
) -> Option<LinkRequest> {
    let mut keyframe = |field, message: Option<&v1::KeyframeRef>| {
        let at = at.field(field);
        let EntityRef { client, id } = keyframe_ref(at, message, out)?;
        // There is no sender that an empty name could stand for.
        Some((client.or_else(|| out.missing(at.field("client_id")))?, id))
    };
    let keyframe_i = keyframe("keyframe_i", message.keyframe_i.as_ref());
    let keyframe_j = keyframe("keyframe_j", message.keyframe_j.as_ref());
    let measured = message.keyframe_i_from_keyframe_j.as_ref();
    let measured = rigid_transform(at.field("keyframe_i_from_keyframe_j"), measured, out);
    let upper_triangle = message.information.as_ref().map(|m| &m.upper_triangle);
    let information = information(at.field("information"), upper_triangle, out);
    Some(LinkRequest {
        keyframe_i: keyframe_i?,
        keyframe_j: keyframe_j?,
        keyframe_i_from_keyframe_j: measured?,
        information: information?,
    })
}
