//! `CopyMap`: a map as it is and as it was, from memory and from a disk, with what the journal keeps no more.

use covis::wire::v1;
use prost_types::Timestamp;
use tonic::{Code, Status};
use v1::copy_map_request::At;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, camera, check_field, check_status, keyframe, run};
use crate::job_support::{Jobs, compact, state_hash};

/// A map that nothing but its client changes.
fn quiet() -> v1::MapPolicy {
    v1::MapPolicy {
        local_bundle_adjustment: Some(false),
        place_recognition: Some(v1::PlaceRecognition { enabled: Some(false) }),
        ..Default::default()
    }
}

/// Sends the camera and keyframes; what the map was after each item: revision and hash.
async fn states(server: &TestServer, map_id: &str, keyframes: i64) -> Vec<(i64, Vec<u8>)> {
    let (mut stream, _) = Stream::open(server, map_id, "robot", 0).await;
    let items = (0..keyframes).map(|id| Item::Keyframe(keyframe(id)));
    let mut states = Vec::new();
    for (sequence, item) in (1..).zip(std::iter::once(Item::Camera(camera(0))).chain(items)) {
        let revision = stream.put(sequence, item).await.revision;
        states.push((revision, state_hash(server, map_id).await));
    }
    stream.finish().await.unwrap();
    states
}

fn request(new: &str, at: Option<At>) -> v1::CopyMapRequest {
    let (source_map_id, new_map_id) = ("room".to_owned(), new.to_owned());
    v1::CopyMapRequest { source_map_id, new_map_id, at, state: 0 }
}

async fn copy(
    server: &TestServer,
    request: v1::CopyMapRequest,
) -> Result<v1::CopyMapResponse, Status> {
    Ok(server.maps().copy_map(request).await?.into_inner())
}

async fn get(server: &TestServer, map_id: &str) -> v1::Map {
    let request = v1::GetMapRequest { map_id: map_id.to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

/// Every state of a map is restored by its revision and by its time; the source stays as it is.
async fn every_state_comes_back(server: &TestServer) {
    server.create_map_with("room", quiet()).await;
    let states = states(server, "room", 5).await;
    let before = get(server, "room").await;
    for (index, (revision, hash)) in states.iter().enumerate() {
        let name = format!("at-{index}");
        let made = copy(server, request(&name, Some(At::Revision(*revision)))).await.unwrap();
        assert_eq!(made.revision, *revision);
        let map = made.map.unwrap();
        assert_eq!((map.revision, map.state()), (*revision, v1::MapState::Open));
        assert_ne!(map.uid, before.uid);
        assert_eq!(state_hash(server, &name).await, *hash, "revision {revision}");
        let name = format!("on-{index}");
        let by_time = copy(server, request(&name, made.time.map(At::Time))).await.unwrap();
        assert_eq!((by_time.revision, by_time.time), (*revision, made.time));
        assert_eq!(state_hash(server, &name).await, *hash);
    }
    let now = copy(server, v1::CopyMapRequest { state: 2, ..request("now", None) }).await.unwrap();
    let map = now.map.unwrap();
    assert_eq!((map.revision, map.state()), (before.revision, v1::MapState::Frozen));
    assert_eq!(map.display_name, before.display_name);
    assert_eq!(state_hash(server, "now").await, state_hash(server, "room").await);
    assert_eq!(get(server, "room").await, before, "the source was changed");
    // A restored map goes on where it was.
    let (mut stream, opened) = Stream::open(server, "at-2", "robot", 0).await;
    assert_eq!((opened.next_sequence, opened.next_keyframe_id), (4, 2));
    let ack = stream.put(4, Item::Keyframe(keyframe(2))).await;
    assert!(ack.violations.is_empty() && !ack.duplicate, "{ack:?}");
    stream.finish().await.unwrap();
    assert_eq!(get(server, "at-2").await.counts.unwrap().keyframe_count, 3);
}

#[test]
fn every_state_of_a_map_comes_back_from_memory() {
    run(async { every_state_comes_back(&TestServer::start().await).await });
}

#[test]
fn every_state_of_a_map_comes_back_from_a_disk_also_after_a_restart() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        every_state_comes_back(&server).await;
        let hash = state_hash(&server, "at-1").await;
        server.running.shutdown().await;
        let server = TestServer::with(|config| config.data_dir = Some(path.clone())).await;
        assert_eq!(state_hash(&server, "at-1").await, hash, "the copy was not durable");
        let again = copy(&server, request("again", Some(At::Revision(4)))).await.unwrap();
        assert_eq!(again.map.unwrap().counts.unwrap().keyframe_count, 1);
        // The journal of a copy begins with it.
        let first = v1::CopyMapRequest {
            source_map_id: "again".to_owned(),
            ..request("none", Some(At::Revision(3)))
        };
        let status = copy(&server, first).await.unwrap_err();
        check_field(&status, "revision", "OUT_OF_RANGE");
        assert!(status.message().contains("at revisions 4 to 4"), "{status}");
        server.running.shutdown().await;
    });
}

#[test]
fn a_state_that_is_not_kept_is_refused_with_the_oldest_and_the_newest() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        for data_dir in [None, Some(path)] {
            let server = TestServer::with(|config| config.data_dir = data_dir).await;
            server.create_map_with("room", quiet()).await;
            let old = states(&server, "room", 3).await;
            let created = get(&server, "room").await.create_time.unwrap();
            let newest = get(&server, "room").await.revision;
            for (at, field) in [
                (At::Revision(newest + 1), "revision"),
                (At::Time(Timestamp { seconds: created.seconds + 1_000_000, nanos: 0 }), "time"),
                (At::Time(Timestamp { seconds: created.seconds - 1, nanos: 0 }), "time"),
            ] {
                let status = copy(&server, request("none", Some(at))).await.unwrap_err();
                check_field(&status, field, "OUT_OF_RANGE");
                let range = format!("at revisions 1 to {newest}, that is at times {created} to 2");
                assert!(status.message().contains(&range), "{status}");
            }
            // The journal before a snapshot is dropped: the map cannot go further back.
            let jobs = Jobs::of(&server);
            jobs.create("drop", compact("room", None)).await.unwrap();
            jobs.success("drop").await;
            let kept = get(&server, "room").await.revision;
            let old = At::Revision(old[1].0);
            let status = copy(&server, request("none", Some(old))).await.unwrap_err();
            check_field(&status, "revision", "OUT_OF_RANGE");
            let range = format!("at revisions {kept} to {kept}, that is at times ");
            assert!(status.message().contains(&range), "{status}");
            let whole = copy(&server, request("whole", Some(At::Revision(kept)))).await.unwrap();
            assert_eq!(whole.revision, kept);
            assert_eq!(state_hash(&server, "whole").await, state_hash(&server, "room").await);
            let listed = server.maps().list_maps(v1::ListMapsRequest::default()).await.unwrap();
            let names = listed.into_inner().maps.into_iter().map(|map| map.map_id);
            assert_eq!(names.collect::<Vec<_>>(), ["room", "whole"]);
            server.running.shutdown().await;
        }
    });
}

#[test]
fn a_bad_request_to_copy_names_its_field() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let bad = |change: fn(&mut v1::CopyMapRequest)| {
            let mut wrong = request("new", None);
            change(&mut wrong);
            wrong
        };
        for (wrong, field, reason) in [
            (bad(|r| r.source_map_id.clear()), "source_map_id", "MISSING"),
            (bad(|r| r.new_map_id = "New".to_owned()), "new_map_id", "OUT_OF_RANGE"),
            (bad(|r| r.at = Some(At::Revision(0))), "revision", "OUT_OF_RANGE"),
            (
                bad(|r| r.at = Some(At::Time(Timestamp { seconds: 0, nanos: -1 }))),
                "time.nanos",
                "OUT_OF_RANGE",
            ),
            (bad(|r| r.state = v1::MapState::Poisoned.into()), "state", "OUT_OF_RANGE"),
            (bad(|r| r.state = 99), "state", "UNKNOWN_VALUE"),
        ] {
            check_field(&copy(&server, wrong).await.unwrap_err(), field, reason);
        }
        let taken = copy(&server, request("room", None)).await.unwrap_err();
        check_status(&taken, Code::AlreadyExists, "MAP_EXISTS");
        let missing =
            v1::CopyMapRequest { source_map_id: "attic".to_owned(), ..request("b", None) };
        let missing = copy(&server, missing).await.unwrap_err();
        check_status(&missing, Code::NotFound, "MAP_NOT_FOUND");
    });
}

#[test]
fn a_poisoned_map_is_restored_as_it_was() {
    run(async {
        let server = TestServer::with_poisoned_map("room").await;
        assert_eq!(get(&server, "room").await.state(), v1::MapState::Poisoned);
        let made = copy(&server, request("new", Some(At::Revision(2)))).await.unwrap();
        assert_eq!(made.map.unwrap().state(), v1::MapState::Open);
    });
}
