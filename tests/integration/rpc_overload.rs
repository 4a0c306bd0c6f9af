//! Readers that do not read, floods, and tenants that take what they can get: the others go on.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis::client::{Client, Credentials, SessionOptions, Token, WatchOptions};
use covis::service::engine::{AccountLimits, Resource};
use covis::wire::v1;
use tempfile::NamedTempFile;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;
use tonic::transport::Endpoint;
use v1::ingest_request::Item;
use v1::ingest_response::Event;
use v1::ingest_service_client::IngestServiceClient;
use v1::map_service_client::MapServiceClient;

use crate::common::{
    Stream, TestServer, camera, check_retry, check_status, keyframe, open_item, run, vector3,
};
use crate::rpc_access::tokens_toml;

/// Keyframe `id` with what keyframe `id` modulo 6 sees.
fn endless(id: i64) -> v1::Keyframe {
    v1::Keyframe { id, ..keyframe(id % 6) }
}

fn no_solves() -> v1::MapPolicy {
    v1::MapPolicy { local_bundle_adjustment: Some(false), ..v1::MapPolicy::default() }
}

fn url(server: &TestServer) -> String {
    format!("http://{}", server.running.local_addr())
}

/// Streams keyframes over a connection of its own until all are answered.
async fn walk(server: &TestServer, map: &str, name: &str, keyframes: i64) {
    let client = Client::connect(&url(server)).await.unwrap();
    let mut session = client.ingest(map, name, SessionOptions::default()).await.unwrap();
    session.send(camera(0)).await.unwrap();
    for id in 0..keyframes {
        session.send(endless(id)).await.unwrap();
    }
    assert_eq!(session.finish().await.unwrap().acknowledged, keyframes as u64 + 1);
}

async fn keyframes(server: &TestServer, map: &str) -> i64 {
    let request = v1::GetMapRequest { map_id: map.to_owned(), ..Default::default() };
    let map = server.maps().get_map(request).await.unwrap().into_inner().map.unwrap();
    map.counts.unwrap().keyframe_count
}

#[test]
fn a_client_that_reads_no_acks_holds_up_nobody_but_itself() {
    stuck_behind_unread_acks(5000, 200);
}

#[test]
fn thousands_of_unread_small_items_do_not_break_their_link() {
    stuck_behind_unread_acks(30_000, 1);
}

/// A client sends so many items of so many landmarks and reads no ack before another client is done.
fn stuck_behind_unread_acks(items: i64, landmarks: i64) {
    run(async {
        let server = TestServer::start().await;
        server.create_map_with("house", no_solves()).await;
        let (requests, receiver) = mpsc::channel(1);
        // Little room for acks, in the windows of its own connection.
        let endpoint =
            Endpoint::from_shared(url(&server)).unwrap().initial_stream_window_size(65_535);
        let mut ingest = IngestServiceClient::new(endpoint.connect().await.unwrap());
        // More than all windows and queues hold the acks of: these sends wait for a reader.
        let sending = tokio::spawn(async move {
            let landmark = |id| v1::Landmark { id, ..v1::Landmark::default() };
            let batch = move |k: i64| v1::LandmarkBatch {
                landmarks: (landmarks * k..landmarks * (k + 1)).map(landmark).collect(),
            };
            let batches = (0..items).map(|k| Item::Landmarks(batch(k)));
            let items = [open_item("house", "stuck", 0)].into_iter().chain(batches);
            for (sequence, item) in (0..).zip(items) {
                let request = v1::IngestRequest { sequence, item: Some(item) };
                requests.send(request).await.unwrap();
            }
        });
        let answers = ingest.ingest(ReceiverStream::new(receiver)).await.unwrap();
        let mut answers = answers.into_inner();
        walk(&server, "house", "free", 40).await;
        assert!(!sending.is_finished(), "nobody had to wait");
        // Whoever reads at last gets every ack.
        let mut received = 0;
        while let Some(answer) = answers.message().await.unwrap() {
            if let Some(Event::Ack(ack)) = answer.event {
                received += i64::from(ack.status() == v1::AckStatus::Received);
            }
        }
        assert_eq!((received, keyframes(&server, "house").await), (items, 40));
    });
}

#[test]
fn a_watcher_that_reads_nothing_costs_little_and_catches_up() {
    run(async {
        let server = TestServer::start().await;
        server.create_map_with("house", no_solves()).await;
        let client = Client::connect(&url(&server)).await.unwrap();
        let mut watch = client.watch("house", WatchOptions::default()).await.unwrap();
        let request = v1::WatchMapRequest { map_id: "house".to_owned(), ..Default::default() };
        // Opened and never read.
        let _asleep = server.maps().watch_map(request).await.unwrap();
        walk(&server, "house", "robot", 300).await;
        let newest = client.get_map("house").await.unwrap();
        let mirror = watch.reach(newest.revision).await.unwrap();
        assert_eq!(mirror.keyframes.len(), 300);
    });
}

#[test]
fn lists_that_are_being_read_have_a_ceiling() {
    run(async {
        let server = TestServer::with(|config| {
            config.tenant_limits = AccountLimits::default().with(Resource::Lists, 2);
        })
        .await;
        server.create_map_with("house", no_solves()).await;
        let (mut stream, _) = Stream::open(&server, "house", "robot", 0).await;
        let batch = |first: i64| v1::LandmarkBatch {
            landmarks: (first..first + 60_000)
                .map(|id| v1::Landmark {
                    id,
                    point_in_world: Some(vector3([1.0, 2.0, id as f64])),
                    ..Default::default()
                })
                .collect(),
        };
        for k in 0..3 {
            let ack = stream.put(k + 1, Item::Landmarks(batch(60_000 * k))).await;
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        let list = async || {
            // A connection of its own, which has no room for a whole message.
            let endpoint = Endpoint::from_shared(url(&server)).unwrap();
            let endpoint = endpoint.initial_stream_window_size(65_535);
            let mut maps = MapServiceClient::new(endpoint.connect().await.unwrap());
            let request =
                v1::ListLandmarksRequest { map_id: "house".to_owned(), ..Default::default() };
            let mut pages = maps.list_landmarks(request).await?.into_inner();
            let page = pages.message().await?.unwrap();
            assert!(!page.next_page_token.is_empty());
            Ok::<_, tonic::Status>(pages)
        };
        let first = list().await.unwrap();
        let second = list().await.unwrap();
        let status = list().await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        assert!(status.message().contains("tenant_max_list_count"), "{status}");
        check_retry(&status);
        // All kinds of lists count as one.
        let request = v1::GetTrajectoryRequest { map_id: "house".to_owned(), ..Default::default() };
        let mut poses = server.maps().get_trajectory(request).await.unwrap().into_inner();
        check_status(&poses.message().await.unwrap_err(), Code::ResourceExhausted, "TENANT_LIMIT");
        // A reader that leaves gives its place back.
        drop(first);
        while list().await.is_err() {}
        drop(second);
    });
}

#[test]
fn a_flood_on_ten_maps_leaves_a_quiet_tenant_its_turns() {
    run(async {
        let tokens = NamedTempFile::new().unwrap();
        let text = tokens_toml(&[("flood", "flood", "write"), ("quiet", "quiet", "write")]);
        fs_err::write(tokens.path(), text).unwrap();
        let path = tokens.path().to_owned();
        let server = TestServer::with(|config| config.tokens = Some(path)).await;
        let url = url(&server);
        let connect = async |who: &str| {
            let token = Some(Token::new(&format!("secret-of-{who}")));
            let credentials = Credentials { token, ..Credentials::default() };
            Client::connect_with(&url, &credentials).await.unwrap()
        };
        let (flood, quiet) = (connect("flood").await, connect("quiet").await);
        let over = Arc::new(AtomicBool::new(false));
        let mut floods = Vec::new();
        for map in 0..10 {
            let (client, over) = (flood.clone(), Arc::clone(&over));
            floods.push(tokio::spawn(async move {
                let name = format!("map-{map}");
                client.create_map(&name, None).await.unwrap();
                let options = SessionOptions::default();
                let mut session = client.ingest(&name, "robot", options).await.unwrap();
                session.send(camera(0)).await.unwrap();
                let mut id = 0;
                while !over.load(Ordering::Relaxed) {
                    session.send(endless(id)).await.unwrap();
                    id += 1;
                }
                id
            }));
        }
        quiet.create_map("room", None).await.unwrap();
        let mut session = quiet.ingest("room", "robot", SessionOptions::default()).await.unwrap();
        session.send(camera(0)).await.unwrap();
        // The flood ends when the quiet one is served, and not before: a starved one would hang.
        for id in 0..10 {
            let sequence = session.send(keyframe(id % 6 + 6 * (id / 6))).await.unwrap();
            session.optimized(sequence).await.unwrap();
        }
        over.store(true, Ordering::Relaxed);
        let mut keyframes = 0;
        for flood in floods {
            keyframes += flood.await.unwrap();
        }
        assert!(keyframes >= 10, "there was no flood: {keyframes}");
    });
}

#[test]
fn a_hostile_tenant_gets_its_own_and_nothing_of_others() {
    run(async {
        let tokens = NamedTempFile::new().unwrap();
        let mut text = tokens_toml(&[("bad", "bad", "write"), ("good", "good", "write")]);
        text.push_str(
            "[[tenant]]\nname = 'bad'\n\
             limits = { max_maps = 2, max_streams = 2, max_keyframes = 30 }\n",
        );
        fs_err::write(tokens.path(), text).unwrap();
        let path = tokens.path().to_owned();
        let server = TestServer::with(|config| {
            config.tokens = Some(path);
            config.tenant_limits = AccountLimits::default();
        })
        .await;
        let url = url(&server);
        let connect = async |who: &str| {
            let token = Some(Token::new(&format!("secret-of-{who}")));
            let credentials = Credentials { token, ..Credentials::default() };
            Client::connect_with(&url, &credentials).await.unwrap()
        };
        let (bad, good) = (connect("bad").await, connect("good").await);
        good.create_map("room", None).await.unwrap();
        // Maps without end.
        bad.create_map("a", Some(no_solves())).await.unwrap();
        bad.create_map("b", None).await.unwrap();
        let refused = bad.create_map("c", None).await.unwrap_err();
        assert_eq!(refused.code(), Some(Code::ResourceExhausted));
        assert_eq!(refused.reason().as_deref(), Some("TENANT_LIMIT"));
        // Streams without end.
        let _one = bad.ingest("a", "one", SessionOptions::default()).await.unwrap();
        let _two = bad.ingest("b", "two", SessionOptions::default()).await.unwrap();
        let mut ingest = IngestServiceClient::new(server.channel.clone());
        let open = open_item("a", "three", 0);
        let open = v1::IngestRequest { sequence: 0, item: Some(open) };
        let request = crate::rpc_access::by("bad", tokio_stream::iter([open]));
        let mut answers = ingest.ingest(request).await.unwrap().into_inner();
        let status = answers.message().await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        check_retry(&status);
        drop((_one, answers));
        // Keyframes without end: what fits is taken, then the stream ends.
        let mut session = bad.ingest("a", "four", SessionOptions::default()).await.unwrap();
        session.send(camera(0)).await.unwrap();
        let mut ended = None;
        for id in 0..1000 {
            if let Err(error) = session.send(endless(id)).await {
                ended = Some(error);
                break;
            }
        }
        let ended = ended.expect("the limit is never reached");
        assert_eq!(ended.reason().as_deref(), Some("TENANT_LIMIT"), "{ended}");
        assert_eq!(bad.get_map("a").await.unwrap().counts.unwrap().keyframe_count, 30);
        // Messages without end.
        let landmark = |id| v1::Landmark { id, ..v1::Landmark::default() };
        let landmarks = (0..2_000_000).map(landmark).collect();
        let huge = Item::Landmarks(v1::LandmarkBatch { landmarks });
        let messages = [open_item("b", "five", 0), huge];
        let messages = (0..)
            .zip(messages)
            .map(|(sequence, item)| v1::IngestRequest { sequence, item: Some(item) });
        let messages: Vec<v1::IngestRequest> = messages.collect();
        let request = crate::rpc_access::by("bad", tokio_stream::iter(messages));
        let mut answers = ingest.ingest(request).await.unwrap().into_inner();
        let status = loop {
            match answers.message().await {
                Ok(answer) => assert!(answer.is_some(), "the stream ended well"),
                Err(status) => break status,
            }
        };
        assert_eq!(status.code(), Code::OutOfRange, "{status}");
        // The others notice nothing.
        let mut session = good.ingest("room", "robot", SessionOptions::default()).await.unwrap();
        session.send(camera(0)).await.unwrap();
        for id in 0..5 {
            session.send(keyframe(id)).await.unwrap();
        }
        let report = session.finish().await.unwrap();
        assert_eq!((report.acknowledged, report.reconnects), (6, 0));
        let seen = good.get_map("room").await.unwrap().counts.unwrap();
        assert_eq!(seen.keyframe_count, 5);
        assert_eq!(good.get_map("a").await.unwrap_err().code(), Some(Code::NotFound));
    });
}
