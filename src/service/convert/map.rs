//! Maps and their policies.
//!
//! Absent fields of a policy get the server's defaults; its limits never exceed the server's.
//! Nothing here changes a map.

use super::entities::{clients_by_name, to_client_frame};
use super::geometry::{geodetic, to_geodetic, to_rigid_transform, to_vector3};
use super::solve::{gauge, loss, robustness, to_gauge, to_loss, to_robustness};
use super::time::timestamp;
use super::{Path, Violations, count, small};
use crate::map::{
    Counts, Hint, HintKind, Map, MapLimits, MapPolicy, MergedMap, Noise, Reason, WhenFull,
};
use crate::service::engine::{EngineError, MapInfo, MapState, PendingWork, limit_name};
use crate::service::error::ServiceError;
use crate::service::names::shown;
use crate::service::printable::is_printable;
use crate::store::Durability;
use crate::wire::v1;

/// Longest display name, bytes.
const MAX_DISPLAY_NAME: usize = 256;

/// Most merged maps in an answer, and most names of clients in all of them. Maps that were merged one into
/// the other name the same clients again and again, and a map must fit a message of 4 MiB.
const MERGED_MAPS: usize = 1024;
const MERGED_CLIENTS: usize = 4096;

/// The limits of the server, which a map's can only lower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::service) struct ServerLimits {
    /// What a map may hold.
    pub map: MapLimits,
    /// Items of a client that wait for the engine.
    pub queued_items: usize,
}

/// Which failures acknowledged items survive.
pub(in crate::service) fn to_durability(durability: Durability) -> v1::Durability {
    match durability {
        Durability::Memory => v1::Durability::InMemory,
        Durability::Disk => v1::Durability::Disk,
        Durability::Replicated => v1::Durability::Replicated,
    }
}

/// A map's free text for people.
pub(in crate::service) fn display_name(name: &str, out: &mut Violations) -> Option<String> {
    let name = kept_display_name(name, out)?;
    if name.chars().all(is_printable) {
        return Some(name);
    }
    let text = "control characters and direction marks are not allowed";
    out.report(Path::root("display_name"), Reason::OutOfRange, text)
}

/// The same of a map that exists: an earlier version took any character.
pub(in crate::service) fn kept_display_name(name: &str, out: &mut Violations) -> Option<String> {
    if name.len() <= MAX_DISPLAY_NAME {
        return Some(name.to_owned());
    }
    let text = format!("{} bytes, at most {MAX_DISPLAY_NAME} are allowed", name.len());
    out.report(Path::root("display_name"), Reason::TooLarge, text)
}

/// The policy of a new map.
pub(in crate::service) fn policy(
    message: Option<&v1::MapPolicy>,
    server: &ServerLimits,
    out: &mut Violations,
) -> Option<MapPolicy> {
    let at = Path::root("policy");
    let absent = v1::MapPolicy::default();
    let m = message.unwrap_or(&absent);
    let default = MapPolicy::default();
    let observation_loss = loss(at.field("observation_loss"), m.observation_loss.as_ref(), out);
    let constraint_loss = loss(at.field("constraint_loss"), m.constraint_loss.as_ref(), out);
    let mut number = |name, value: Option<i32>, default: usize, low, high| match value {
        None => Some(default),
        Some(value) => out.within(at.field(name), value, low, high),
    };
    let window =
        number("window_keyframe_count", m.window_keyframe_count, default.window_keyframes, 2, 200);
    let shared = number(
        "min_shared_landmark_count",
        m.min_shared_landmark_count,
        default.min_shared_landmarks,
        1,
        1000,
    );
    let iterations =
        number("max_iteration_count", m.max_iteration_count, default.max_local_iterations, 1, 1000);
    let gauge = gauge(at.field("gauge"), m.gauge, out);
    let anchor = m.geodetic_anchor.as_ref();
    let anchor = anchor.map(|point| geodetic(at.field("geodetic_anchor"), point, out));
    let limits = limits(at, m.limits.as_ref(), server, out);
    let queued_items = queued_items(at, m.limits.as_ref(), server.queued_items, out);
    let when_full = match out.known(at.field("when_full"), m.when_full) {
        Some(v1::WhenFull::Unspecified | v1::WhenFull::Reject) => Some(WhenFull::Reject),
        Some(v1::WhenFull::Marginalize) => Some(WhenFull::Marginalize),
        Some(v1::WhenFull::Sparsify) => Some(WhenFull::Sparsify),
        None => None,
    };
    let closures = at.field("loop_closure_robustness");
    let wanted = m.loop_closure_robustness.as_ref();
    let closures = robustness(closures, wanted, default.loop_closure_robustness, out);
    Some(MapPolicy {
        local_bundle: m.local_bundle_adjustment.unwrap_or(default.local_bundle),
        odometry: m.odometry.unwrap_or(default.odometry),
        metric_odometry: m.metric_odometry.unwrap_or(default.metric_odometry),
        loop_closure: m.loop_closure_optimization.unwrap_or(default.loop_closure),
        closure_adjustment: m.closure_adjustment.unwrap_or(default.closure_adjustment),
        place_recognition: m
            .place_recognition
            .and_then(|recognition| recognition.enabled)
            .unwrap_or(default.place_recognition),
        loop_closure_robustness: closures?,
        window_keyframes: window?,
        min_shared_landmarks: shared?,
        observation_loss: observation_loss?.unwrap_or(default.observation_loss),
        constraint_loss: constraint_loss?.unwrap_or(default.constraint_loss),
        max_local_iterations: iterations?,
        limits: limits?,
        when_full: when_full?,
        max_queued_items: queued_items?,
        gauge: gauge?.unwrap_or(default.gauge),
        geodetic_anchor: match anchor {
            None => None,
            Some(read) => Some(read?),
        },
    })
}

fn limits(
    at: Path<'_>,
    message: Option<&v1::MapLimits>,
    server: &ServerLimits,
    out: &mut Violations,
) -> Option<MapLimits> {
    let at = at.field("limits");
    let Some(m) = message else { return Some(server.map) };
    let wanted = Counts {
        clients: m.max_client_count,
        cameras: m.max_camera_count,
        keyframes: m.max_keyframe_count,
        landmarks: m.max_landmark_count,
        observations: m.max_observation_count,
        constraints: m.max_constraint_count,
        priors: m.max_prior_count,
        bytes: m.max_size_bytes,
    };
    let mut is_read = true;
    let wanted = MapLimits::each(|counted| {
        let limit = out.within(at.field(limit_name(counted)), wanted.of(counted)?, 1, i64::MAX);
        is_read &= limit.is_some();
        limit.map(|limit| limit as u64)
    });
    is_read.then(|| wanted.lower(&server.map))
}

/// Items of a client that may wait, if that is not the server's number, which answers fill in.
fn queued_items(
    at: Path<'_>,
    message: Option<&v1::MapLimits>,
    server: usize,
    out: &mut Violations,
) -> Option<Option<u32>> {
    match message.and_then(|m| m.max_queued_item_count) {
        None => Some(None),
        Some(items) if items == small(server) => Some(None),
        Some(items) => {
            let limits = at.field("limits");
            let field = limits.field("max_queued_item_count");
            out.within(field, items, 1, 65_536).map(|items: usize| u32::try_from(items).ok())
        }
    }
}

/// The message of a map's limits; absent where there is none.
pub(in crate::service) fn to_limits(limits: &MapLimits, queued_items: usize) -> v1::MapLimits {
    let limit = |value: Option<u64>| value.map(|v| i64::try_from(v).unwrap_or(i64::MAX));
    v1::MapLimits {
        max_keyframe_count: limit(limits.keyframes),
        max_landmark_count: limit(limits.landmarks),
        max_observation_count: limit(limits.observations),
        max_size_bytes: limit(limits.bytes),
        max_client_count: limit(limits.clients),
        max_camera_count: limit(limits.cameras),
        max_constraint_count: limit(limits.constraints),
        max_prior_count: limit(limits.priors),
        max_queued_item_count: Some(small(queued_items)),
    }
}

/// The message of a policy, with all that the server fills in.
pub(in crate::service) fn to_policy(policy: &MapPolicy, queued_items: usize) -> v1::MapPolicy {
    v1::MapPolicy {
        observation_loss: Some(to_loss(&policy.observation_loss)),
        constraint_loss: Some(to_loss(&policy.constraint_loss)),
        window_keyframe_count: Some(small(policy.window_keyframes)),
        min_shared_landmark_count: Some(small(policy.min_shared_landmarks)),
        gauge: to_gauge(policy.gauge).into(),
        geodetic_anchor: policy.geodetic_anchor.as_ref().map(to_geodetic),
        local_bundle_adjustment: Some(policy.local_bundle),
        loop_closure_optimization: Some(policy.loop_closure),
        closure_adjustment: Some(policy.closure_adjustment),
        odometry: Some(policy.odometry),
        metric_odometry: Some(policy.metric_odometry),
        place_recognition: Some(v1::PlaceRecognition { enabled: Some(policy.place_recognition) }),
        max_iteration_count: Some(small(policy.max_local_iterations)),
        limits: Some(to_limits(&policy.limits, queued(policy, queued_items))),
        loop_closure_robustness: Some(to_robustness(&policy.loop_closure_robustness)),
        when_full: match policy.when_full {
            WhenFull::Reject => v1::WhenFull::Reject,
            WhenFull::Marginalize => v1::WhenFull::Marginalize,
            WhenFull::Sparsify => v1::WhenFull::Sparsify,
        }
        .into(),
    }
}

/// Items of a client that may wait: the map's number, never above the server's.
pub(in crate::service) fn queued(policy: &MapPolicy, server: usize) -> usize {
    policy.max_queued_items.map_or(server, |items| server.min(items as usize))
}

/// The message of a map's state.
pub(in crate::service) fn to_state(state: MapState) -> v1::MapState {
    match state {
        MapState::Open => v1::MapState::Open,
        MapState::Frozen => v1::MapState::Frozen,
        MapState::Poisoned => v1::MapState::Poisoned,
    }
}

/// The message of a map. Passes over all landmarks, so that no thread that answers calls may make it.
pub(in crate::service) fn to_map(info: &MapInfo, queued_items: usize) -> v1::Map {
    let map = &info.snapshot;
    v1::Map {
        map_id: shown(&info.name).to_owned(),
        display_name: map.display_name().to_owned(),
        policy: Some(to_policy(map.policy(), queued_items)),
        state: to_state(info.state).into(),
        create_time: Some(timestamp(map.create_time_ns())),
        update_time: Some(timestamp(map.update_time_ns())),
        revision: map.revision(),
        counts: Some(to_counts(map)),
        landmark_bounds: to_bounds(map),
        clients: clients_by_name(map).into_iter().map(|(_, c)| to_client(map, c)).collect(),
        uid: info.uid.clone(),
        adjustment_due: map.is_adjustment_due() && map.policy().closure_adjustment,
        state_reason: info.trouble.clone().map(reason_of).unwrap_or_default(),
        merged_maps: to_merged_maps(map),
        pending_work: Some(to_pending_work(&info.pending)),
        hints: Vec::new(),
        merged_map_count: count(map.merged().len()),
    }
}

/// The messages of the mistakes that the data of clients look like. Takes some milliseconds.
pub(in crate::service) fn to_hints(map: &Map) -> Vec<v1::MapHint> {
    let to_hint = |hint: Hint| v1::MapHint {
        kind: match hint.kind {
            HintKind::DepthUnit => v1::MapHintKind::DepthUnit,
            HintKind::SceneSize => v1::MapHintKind::SceneSize,
            HintKind::PosesInverted => v1::MapHintKind::PosesInverted,
            HintKind::PixelsSwapped => v1::MapHintKind::PixelsSwapped,
            HintKind::PixelsOutsideImage => v1::MapHintKind::PixelsOutsideImage,
            HintKind::LandmarksBehindCamera => v1::MapHintKind::LandmarksBehindCamera,
            HintKind::ClockWentBack => v1::MapHintKind::ClockWentBack,
        }
        .into(),
        client_id: map.client(hint.client).map(|client| client.name.clone()).unwrap_or_default(),
        text: hint.text,
    };
    let mut hints: Vec<v1::MapHint> = map.hints().into_iter().map(to_hint).collect();
    hints.sort_by(|a, b| (&a.client_id, a.kind).cmp(&(&b.client_id, b.kind)));
    hints
}

/// The message of what an engine still does by itself.
pub(in crate::service) fn to_pending_work(pending: &PendingWork) -> v1::PendingWork {
    v1::PendingWork {
        unoptimized_item_count: count(pending.unoptimized_items),
        place_search_count: count(pending.place_searches),
        closure_adjustment: pending.closure_adjustment,
        optimization: pending.optimization,
    }
}

/// What a caller reads of an error: it names maps as the caller does, and no file of the server.
fn reason_of(error: EngineError) -> String {
    tonic::Status::from(ServiceError::Engine(error)).message().to_owned()
}

/// The last merges, with equal shares of the names.
fn to_merged_maps(map: &Map) -> Vec<v1::MergedMap> {
    let all = map.merged();
    let last = &all[all.len().saturating_sub(MERGED_MAPS)..];
    let names = MERGED_CLIENTS / last.len().max(1);
    last.iter().map(|merged| to_merged(map, merged, names)).collect()
}

fn to_merged(map: &Map, merged: &MergedMap, names: usize) -> v1::MergedMap {
    let clients = merged.clients.iter().take(names).filter_map(|client| map.client(client.index));
    v1::MergedMap {
        map_id: shown(&merged.name).to_owned(),
        target_from_source: Some(to_rigid_transform(&merged.target_from_source.rigid())),
        client_ids: clients.map(|client| client.name.clone()).collect(),
        scale: merged.target_from_source.scale,
        client_count: count(merged.clients.len()),
    }
}

fn to_client(map: &Map, index: crate::map::ClientIndex) -> v1::MapClient {
    let client = map.client(index);
    v1::MapClient {
        client_id: client.map(|c| c.name.clone()).unwrap_or_default(),
        epoch: client.map_or(0, |c| c.epoch),
        next_sequence: client.map_or(1, |c| c.next_sequence),
        map_from_odom: to_client_frame(map, index).and_then(|frame| frame.map_from_odom),
        scale: map.scale_of(index),
        noise: client.map(|c| to_noise(&c.noise)),
    }
}

fn to_noise(noise: &Noise) -> v1::ClientNoise {
    let Noise { odometry, views } = *noise;
    v1::ClientNoise {
        odometry_translation_share: odometry.translation_share,
        odometry_rotation_rad: odometry.rotation_rad,
        pixel_factor: views.pixel_factor,
        depth_factor: views.depth_factor,
        outlier_share: views.outlier_share,
    }
}

pub(in crate::service) fn to_counts(map: &Map) -> v1::MapCounts {
    let observations = usize::try_from(map.observation_count()).unwrap_or(usize::MAX);
    let (keyframes, landmarks) = (map.keyframes().len(), map.landmarks().len());
    let positioned = map.landmarks().values().filter(|l| l.position.is_some()).count();
    v1::MapCounts {
        camera_count: count(map.cameras().len()),
        rig_count: 0,
        keyframe_count: count(keyframes),
        landmark_count: count(landmarks),
        positioned_landmark_count: count(positioned),
        observation_count: count(observations),
        constraint_count: count(map.constraints().len() + map.priors().len()),
        size_bytes: i64::try_from(map.usage().bytes).unwrap_or(i64::MAX),
        switched_off_constraint_count: count(map.switched_off().len()),
    }
}

fn to_bounds(map: &Map) -> Option<v1::Bounds3> {
    let mut positions = map.landmarks().values().filter_map(|l| l.position);
    let first = positions.next()?;
    let (min, max) = positions.fold((first, first), |(min, max), p| (min.inf(&p), max.sup(&p)));
    Some(v1::Bounds3 { min: Some(to_vector3(&min)), max: Some(to_vector3(&max)) })
}
