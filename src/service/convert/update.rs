//! `UpdateMap`: which fields of a request are named by its mask, and what they change.
//!
//! Only the named fields are read; the others may hold anything. A named field that is absent takes
//! the server's default, as in `CreateMap`. The map's present policy is known to the engine only, so
//! that the change is a function of it.

use super::map::{ServerLimits, display_name, policy};
use super::{Path, Violations, ids};
use crate::map::{MapPolicy, Reason};
use crate::service::engine::{MapUpdate, PolicyUpdate};
use crate::wire::v1;

/// A field of a policy that a mask can name.
struct Field {
    /// Its path in the policy.
    path: &'static str,
    /// Copies it from one message to another.
    copy: fn(&v1::MapPolicy, &mut v1::MapPolicy),
    /// Copies what it became from one policy to another.
    take: fn(&MapPolicy, &mut MapPolicy),
}

/// A field of `MapPolicy`.
macro_rules! field {
    ($wire:ident, $map:ident) => {
        Field {
            path: stringify!($wire),
            copy: |from, to| to.$wire.clone_from(&from.$wire),
            take: |from, to| to.$map = from.$map,
        }
    };
}

/// A field of `MapPolicy.limits`.
macro_rules! limit {
    ($wire:ident, $map:ident) => {
        Field {
            path: concat!("limits.", stringify!($wire)),
            copy: |from, to| {
                let limit = from.limits.as_ref().and_then(|limits| limits.$wire);
                to.limits.get_or_insert_default().$wire = limit;
            },
            take: |from, to| to.limits.$map = from.limits.$map,
        }
    };
}

const FIELDS: [Field; 24] = [
    field!(observation_loss, observation_loss),
    field!(constraint_loss, constraint_loss),
    field!(window_keyframe_count, window_keyframes),
    field!(min_shared_landmark_count, min_shared_landmarks),
    field!(local_bundle_adjustment, local_bundle),
    field!(loop_closure_optimization, loop_closure),
    field!(closure_adjustment, closure_adjustment),
    field!(odometry, odometry),
    field!(metric_odometry, metric_odometry),
    Field {
        path: "place_recognition.enabled",
        copy: |from, to| {
            let enabled = from.place_recognition.and_then(|recognition| recognition.enabled);
            to.place_recognition.get_or_insert_default().enabled = enabled;
        },
        take: |from, to| to.place_recognition = from.place_recognition,
    },
    field!(max_iteration_count, max_local_iterations),
    field!(loop_closure_robustness, loop_closure_robustness),
    field!(when_full, when_full),
    limit!(max_keyframe_count, keyframes),
    limit!(max_landmark_count, landmarks),
    limit!(max_observation_count, observations),
    limit!(max_size_bytes, bytes),
    limit!(max_client_count, clients),
    limit!(max_camera_count, cameras),
    limit!(max_constraint_count, constraints),
    limit!(max_prior_count, priors),
    Field {
        path: "limits.max_queued_item_count",
        copy: |from, to| {
            let limit = from.limits.as_ref().and_then(|limits| limits.max_queued_item_count);
            to.limits.get_or_insert_default().max_queued_item_count = limit;
        },
        take: |from, to| to.max_queued_items = from.max_queued_items,
    },
    field!(gauge, gauge),
    field!(geodetic_anchor, geodetic_anchor),
];

/// Most paths of a mask: more than there are fields.
pub(in crate::service) const MOST_PATHS: usize = 64;

/// The change that a request asks for.
pub(in crate::service) fn update(
    request: &v1::UpdateMapRequest,
    server: &ServerLimits,
    out: &mut Violations,
) -> Option<MapUpdate> {
    let at = Path::root("update_mask");
    let paths = request.update_mask.as_ref().map_or(&[][..], |mask| &mask.paths[..]);
    out.not_empty(at, paths);
    // A path may stand for all fields.
    out.at_most(at, paths, MOST_PATHS)?;
    let mut update = MapUpdate::default();
    let mut fields = Vec::new();
    let mut is_read = true;
    for path in paths {
        match path.as_str() {
            "display_name" => {
                update.display_name = display_name(&request.display_name, out);
                is_read &= update.display_name.is_some();
            }
            "state" => {
                update.frozen = is_frozen(request.state, out);
                is_read &= update.frozen.is_some();
            }
            "policy" => fields.extend(&FIELDS),
            path => {
                let named = named(path.strip_prefix("policy."));
                if named.is_empty() {
                    let text = format!("{path:?} is not a field that can be changed");
                    let _: Option<()> = out.report(at, Reason::UnknownValue, text);
                }
                fields.extend(named);
            }
        }
    }
    if !fields.is_empty() {
        update.policy = new_policy(request.policy.as_ref(), fields, server, out);
        is_read &= update.policy.is_some();
    }
    update.expected_revision = match request.expected_revision {
        None => None,
        Some(revision) => Some(ids::id(Path::root("expected_revision"), revision, out)?),
    };
    is_read.then_some(update)
}

/// The fields of a policy that a path names: one, or all those of a message.
fn named(path: Option<&str>) -> Vec<&'static Field> {
    let Some(path) = path else { return Vec::new() };
    let is_named = |field: &&Field| {
        let rest = field.path.strip_prefix(path);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    FIELDS.iter().filter(is_named).collect()
}

/// Whether a request asks for a frozen map; it may ask for an open one besides.
pub(super) fn is_frozen(state: i32, out: &mut Violations) -> Option<bool> {
    let at = Path::root("state");
    match out.known(at, state)? {
        v1::MapState::Open => Some(false),
        v1::MapState::Frozen => Some(true),
        v1::MapState::Unspecified => out.missing(at),
        v1::MapState::Poisoned => {
            out.report(at, Reason::OutOfRange, "only OPEN and FROZEN can be requested")
        }
    }
}

fn new_policy(
    message: Option<&v1::MapPolicy>,
    fields: Vec<&'static Field>,
    server: &ServerLimits,
    out: &mut Violations,
) -> Option<PolicyUpdate> {
    let mut wanted = v1::MapPolicy::default();
    if let Some(message) = message {
        fields.iter().for_each(|field| (field.copy)(message, &mut wanted));
    }
    let wanted = policy(Some(&wanted), server, out)?;
    Some(Box::new(move |present| {
        let mut policy = *present;
        fields.iter().for_each(|field| (field.take)(&wanted, &mut policy));
        policy
    }))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use prost::Message;
    use prost_types::FileDescriptorSet;

    use super::*;

    /// The names of a message's fields.
    fn fields_of(set: &FileDescriptorSet, message: &str) -> Vec<String> {
        let messages = set.file.iter().flat_map(|file| &file.message_type);
        let message = messages.into_iter().find(|m| m.name() == message).unwrap();
        message.field.iter().map(|field| field.name().to_owned()).collect()
    }

    #[test]
    fn every_field_of_a_policy_can_be_named() {
        let set = FileDescriptorSet::decode(v1::FILE_DESCRIPTOR_SET).unwrap();
        let mut paths: BTreeSet<String> = fields_of(&set, "MapPolicy").into_iter().collect();
        for (field, message) in [("limits", "MapLimits"), ("place_recognition", "PlaceRecognition")]
        {
            assert!(paths.remove(field));
            paths.extend(fields_of(&set, message).iter().map(|name| format!("{field}.{name}")));
        }
        assert_eq!(paths, FIELDS.iter().map(|field| field.path.to_owned()).collect());
    }

    #[test]
    fn a_path_names_a_field_or_all_fields_of_a_message() {
        let paths = |path| named(Some(path)).iter().map(|field| field.path).collect::<Vec<_>>();
        assert_eq!(paths("when_full"), ["when_full"]);
        assert_eq!(paths("limits").len(), 9);
        assert_eq!(paths("limits.max_prior_count"), ["limits.max_prior_count"]);
        for path in ["", "limit", "limits.", "when_full.x", "limits.max_prior"] {
            assert!(paths(path).is_empty(), "{path}");
        }
    }
}
