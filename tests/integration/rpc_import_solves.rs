//! What an import still has to solve: the solves and the adjustment that its map waited for.

use covis::wire::v1;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, camera, keyframe, occupy, relative_pose, run};
use crate::rpc_import::{export, get, header, import};
use crate::sequence::adjusted;

/// A true loop closure of the scene.
fn closure(id: i64, i: i64, j: i64) -> Item {
    let kind = v1::ConstraintKind::LoopClosure.into();
    Item::RelativePose(v1::RelativePoseConstraint { kind, ..relative_pose(id, i, j) })
}

#[test]
fn an_import_goes_on_with_the_solves_that_were_outstanding_at_the_export() {
    run(async {
        let (here, there) = (TestServer::start().await, TestServer::start().await);
        here.create_map("room").await;
        let (mut stream, _) = Stream::open(&here, "room", "robot", 0).await;
        let busy = occupy(&here).await;
        stream.put(1, Item::Camera(camera(0))).await;
        for id in 0..4 {
            stream.put(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        stream.put(6, closure(0, 0, 3)).await;
        let files = export(&here, "room", v1::MapFormat::Covis).await;
        let imported = import(&there, header("hall", v1::MapFormat::Covis), &files).await.unwrap();
        let (stream, _) = Stream::open(&there, "hall", "robot", 0).await;
        // It ends when the solves of its client have ended.
        stream.finish().await.unwrap();
        let (map, _) = get(&there, "hall").await.unwrap();
        assert!(map.revision > imported.revision + 1, "opening a stream was the only event");
        drop(busy);
    });
}

#[test]
fn an_import_starts_the_adjustment_that_was_due() {
    run(async {
        let server = TestServer::start().await;
        let waits = v1::MapPolicy { closure_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", waits).await;
        server.build_map("room", 4).await;
        let (stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        stream.send(opened.next_sequence, closure(0, 0, 3)).await;
        stream.finish().await.unwrap();
        let (before, _) = get(&server, "room").await.unwrap();
        let files = export(&server, "room", v1::MapFormat::Covis).await;
        let own = v1::ImportMapHeader {
            policy: Some(v1::MapPolicy::default()),
            ..header("hall", v1::MapFormat::Covis)
        };
        import(&server, own, &files).await.unwrap();
        adjusted(&server, "hall").await;
        let (after, _) = get(&server, "hall").await.unwrap();
        assert!(after.revision > before.revision, "an adjustment is an event");
    });
}
