//! Watching: steps without gaps, joined for a slow reader, from any revision.

use covis::map::MapPolicy;
use covis::service::engine::EngineError;
use futures_util::FutureExt;

use super::{Client, Fixture, noisy_keyframe};
use crate::map_support::id;

#[tokio::test]
async fn steps_have_no_gap_and_join_for_a_slow_reader() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut watch = map.watch(None).await.unwrap();
    assert_eq!(watch.reset.as_ref().unwrap().revision(), watch.base_revision);
    let mut client = Client::open(&map).await;
    client.send_street(0..4).await;
    client.received(5).await;
    let first = watch.next().await.unwrap();
    assert_eq!(first.base_revision, watch.base_revision);
    assert_eq!(first.revision, first.snapshot.revision());
    assert!(first.revision > first.base_revision + 4, "{first:?}");
    assert!(first.touched.keyframes.contains(&id(0)) && first.touched.cameras.contains(&id(0)));
    assert_eq!(first.touched.clients.len(), 1);
    client.send(noisy_keyframe(4)).await;
    client.finish().await;
    let second = watch.next().await.unwrap();
    assert_eq!(second.base_revision, first.revision);
    assert!(second.touched.keyframes.contains(&id(4)));
    // Nothing more comes, and asking in vain loses nothing.
    assert!(watch.next().now_or_never().is_none());
}

#[tokio::test]
async fn a_watcher_goes_on_from_the_revision_that_it_holds() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(MapPolicy::default()).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..2).await;
    let revision = client.received(3).await.revision;
    client.finish().await;
    let newest = map.snapshot().await.unwrap().revision();
    assert!(newest > revision);
    let mut watch = map.watch(Some(revision)).await.unwrap();
    assert!(watch.reset.is_none());
    assert_eq!(watch.base_revision, revision);
    let step = watch.next().await.unwrap();
    assert_eq!((step.base_revision, step.revision), (revision, newest));
    // The solve moved the second keyframe; the camera was there before.
    assert!(step.touched.keyframes.contains(&id(1)) && step.touched.cameras.is_empty());
    let mut current = map.watch(Some(newest)).await.unwrap();
    assert!(current.reset.is_none() && current.next().now_or_never().is_none());
    let ahead = map.watch(Some(newest + 1)).await.unwrap_err();
    let expected =
        EngineError::RevisionAhead { map: "house".to_owned(), revision: newest + 1, newest };
    assert_eq!(ahead, expected);
}
