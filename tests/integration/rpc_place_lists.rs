//! Searches for places as a user meets them: the pages of `ListPlaceSearches`, the command line, a closure
//! of the server's that is revoked, and searches that a restart interrupts.

use std::collections::BTreeSet;
use std::path::Path;

use covis::wire::v1;
use tonic::{Code, Status};
use v1::constraint::Constraint;
use v1::ingest_request::Item;

use crate::cli_support::Workspace;
use crate::common::{Stream, TestServer, check_field, check_status, occupy, run};
use crate::durable::on_disk;
use crate::rpc_localize::walk;
use crate::sequence::{Order, items};

fn of_room() -> v1::ListPlaceSearchesRequest {
    v1::ListPlaceSearchesRequest { map_id: "room".to_owned(), ..Default::default() }
}

async fn pages(
    server: &TestServer,
    request: v1::ListPlaceSearchesRequest,
) -> Result<Vec<v1::ListPlaceSearchesResponse>, Status> {
    let mut stream = server.maps().list_place_searches(request).await?.into_inner();
    let mut pages = Vec::new();
    while let Some(page) = stream.message().await? {
        pages.push(page);
    }
    Ok(pages)
}

async fn searches(server: &TestServer) -> Vec<v1::PlaceSearch> {
    let pages = pages(server, of_room()).await.unwrap();
    pages.into_iter().flat_map(|page| page.searches).collect()
}

/// Sends items and waits until all that they started is done; the server is in lock-step.
async fn send(server: &TestServer, (first, items): (i64, &[Item])) {
    let (stream, _) = Stream::open(server, "room", "robot", 0).await;
    for (number, item) in (first..).zip(items) {
        stream.send(number, item.clone()).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

#[test]
fn searches_are_listed_page_by_page_and_by_the_command_line() {
    let items = items(&walk().sequence, &[], Order::Streamed);
    run(async {
        let server = TestServer::lock_step().await;
        check_status(
            &pages(&server, of_room()).await.unwrap_err(),
            Code::NotFound,
            "MAP_NOT_FOUND",
        );
        server.create_map("room").await;
        let empty = pages(&server, of_room()).await.unwrap();
        assert_eq!((empty.len(), empty[0].searches.len()), (1, 0));
        assert_eq!(empty[0].next_page_token, "");
        send(&server, (1, &items)).await;

        let all = searches(&server).await;
        let ids: Vec<i64> = all.iter().map(|s| s.keyframe.as_ref().unwrap().id).collect();
        assert_eq!(ids, (0..items.len() as i64 - 1).collect::<Vec<_>>());
        let small = v1::ListPlaceSearchesRequest { page_size: 7, ..of_room() };
        let paged = pages(&server, small.clone()).await.unwrap();
        assert_eq!(paged.len(), all.len().div_ceil(7));
        let joined: Vec<_> = paged.iter().flat_map(|page| page.searches.clone()).collect();
        assert_eq!(joined, all);
        assert_eq!(paged.last().unwrap().next_page_token, "");
        // Goes on behind a page.
        let page_token = paged[1].next_page_token.clone();
        let rest = v1::ListPlaceSearchesRequest { page_token: page_token.clone(), ..small };
        let rest = pages(&server, rest).await.unwrap();
        assert_eq!(
            rest.iter().flat_map(|page| page.searches.clone()).collect::<Vec<_>>(),
            all[14..]
        );
        let bad = |page_token: &str, page_size| {
            let page_token = page_token.to_owned();
            v1::ListPlaceSearchesRequest { page_token, page_size, ..of_room() }
        };
        let refused = pages(&server, bad("nonsense", 0)).await.unwrap_err();
        check_field(&refused, "page_token", "OUT_OF_RANGE");
        let refused = pages(&server, bad("", -1)).await.unwrap_err();
        check_field(&refused, "page_size", "OUT_OF_RANGE");
        // Of another list.
        let other = v1::ListConstraintsRequest {
            map_id: "room".to_owned(),
            page_token,
            ..Default::default()
        };
        let mut stream = server.maps().list_constraints(other).await.unwrap().into_inner();
        check_field(&stream.message().await.unwrap_err(), "page_token", "OUT_OF_RANGE");

        // The command line tells the same.
        let closed: Vec<_> = all.iter().filter_map(|search| search.closure.clone()).collect();
        assert!(closed.len() >= 5, "{closed:?}");
        assert!(closed.iter().all(|closure| closure.client_id == "robot" && closure.id < 0));
        let url = format!("http://{}", server.running.local_addr());
        let first = closed[0].id;
        let (table, json, revoked, after) = tokio::task::spawn_blocking(move || {
            let workspace = Workspace::new();
            let table = workspace.run(&format!("map closures room --server {url}"), &[]);
            let closures = format!("map closures room --json --server {url}");
            let json = workspace.json(&closures, &[]);
            let revoke =
                format!("map edit room revoke-constraint robot {first} --server {url} --json");
            let revoked = workspace.run(&revoke, &[]);
            (table, json, revoked, workspace.json(&closures, &[]))
        })
        .await
        .unwrap();
        assert_eq!(table.code, Some(0), "{}", table.stderr);
        assert!(table.stdout.starts_with("keyframe"), "{}", table.stdout);
        assert!(table.stdout.contains("robot/"), "{}", table.stdout);
        assert_eq!(json["closures"], closed.len());
        assert_eq!(json["map"], "room");
        let candidates: usize = all.iter().map(|search| search.candidates.len()).sum();
        assert_eq!(json["candidates"].as_array().unwrap().len(), candidates);
        // A closure of the server's is revoked as a client's, and stays listed as removed.
        assert_eq!(revoked.code, Some(0), "{}", revoked.stderr);
        assert_eq!(after["closures"], closed.len() - 1);
        let verdicts = after["candidates"].as_array().unwrap().iter();
        assert_eq!(verdicts.filter(|row| row["verdict"] == "removed").count(), 1);
        let list = v1::ListConstraintsRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut stream = server.maps().list_constraints(list).await.unwrap().into_inner();
        while let Some(page) = stream.message().await.unwrap() {
            for constraint in page.constraints {
                let Some(Constraint::RelativePose(pose)) = constraint.constraint else { continue };
                assert_ne!(pose.id, first);
            }
        }
    });
}

/// The keyframes with half of their observations, each followed by the other half.
fn in_halves(items: Vec<Item>) -> Vec<Item> {
    let halves = |item: Item| {
        let Item::Keyframe(mut keyframe) = item else { return vec![item] };
        let (mut early, mut late) = (Vec::new(), Vec::new());
        for (k, seen) in std::mem::take(&mut keyframe.observations).into_iter().enumerate() {
            if k % 2 == 0 { early.push(seen) } else { late.push(seen) }
        }
        let of = v1::KeyframeRef { id: keyframe.id, ..Default::default() };
        let late = v1::ObservationBatch { keyframe: Some(of), observations: late };
        vec![
            Item::Keyframe(v1::Keyframe { observations: early, ..keyframe }),
            Item::Observations(late),
        ]
    };
    items.into_iter().flat_map(halves).collect()
}

#[test]
fn closures_of_every_search_of_a_keyframe_are_listed() {
    let items = in_halves(items(&walk().sequence, &[], Order::Streamed));
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("room").await;
        send(&server, (1, &items)).await;
        let mut in_map = BTreeSet::new();
        let list = v1::ListConstraintsRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut stream = server.maps().list_constraints(list).await.unwrap().into_inner();
        while let Some(page) = stream.message().await.unwrap() {
            for constraint in page.constraints {
                if let Some(Constraint::RelativePose(pose)) = constraint.constraint
                    && pose.kind() == v1::ConstraintKind::LoopClosure
                {
                    in_map.insert((pose.keyframe_j.unwrap().id, pose.id));
                }
            }
        }
        let searches = searches(&server).await;
        let listed: BTreeSet<(i64, i64)> = searches
            .iter()
            .flat_map(|search| {
                let keyframe = search.keyframe.as_ref().unwrap().id;
                let closures = search.closure.iter().chain(&search.earlier_closures);
                closures.map(move |closure| (keyframe, closure.id))
            })
            .collect();
        assert_eq!(listed, in_map);
        let is_again = |s: &&v1::PlaceSearch| !s.earlier_closures.is_empty();
        let again = searches.iter().filter(is_again).count();
        assert!(again >= 2, "{again} keyframes have an earlier closure");
    });
}

#[test]
fn a_full_map_tells_that_it_has_no_room_for_a_closure() {
    let items = items(&walk().sequence, &[], Order::Streamed);
    run(async {
        let server = TestServer::lock_step().await;
        let limits = v1::MapLimits { max_constraint_count: Some(1), ..Default::default() };
        let policy = v1::MapPolicy { limits: Some(limits), ..Default::default() };
        server.create_map_with("room", policy).await;
        send(&server, (1, &items)).await;
        let searches = searches(&server).await;
        assert_eq!(searches.len(), items.len() - 1, "nothing is searched again and again");
        assert_eq!(searches.iter().filter(|search| search.closure.is_some()).count(), 1);
        let refusals: Vec<_> = searches.iter().filter_map(|s| s.refusal.as_ref()).collect();
        assert!(refusals.len() >= 5, "{refusals:?}");
        for refusal in refusals {
            assert_eq!(refusal.reason, "no_room");
            assert!(refusal.text.contains("constraint"), "{}", refusal.text);
        }
    });
}

async fn on(folder: &Path, lock_step: bool) -> TestServer {
    let folder = folder.to_owned();
    TestServer::with(|config| {
        config.data_dir = Some(folder);
        config.engine.lock_step = lock_step;
    })
    .await
}

#[test]
fn searches_that_a_restart_interrupts_go_on() {
    let items = items(&walk().sequence, &[], Order::Streamed);
    let count = items.len() - 1;
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = on(folder.path(), false).await;
        server.create_map("room").await;
        // Nothing is searched while the pool is busy.
        let busy = occupy(&server).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        for (number, item) in (1..).zip(&items) {
            assert!(stream.put(number, item.clone()).await.violations.is_empty());
        }
        let ending = tokio::spawn(server.running.shutdown());
        // The server ends its streams first, and starts no search after that.
        stream.end().await;
        drop(busy);
        ending.await.unwrap();
        let map = on_disk(folder.path(), "room").await;
        let pending = map.place_searches().pending.len();
        assert!(pending + 4 >= count, "{pending} of {count} wait");

        let server = on(folder.path(), true).await;
        // In lock-step a stream ends when nothing is due.
        send(&server, (items.len() as i64 + 1, &[])).await;
        let searches = searches(&server).await;
        assert_eq!(searches.len(), count);
        assert!(searches.iter().filter(|search| search.closure.is_some()).count() >= 5);
        server.running.shutdown().await;
        let map = on_disk(folder.path(), "room").await;
        assert!(map.place_searches().pending.is_empty());
        assert_eq!(map.place_searches().unsolved, 0, "a pose graph covers what was found");
    });
}

#[test]
fn a_restart_in_lock_step_finds_the_same() {
    let items = items(&walk().sequence, &[], Order::Streamed);
    run(async {
        let mut outcomes = Vec::new();
        for restarts in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let mut server = on(folder.path(), true).await;
            server.create_map("room").await;
            // Both have the same streams, and so the same revisions.
            let (first, second) = items.split_at(items.len() * 2 / 3);
            send(&server, (1, first)).await;
            if restarts {
                server.running.shutdown().await;
                server = on(folder.path(), true).await;
            }
            send(&server, (first.len() as i64 + 1, second)).await;
            outcomes.push(searches(&server).await);
            server.running.shutdown().await;
        }
        assert!(outcomes[0].iter().any(|search| search.closure.is_some()));
        assert_eq!(outcomes[0], outcomes[1]);
    });
}
