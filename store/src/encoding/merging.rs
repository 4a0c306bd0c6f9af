//! What a merge adds to a map, and the maps that became part of one, as messages and back. The content is
//! the parts of a snapshot. Nothing here knows where messages are kept.

use std::sync::Arc;

use super::entities::{
    decode_constraint, decode_new_pose, decode_policy, decode_similarity, encode_constraint,
    encode_new_pose, encode_policy, encode_pose, encode_scale,
};
use super::joined::PartsReader;
use super::snapshot::Parts;
use super::{EncodingError, v1};
use covis_map::{ClientIndex, Merge, MergedClient, MergedMap};

pub(super) fn encode_merge(merge: &Merge) -> v1::MapMerged {
    let Merge { name, content, target_from_source, clients, closures, first } = merge;
    let mut parts = Parts::default();
    v1::MapMerged {
        name: name.clone(),
        parts: std::iter::from_fn(|| parts.next(content)).collect(),
        target_from_source: Some(encode_pose(&target_from_source.rigid())),
        scale: encode_scale(target_from_source.scale),
        clients: clients.iter().map(encode_client).collect(),
        closures: closures.iter().map(|(id, closure)| encode_constraint(*id, closure)).collect(),
        first: first.as_ref().map(encode_new_pose),
    }
}

pub(super) fn decode_merge(merge: v1::MapMerged) -> Result<Merge, EncodingError> {
    let v1::MapMerged { name, parts, target_from_source, clients, closures, scale, first } = merge;
    let mut content = PartsReader::default();
    for part in parts {
        content.add(&part, false)?;
    }
    Ok(Merge {
        name,
        content: Arc::new(content.finish(true)?),
        target_from_source: decode_similarity(target_from_source, scale, "target_from_source")?,
        clients: clients.into_iter().map(decode_client).collect(),
        closures: closures.into_iter().map(decode_constraint).collect::<Result<_, _>>()?,
        first: first.map(decode_new_pose).transpose()?,
    })
}

pub(super) fn encode_merged(merged: &MergedMap) -> v1::MergedMap {
    let MergedMap {
        name,
        create_time_ns,
        revision,
        display_name,
        policy,
        target_from_source,
        clients,
        first,
    } = merged;
    v1::MergedMap {
        name: name.clone(),
        create_time_ns: *create_time_ns,
        revision: *revision,
        display_name: display_name.clone(),
        policy: Some(encode_policy(policy)),
        target_from_source: Some(encode_pose(&target_from_source.rigid())),
        scale: encode_scale(target_from_source.scale),
        clients: clients.iter().map(encode_client).collect(),
        first: first.as_ref().map(encode_new_pose),
    }
}

pub(super) fn decode_merged(merged: v1::MergedMap) -> Result<MergedMap, EncodingError> {
    Ok(MergedMap {
        name: merged.name,
        create_time_ns: merged.create_time_ns,
        revision: merged.revision,
        display_name: merged.display_name,
        policy: decode_policy(merged.policy)?,
        target_from_source: decode_similarity(
            merged.target_from_source,
            merged.scale,
            "target_from_source",
        )?,
        clients: merged.clients.into_iter().map(decode_client).collect(),
        first: merged.first.map(decode_new_pose).transpose()?,
    })
}

fn encode_client(client: &MergedClient) -> v1::MergedClient {
    v1::MergedClient { index: client.index.0, name: client.name.clone() }
}

fn decode_client(client: v1::MergedClient) -> MergedClient {
    MergedClient { index: ClientIndex(client.index), name: client.name }
}
