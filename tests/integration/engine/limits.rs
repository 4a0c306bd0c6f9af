//! Full maps and full tenants: what is refused, what makes room, who goes on undisturbed.

use std::sync::Arc;

use covis::map::{Item, Map, MapLimits, MapPolicy, WhenFull};
use covis::service::engine::{
    AccountLimits, Accounts, AckStatus, EngineConfig, EngineError, Maps, PoolError, Resource,
    SolverPool, StreamEvent,
};
use covis::store::{MemoryStore, Store};

use futures_util::FutureExt;

use super::{Client, Fixture, noisy_keyframe};
use crate::common::{Occupied, hold, large, small};
use crate::map_support::{camera_item, id, landmark};

fn tight(when_full: WhenFull) -> MapPolicy {
    let limits = MapLimits { keyframes: Some(6), ..MapLimits::default() };
    MapPolicy { limits, when_full, ..MapPolicy::default() }
}

#[tokio::test]
async fn a_full_map_that_may_forget_takes_every_keyframe() {
    for when_full in [WhenFull::Marginalize, WhenFull::Sparsify] {
        let fixture = Fixture::lock_step().await;
        let map = fixture.map(tight(when_full)).await;
        let mut client = Client::open(&map).await;
        client.send_street(0..20).await;
        let acks = client.finish().await;
        let taken = |status: &AckStatus| matches!(status, AckStatus::Received { duplicate: false });
        assert_eq!(acks.iter().filter(|ack| taken(&ack.status)).count(), 21);
        let now = map.snapshot().await.unwrap();
        assert_eq!(now.keyframes().len(), 6);
        assert!(now.keyframes().contains_key(&id(19)) && now.keyframes().contains_key(&id(18)));
        assert_eq!(fixture.replayed().await.state_hash(), now.state_hash());
    }
}

#[tokio::test]
async fn one_item_cannot_push_out_a_map() {
    let fixture = Fixture::plain().await;
    let limits = MapLimits { landmarks: Some(100), ..MapLimits::default() };
    let policy = MapPolicy { limits, when_full: WhenFull::Marginalize, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..5).await;
    let landmarks = (1000..1050).map(landmark).collect();
    client.send(Item::Landmarks { landmarks }).await;
    let full = EngineError::MapLimit {
        map: "house".to_owned(),
        limit: "max_landmark_count",
        maximum: 100,
    };
    assert_eq!(client.end().await, full);
    assert_eq!(map.snapshot().await.unwrap().keyframes().len(), 5);
}

#[tokio::test]
async fn one_item_may_retire_several_keyframes() {
    let street = async |max_landmarks, more: i64| {
        let fixture = Fixture::lock_step().await;
        let limits = MapLimits { landmarks: max_landmarks, ..MapLimits::default() };
        let policy = MapPolicy { limits, when_full: WhenFull::Marginalize, ..MapPolicy::default() };
        let map = fixture.map(policy).await;
        let mut client = Client::open(&map).await;
        client.send_street(0..16).await;
        let landmarks = (1000..1000 + more).map(landmark).collect();
        client.send(Item::Landmarks { landmarks }).await;
        client.finish().await;
        map.snapshot().await.unwrap()
    };
    let all = street(None, 1).await;
    let some = street(Some(all.landmarks().len() as u64), 30).await;
    assert!(some.keyframes().len() + 2 <= all.keyframes().len(), "{}", some.keyframes().len());
    assert!(some.landmarks().contains_key(&id(1029)));
}

#[tokio::test]
async fn memory_has_a_limit_too() {
    let fixture = Fixture::lock_step().await;
    let max_bytes = Some(60_000);
    let limits = MapLimits { bytes: max_bytes, ..MapLimits::default() };
    let policy = MapPolicy { limits, when_full: WhenFull::Marginalize, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut client = Client::open(&map).await;
    client.send_street(0..30).await;
    client.finish().await;
    let now = map.snapshot().await.unwrap();
    assert!(now.keyframes().len() < 20 && now.keyframes().contains_key(&id(29)));
    assert!(now.usage().bytes <= 60_000, "{:?}", now.usage());
}

/// Maps over memory whose tenants may hold what `common` says.
async fn maps_with(common: AccountLimits) -> Maps {
    let pool = SolverPool::shared_by(
        Accounts::new(AccountLimits::default(), common, AccountLimits::default()),
        1,
    )
    .unwrap();
    let store: Arc<dyn Store> = Arc::new(MemoryStore::new());
    Maps::open(store, pool, EngineConfig::default()).await.unwrap()
}

#[tokio::test]
async fn the_maps_of_a_tenant_share_its_limits_and_no_others_do() {
    let held = MapLimits { keyframes: Some(5), ..MapLimits::default() };
    let maps = maps_with(AccountLimits::of_maps(held)).await;
    for name in ["acme.a", "acme.b", "rival.a", "house"] {
        maps.create(name, "", MapPolicy::default()).await.unwrap();
    }
    let mut a = Client::open(&maps.get("acme.a").unwrap()).await;
    a.send_street(0..3).await;
    a.received(4).await;
    let mut b = Client::open(&maps.get("acme.b").unwrap()).await;
    b.send_street(0..3).await;
    let full = EngineError::TenantLimit { limit: "tenant_max_keyframe_count", maximum: 5 };
    assert_eq!(b.end().await, full);
    for name in ["rival.a", "house"] {
        let mut other = Client::open(&maps.get(name).unwrap()).await;
        other.send_street(0..5).await;
        other.received(6).await;
    }
    // What a map held is free again when it is deleted.
    maps.delete("acme.a").await.unwrap();
    let mut b = Client::open(&maps.get("acme.b").unwrap()).await;
    let sequence = b.send(noisy_keyframe(2)).await;
    b.received(sequence).await;
}

#[tokio::test]
async fn a_tenant_has_so_many_maps_and_streams_and_no_more() {
    let limits = AccountLimits::default().with(Resource::Maps, 2).with(Resource::Streams, 2);
    let maps = maps_with(limits).await;
    maps.create("acme.a", "", MapPolicy::default()).await.unwrap();
    maps.create("acme.b", "", MapPolicy::default()).await.unwrap();
    let full = |limit| EngineError::TenantLimit { limit, maximum: 2 };
    let refused = maps.create("acme.c", "", MapPolicy::default()).await.unwrap_err();
    assert_eq!(refused, full("tenant_max_map_count"));
    let taken = maps.create("acme.a", "", MapPolicy::default()).await.unwrap_err();
    assert_eq!(taken, EngineError::MapExists { map: "acme.a".to_owned() });
    maps.create("rival.c", "", MapPolicy::default()).await.unwrap();
    maps.delete("acme.b").await.unwrap();
    maps.create("acme.c", "", MapPolicy::default()).await.unwrap();

    let map = maps.get("acme.a").unwrap();
    let watch = map.watch(None).await.unwrap();
    let client = Client::open(&map).await;
    let refused = map.open_stream("drone".to_owned(), 0, false).await.unwrap_err();
    assert_eq!(refused, full("tenant_max_stream_count"));
    drop(watch);
    map.open_stream("drone".to_owned(), 0, false).await.unwrap();
    client.finish().await;
}

#[tokio::test]
async fn solves_of_a_flooding_tenant_leave_their_turns_to_another() {
    let maps = maps_with(AccountLimits::default()).await;
    let pool = Arc::clone(maps.pool());
    let blocker = Occupied::new(maps.pool()).await;
    let (flood, quiet) = (pool.accounts().tenant("flood"), pool.accounts().tenant("quiet"));
    let (order, ran) = std::sync::mpsc::channel();
    let mut calls = Vec::new();
    for (tenant, name, count) in [(&flood, "flood", 50), (&quiet, "quiet", 2)] {
        for _ in 0..count {
            let (pool, tenant, order) = (Arc::clone(&pool), Arc::clone(tenant), order.clone());
            let mut call = Box::pin(async move {
                pool.run(&tenant, small(), move || {
                    // Work of some length, so that the tenants' clocks move.
                    let sum: f64 = (0..200_000).map(|k| f64::from(k).sqrt()).sum();
                    order.send((name, sum)).unwrap();
                })
                .await
            });
            // Once polled it waits in the pool, in this order.
            assert!((&mut call).now_or_never().is_none());
            calls.push(call);
        }
    }
    drop(blocker);
    for call in calls {
        call.await.unwrap();
    }
    let names: Vec<&str> = ran.try_iter().map(|(name, _)| name).collect();
    let last_quiet = names.iter().rposition(|&name| name == "quiet").unwrap();
    assert!(last_quiet < 10, "{names:?}");
}

#[tokio::test]
async fn a_small_solve_does_not_wait_behind_a_large_one() {
    let maps = maps_with(AccountLimits::default()).await;
    let pool = Arc::clone(maps.pool());
    let _large = hold(&pool, large()).await;
    let tenant = pool.accounts().tenant("acme");
    assert_eq!(pool.run(&tenant, small(), || 1).await, Ok(1));
    let mut second = Box::pin(pool.run(&tenant, large(), || 2));
    assert!((&mut second).now_or_never().is_none());
}

#[tokio::test]
async fn large_solves_wait_until_their_memory_is_free() {
    let none = AccountLimits::default();
    let budget = none.with(Resource::RunningSolveBytes, 3 << 29);
    let pool = SolverPool::shared_by(Accounts::new(budget, none, none), 2).unwrap();
    let first = hold(&pool, large()).await;
    let server = Arc::clone(pool.accounts().server());
    assert_eq!(server.held(Resource::RunningSolveBytes), 1 << 30);
    let tenant = pool.accounts().tenant("acme");
    let mut second = Box::pin(pool.run(&tenant, large(), || 2));
    assert!((&mut second).now_or_never().is_none(), "two have 2 GiB, of 1.5");
    drop(first);
    assert_eq!(second.await, Ok(2));
}

#[tokio::test]
async fn calls_that_wait_for_a_solve_have_a_limit() {
    let limits = AccountLimits::default().with(Resource::WaitingSolves, 1);
    let maps = maps_with(limits).await;
    let pool = Arc::clone(maps.pool());
    let _blocker = Occupied::new(maps.pool()).await;
    let tenant = pool.accounts().tenant("acme");
    let mut waits = Box::pin(pool.run(&tenant, small(), || 1));
    assert!((&mut waits).now_or_never().is_none());
    let limit = "tenant_max_waiting_solve_count";
    let full = PoolError::Full(EngineError::TenantLimit { limit, maximum: 1 });
    assert_eq!(pool.run(&tenant, small(), || 2).await, Err(full));
}

#[tokio::test]
async fn a_watcher_is_told_of_what_a_retired_keyframe_took_along() {
    let fixture = Fixture::lock_step().await;
    let map = fixture.map(tight(WhenFull::Marginalize)).await;
    let mut watch = map.watch(None).await.unwrap();
    assert!(watch.next().await.unwrap().reset);
    let mut client = Client::open(&map).await;
    client.send_street(0..6).await;
    let before = client.received(7).await.revision;
    let _all = watch.next().await.unwrap();
    let sequence = client.send(noisy_keyframe(6)).await;
    client.received(sequence).await;
    let step = watch.next().await.unwrap();
    assert!(step.touched.keyframes.contains(&id(0)));
    let now: &Map = &step.snapshot;
    assert!(!now.keyframes().contains_key(&id(0)));
    assert!(now.constraints().keys().all(|id| step.touched.constraints.contains(id)));
    // Who comes back with an earlier revision gets everything: what went cannot be told any more.
    let mut again = map.watch(Some(before)).await.unwrap();
    assert!(again.next().await.unwrap().reset);
}

#[tokio::test]
async fn cameras_and_clients_have_limits_like_everything_else() {
    let fixture = Fixture::plain().await;
    let limits = MapLimits { cameras: Some(3), clients: Some(2), ..MapLimits::default() };
    let policy = MapPolicy { limits, when_full: WhenFull::Marginalize, ..MapPolicy::default() };
    let map = fixture.map(policy).await;
    let mut robot = Client::open(&map).await;
    for id in 0..4 {
        robot.send(camera_item(id)).await;
    }
    let full = |limit, maximum| EngineError::MapLimit { map: "house".to_owned(), limit, maximum };
    assert_eq!(robot.end().await, full("max_camera_count", 3));
    let _drone = Client::open_as(&map, "drone").await;
    let refused = map.open_stream("third".to_owned(), 0, false).await.unwrap_err();
    assert_eq!(refused, full("max_client_count", 2));
    // One that is known comes back.
    let _robot = Client::open(&map).await;
    assert_eq!(map.snapshot().await.unwrap().usage().clients, 2);
}

#[tokio::test]
async fn cameras_count_in_bytes() {
    let fixture = Fixture::plain().await;
    let limits = MapLimits { bytes: Some(100_000), ..MapLimits::default() };
    let map = fixture.map(MapPolicy { limits, ..MapPolicy::default() }).await;
    let mut client = Client::open(&map).await;
    let mut taken = 0;
    let error = loop {
        client.sender.send(taken + 1, [taken as u8; 32], camera_item(taken)).await.unwrap();
        taken += 1;
        match client.event().await {
            StreamEvent::Ack(_) => {}
            StreamEvent::End(error) => break error,
        }
    };
    let limit = "max_size_bytes";
    assert_eq!(error, EngineError::MapLimit { map: "house".to_owned(), limit, maximum: 100_000 });
    assert!(taken < 1000, "{taken} cameras");
    assert!(map.snapshot().await.unwrap().usage().bytes <= 100_000);
}

#[tokio::test]
async fn the_maps_of_all_tenants_share_the_limits_of_the_server() {
    let held = MapLimits { keyframes: Some(5), ..MapLimits::default() };
    let server = AccountLimits::of_maps(held).with(Resource::Maps, 2);
    let accounts = Accounts::new(server, AccountLimits::default(), AccountLimits::default());
    let pool = SolverPool::shared_by(accounts, 1).unwrap();
    let store: Arc<dyn Store> = Arc::new(MemoryStore::new());
    let maps = Maps::open(store, pool, EngineConfig::default()).await.unwrap();
    for name in ["acme.a", "rival.b"] {
        maps.create(name, "", MapPolicy::default()).await.unwrap();
    }
    let full = |limit, maximum| EngineError::ServerLimit { limit, maximum };
    let refused = maps.create("third.c", "", MapPolicy::default()).await.unwrap_err();
    assert_eq!(refused, full("max_map_count", 2));
    // A creation that failed gave its place back, and so does a map that is deleted.
    maps.delete("rival.b").await.unwrap();
    let refused = maps.create("acme.a", "", MapPolicy::default()).await.unwrap_err();
    assert_eq!(refused, EngineError::MapExists { map: "acme.a".to_owned() });
    maps.create("rival.b", "", MapPolicy::default()).await.unwrap();

    let mut a = Client::open(&maps.get("acme.a").unwrap()).await;
    a.send_street(0..3).await;
    a.received(4).await;
    let mut b = Client::open(&maps.get("rival.b").unwrap()).await;
    b.send_street(0..3).await;
    assert_eq!(b.end().await, full("max_keyframe_count", 5));
}

#[tokio::test]
async fn a_stream_is_given_back_when_it_could_not_be_opened() {
    let limits = AccountLimits::default().with(Resource::Streams, 1);
    let maps = maps_with(limits).await;
    maps.create("house", "", MapPolicy::default()).await.unwrap();
    let map = maps.get("house").unwrap();
    let client = Client::open(&map).await;
    client.finish().await;
    let refused = map.open_stream("robot".to_owned(), 1, false).await.unwrap_err();
    assert!(matches!(refused, EngineError::EpochFenced { .. }));
    let refused = map.open_stream("robot".to_owned(), i64::MAX, false).await.unwrap_err();
    assert!(matches!(refused, EngineError::TooLarge { field: "open.epoch", .. }));
    let _again = Client::open(&map).await;
    assert_eq!(map.account().held(Resource::Streams), 1);
}
