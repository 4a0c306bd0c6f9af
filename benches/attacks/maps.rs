//! Calls with a token that make a server hold, read or repeat much.
//!
//! Each goes on until it is aborted and counts what it was answered.

use std::time::Duration;

use covis::client::{Client, IngestSession, Item, SessionOptions};
use covis::wire::v1;
use tonic::Request;
use tonic::transport::{Channel, Endpoint};
use v1::map_service_client::MapServiceClient;

use crate::server::{connect, secret};
use crate::street::{Street, camera, scatter};
use crate::{Tally, Target};

/// A connection of its own; `None` where none is to be had.
pub(crate) async fn channel(target: &Target) -> Option<Channel> {
    let connected = Endpoint::from_shared(target.url.clone()).ok()?.connect().await;
    if let Err(error) = &connected {
        target.tally.refuse(&error.to_string());
    }
    connected.ok()
}

/// A request that shows a token.
pub(crate) fn bearing<T>(name: &str, message: T) -> Request<T> {
    let mut request = Request::new(message);
    if let Ok(value) = format!("Bearer {}", secret(name)).parse() {
        request.metadata_mut().insert("authorization", value);
    }
    request
}

async fn service(target: &Target) -> Option<MapServiceClient<Channel>> {
    Some(MapServiceClient::new(channel(target).await?).max_decoding_message_size(64 << 20))
}

/// Creates and deletes maps and goes away in the middle.
pub(crate) async fn cuts(target: Target) {
    let Some(service) = service(&target).await else { return };
    for k in 0.. {
        let map_id = format!("cut-{}", k % 50);
        let after = |axis| Duration::from_secs_f64(0.004 * (1.0 + scatter(k, axis)));
        let create = v1::CreateMapRequest { map_id: map_id.clone(), ..Default::default() };
        let mut maps = service.clone();
        let created = tokio::time::timeout(after(1), maps.create_map(bearing("foe", create))).await;
        let delete = v1::DeleteMapRequest { map_id };
        let mut maps = service.clone();
        let deleted = tokio::time::timeout(after(2), maps.delete_map(bearing("foe", delete))).await;
        let _counted = created.map(|answer| target.tally.count(&answer));
        let _counted = deleted.map(|answer| target.tally.count(&answer));
    }
}

/// Reads all deltas of the robot's map since revision 1, then begins again.
pub(crate) async fn watch_from_one(target: Target) {
    let Some(mut service) = service(&target).await else { return };
    loop {
        let get = v1::GetMapRequest { map_id: "street".to_owned(), ..Default::default() };
        let Ok(map) = service.get_map(bearing("reader", get)).await else { return };
        let map = map.into_inner().map.unwrap_or_default();
        let request = v1::WatchMapRequest {
            map_id: "street".to_owned(),
            from_revision: Some(1),
            map_uid: map.uid,
            ..Default::default()
        };
        let answer = service.watch_map(bearing("reader", request)).await;
        if !target.tally.count(&answer) {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        let Ok(answer) = answer else { continue };
        let mut deltas = answer.into_inner();
        while let Ok(Some(v1::WatchMapResponse { delta: Some(delta) })) = deltas.message().await {
            if delta.revision >= map.revision && delta.last_part {
                break;
            }
        }
    }
}

/// Asks for an export of the large map and reads nothing of it.
pub(crate) async fn unread_export(target: Target) {
    loop {
        let Some(mut service) = service(&target).await else { return };
        let request = v1::ExportMapRequest {
            map_id: "large".to_owned(),
            format: v1::MapFormat::ColmapText.into(),
            all_landmarks: false,
        };
        let answer = service.export_map(bearing("foe", request)).await;
        if target.tally.count(&answer) {
            // Held for a while, then given up and asked for anew.
            tokio::time::sleep(Duration::from_secs(20)).await;
        } else {
            tokio::time::sleep(Duration::from_millis(200)).await;
        }
        drop(answer);
    }
}

/// A session into a map of its own with a limit of 100,000 bytes, or none.
async fn session(target: &Target, map: &str, bytes: Option<i64>) -> Option<IngestSession> {
    let client: Client = connect(&target.url, "foe").await.ok()?;
    let limits = v1::MapLimits { max_size_bytes: bytes, ..Default::default() };
    let policy = v1::MapPolicy {
        local_bundle_adjustment: Some(false),
        limits: Some(limits),
        ..Default::default()
    };
    client.create_map(map, Some(policy)).await.ok()?;
    let tally = std::sync::Arc::clone(&target.tally);
    let options = SessionOptions { max_unanswered: 256, ..SessionOptions::default() };
    let options = options.on_ack(move |ack| count(&tally, ack));
    client.ingest(map, "foe", options).await.ok()
}

fn count(tally: &Tally, ack: &v1::IngestAck) {
    match ack.status() {
        v1::AckStatus::Received => tally.answer(),
        v1::AckStatus::Rejected => {
            let first = ack.violations.first();
            tally.refuse(&first.map_or_else(String::new, |v| v.description.clone()));
        }
        v1::AckStatus::Durable | v1::AckStatus::Optimized | v1::AckStatus::Unspecified => {}
    }
}

/// Sends items until the session ends or the items do.
async fn pour(target: Target, map: &str, bytes: Option<i64>, items: impl Iterator<Item = Item>) {
    let Some(mut session) = session(&target, map, bytes).await else { return };
    for item in items {
        if session.send(item).await.is_err() {
            return;
        }
    }
    // The map stays as large as it is until the end.
    std::future::pending().await
}

/// More cameras than a map of 100,000 bytes can have.
pub(crate) async fn cameras(target: Target) {
    let items = (0..150_000).map(|id| Item::Camera(v1::Camera { id, ..camera() }));
    pour(target, "cameras", Some(100_000), items).await;
}

/// One landmark that every keyframe sees.
pub(crate) async fn one_landmark(target: Target) {
    let street = Street::new(1, 1);
    let keyframes = (0..4000).map(move |id| {
        let mut keyframe = street.keyframe(0);
        keyframe.id = id;
        keyframe.capture_time = Some(prost_types::Timestamp { seconds: id, nanos: 0 });
        if id > 0 {
            keyframe.landmarks.clear();
        }
        Item::Keyframe(keyframe)
    });
    let items = std::iter::once(Item::Camera(camera())).chain(keyframes);
    pour(target, "landmark", None, items).await;
}

/// Constraints between two keyframes.
pub(crate) async fn constraints(target: Target) {
    let street = Street::new(4, 4);
    let information = (0..6)
        .flat_map(|row| (row..6).map(move |column| if row == column { 100.0 } else { 0.0 }))
        .collect::<Vec<f64>>();
    let keyframe = |id| v1::KeyframeRef { id, ..Default::default() };
    let transform = street.keyframe(1).world_from_camera;
    let constraints = (0..).map(move |id| {
        Item::RelativePose(v1::RelativePoseConstraint {
            id,
            keyframe_i: Some(keyframe(0)),
            keyframe_j: Some(keyframe(1)),
            keyframe_i_from_keyframe_j: transform,
            information: Some(v1::InformationMatrix6 { upper_triangle: information.clone() }),
            kind: v1::ConstraintKind::Odometry.into(),
            ..Default::default()
        })
    });
    let begin = [Item::Camera(camera())].into_iter();
    let begin = begin.chain((0..2).map(|k| Item::Keyframe(street.keyframe(k))));
    pour(target, "constraints", None, begin.chain(constraints)).await;
}
