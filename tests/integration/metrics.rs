//! `GET /metrics`: what is counted, that the handbook lists exactly what the page has, and who is
//! refused.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;

use covis::service::{RunningServer, Server, ServerConfig, ServerError};
use covis::wire::v1;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, camera, check_status, keyframe, run};

/// Sends one request and reads until the server closes.
async fn http(address: SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    answer
}

/// A page: values by name with labels, and the names of the families.
pub(crate) struct Page {
    values: BTreeMap<String, f64>,
    families: BTreeSet<String>,
}

impl Page {
    pub(crate) async fn of(server: &RunningServer) -> Self {
        let address = server.metrics_addr().unwrap();
        let answer = http(address, "GET /metrics HTTP/1.1\r\nhost: covis\r\n\r\n").await;
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
        assert!(head.contains("content-type: text/plain; version=0.0.4"), "{head}");
        let mut page = Self { values: BTreeMap::new(), families: BTreeSet::new() };
        let mut family = String::new();
        for line in body.lines() {
            if let Some(rest) = line.strip_prefix("# HELP ") {
                let (name, help) = rest.split_once(' ').unwrap();
                assert!(help.ends_with('.'), "{line}");
                assert!(page.families.insert(name.to_owned()), "{name} comes twice");
                family = name.to_owned();
            } else if let Some(rest) = line.strip_prefix("# TYPE ") {
                let (name, kind) = rest.split_once(' ').unwrap();
                assert_eq!(name, family);
                assert_eq!(kind == "counter", name.ends_with("_total"), "{line}");
            } else {
                let (name, value) = line.rsplit_once(' ').unwrap();
                assert!(name.starts_with(&family), "`{line}` under {family}");
                let value = value.parse().unwrap();
                assert!(page.values.insert(name.to_owned(), value).is_none(), "{name} twice");
            }
        }
        page
    }

    #[track_caller]
    pub(crate) fn get(&self, name: &str) -> f64 {
        *self.values.get(name).unwrap_or_else(|| panic!("no {name} in {:#?}", self.values))
    }
}

pub(crate) async fn start(change: impl FnOnce(&mut ServerConfig)) -> TestServer {
    TestServer::with(|config| {
        config.metrics_listen = Some("127.0.0.1:0".to_owned());
        change(config);
    })
    .await
}

/// Six keyframes of "house", then one again and one that is bad.
async fn ingest(server: &TestServer) {
    server.create_map("house").await;
    server.build_map("house", 6).await;
    let (mut stream, opened) = Stream::open(server, "house", "robot", 0).await;
    assert_eq!(opened.next_sequence, 8);
    assert!(stream.put(7, Item::Keyframe(keyframe(5))).await.duplicate);
    let unplaced = v1::Keyframe { world_from_camera: None, odom_from_camera: None, ..keyframe(6) };
    let refused = stream.put(8, Item::Keyframe(unplaced)).await;
    assert_eq!(refused.status(), v1::AckStatus::Rejected);
    let page = Page::of(&server.running).await;
    assert_eq!(page.get("covis_ingest_streams"), 1.0);
    stream.finish().await.unwrap();
}

#[test]
fn a_result_that_is_not_possible_is_refused_and_counted_and_the_map_goes_on() {
    run(async {
        let server = start(|config| config.test_fault = Some("impossible-result".to_owned())).await;
        server.create_map("house").await;
        let (stream, _) = Stream::open(&server, "house", "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..4 {
            stream.send(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        let acks = stream.finish().await.unwrap();
        let refused = |ack: &&v1::IngestAck| ack.status() == v1::AckStatus::Optimized;
        let last = acks.iter().rfind(refused).unwrap();
        let failure = last.solve_failure.as_ref().unwrap();
        assert_eq!(failure.reason(), v1::ViolationReason::OutOfRange, "{failure:?}");
        assert!(failure.description.contains("keyframe"), "{failure:?}");
        let optimize = v1::OptimizeMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let mut rows = server.optimization().optimize_map(optimize).await.unwrap().into_inner();
        let status = loop {
            match rows.message().await {
                Ok(row) => assert!(row.is_some(), "the result was taken"),
                Err(status) => break status,
            }
        };
        check_status(&status, Code::FailedPrecondition, "CHANGE_REFUSED");
        let page = Page::of(&server.running).await;
        assert!(page.get("covis_changes_refused_total{change=\"solve\"}") >= 2.0);
        assert_eq!(page.get("covis_maps{state=\"open\"}"), 1.0);
        // It takes the next item, and its keyframes are where they were sent.
        let (mut stream, opened) = Stream::open(&server, "house", "robot", 0).await;
        assert_eq!(opened.next_sequence, 6);
        let ack = stream.put(6, Item::Keyframe(keyframe(4))).await;
        assert_eq!(ack.status(), v1::AckStatus::Received);
        let sent = server.watched("house").await.keyframes;
        assert!(sent.len() >= 4 && sent.iter().all(|k| k.world_from_camera.is_some()));
    });
}

#[test]
fn items_solves_calls_and_the_journal_are_counted() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = start(|config| config.data_dir = Some(folder.path().to_owned())).await;
        ingest(&server).await;
        let watch = v1::WatchMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let mut watch = server.maps().watch_map(watch).await.unwrap().into_inner();
        watch.message().await.unwrap().unwrap();
        let get = v1::GetMapRequest { map_id: "none".to_owned(), ..Default::default() };
        let status = server.maps().get_map(get).await.unwrap_err();
        assert_eq!(status.code(), Code::NotFound);
        let optimize = v1::OptimizeMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let mut rows = server.optimization().optimize_map(optimize).await.unwrap().into_inner();
        while rows.message().await.unwrap().is_some() {}
        let bundle = v1::SolveBundleRequest {
            problem: Some(crate::common::bundle(3)),
            ..Default::default()
        };
        server.optimization().solve_bundle(bundle).await.unwrap();

        let page = Page::of(&server.running).await;
        assert_eq!(page.get("covis_items_total{outcome=\"received\"}"), 7.0);
        assert_eq!(page.get("covis_items_total{outcome=\"duplicate\"}"), 1.0);
        assert_eq!(page.get("covis_items_total{outcome=\"ceiling\"}"), 0.0);
        assert_eq!(page.get("covis_items_total{outcome=\"rejected\",reason=\"missing\"}"), 1.0);
        assert_eq!(page.get("covis_item_durable_seconds_count"), 8.0);
        assert_eq!(page.get("covis_item_optimized_seconds_count"), 7.0);
        assert_eq!(page.get("covis_ingest_streams"), 0.0);
        assert_eq!(page.get("covis_watchers"), 1.0);
        assert_eq!(page.get("covis_maps{state=\"open\"}"), 1.0);
        assert_eq!(page.get("covis_maps{state=\"poisoned\"}"), 0.0);
        assert_eq!(page.get("covis_queue_capacity_items"), 64.0);
        assert_eq!(page.get("covis_queue_items"), 0.0);
        let rpc = |name: &str, code: &str| {
            page.get(&format!("covis_rpcs_total{{rpc=\"covis.v1.{name}\",code=\"{code}\"}}"))
        };
        assert_eq!(rpc("MapService/CreateMap", "OK"), 1.0);
        assert_eq!(rpc("MapService/GetMap", "NOT_FOUND"), 1.0);
        assert_eq!(rpc("IngestService/Ingest", "OK"), 2.0);
        assert_eq!(rpc("OptimizationService/OptimizeMap", "OK"), 1.0);
        let duration = "covis_rpc_duration_seconds_count{rpc=\"covis.v1.IngestService/Ingest\"}";
        assert_eq!(page.get(duration), 2.0);
        let solved = |kind: &str| {
            let counts = page.values.iter().filter(|(name, _)| {
                name.starts_with(&format!("covis_solves_total{{kind=\"{kind}\""))
            });
            counts.map(|(_, value)| value).sum::<f64>()
        };
        assert!(solved("local_bundle") >= 1.0);
        assert_eq!((solved("global"), solved("request")), (1.0, 1.0));
        for kind in ["local_bundle", "global", "request"] {
            let count = |name: &str| page.get(&format!("{name}_count{{kind=\"{kind}\"}}"));
            assert_eq!(count("covis_solve_duration_seconds"), solved(kind), "{kind}");
            assert_eq!(count("covis_solve_wait_seconds"), solved(kind), "{kind}");
            assert_eq!(page.get(&format!("covis_solves_running{{kind=\"{kind}\"}}")), 0.0);
            assert_eq!(page.get(&format!("covis_solves_waiting{{kind=\"{kind}\"}}")), 0.0);
        }
        // Every event is in one group, the map's creation and the two openings among them.
        assert!(page.get("covis_journal_group_events_sum") >= 7.0 + 3.0);
        assert!(page.get("covis_journal_sync_seconds_count") >= 2.0);
        assert!(page.get("covis_journal_bytes_total") > 1000.0);
        assert_eq!(page.get("covis_journal_failures_total"), 0.0);
        assert_eq!(page.get("covis_panics_total{where=\"engine\"}"), 0.0);
        assert_eq!(page.get("covis_serving"), 1.0);
        if cfg!(target_os = "linux") {
            assert!(page.get("covis_resident_memory_bytes") > 1e6);
            assert!(page.get("covis_open_files") >= 3.0);
        }
        // No label grows with maps and clients.
        for name in page.values.keys() {
            assert!(!name.contains("house") && !name.contains("robot"), "{name}");
        }
    });
}

#[test]
fn the_handbook_lists_what_the_page_has() {
    run(async {
        let server = start(|_| {}).await;
        ingest(&server).await;
        let page = Page::of(&server.running).await;
        let text = include_str!("../../docs/operations.md");
        let rows = text.lines().filter(|line| line.starts_with("| `covis_"));
        let names = rows.flat_map(|row| {
            let first = row.split('|').nth(1).unwrap();
            first.split('`').filter(|part| part.starts_with("covis_")).map(str::to_owned)
        });
        let listed: BTreeSet<String> = names.collect();
        assert_eq!(listed, page.families);
        // Alerts and examples name nothing else.
        let word = |c: char| !(c.is_ascii_alphanumeric() || c == '_');
        for name in text.split(word).filter(|word| word.starts_with("covis_")) {
            let base = ["_bucket", "_sum", "_count"].iter().find_map(|s| name.strip_suffix(s));
            let is_known = listed.contains(name) || base.is_some_and(|name| listed.contains(name));
            assert!(is_known, "{name}");
        }
        // A row for every family, so that no alert waits for a name that is not there yet.
        for family in &page.families {
            assert!(page.values.keys().any(|name| name.starts_with(family)), "{family}");
        }
    });
}

#[test]
fn bugs_are_counted_by_where_they_were_caught() {
    run(async {
        let server = start(|config| config.test_fault = Some("panic-in-solve".to_owned())).await;
        server.create_map("house").await;
        let (stream, _) = Stream::open(&server, "house", "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        stream.send(2, Item::Keyframe(keyframe(0))).await;
        stream.send(3, Item::Keyframe(keyframe(1))).await;
        stream.finish().await.unwrap();
        let page = Page::of(&server.running).await;
        let count = page.get("covis_panics_total{where=\"solve\"}");
        assert!(count >= 1.0);
        let panicked = "covis_solves_total{kind=\"local_bundle\",termination=\"panicked\"}";
        assert_eq!(page.get(panicked), count);
        assert_eq!(page.get("covis_maps{state=\"open\"}"), 1.0);

        let server = start(|config| config.test_fault = Some("panic-in-engine".to_owned())).await;
        server.create_map("house").await;
        let (mut stream, _) = Stream::open(&server, "house", "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        assert_eq!(stream.end().await.code(), Code::Internal);
        // A call that the engine answers after it has dealt with the panic.
        let get = v1::GetMapRequest { map_id: "house".to_owned(), ..Default::default() };
        server.maps().get_map(get).await.unwrap();
        let page = Page::of(&server.running).await;
        assert_eq!(page.get("covis_panics_total{where=\"engine\"}"), 1.0);
        assert_eq!(page.get("covis_maps{state=\"poisoned\"}"), 1.0);
        assert_eq!(page.get("covis_maps{state=\"open\"}"), 0.0);
        assert_eq!(page.get("covis_maps{state=\"damaged\"}"), 0.0);

        let server = start(|config| config.test_fault = Some("rpc:ListMaps".to_owned())).await;
        server.maps().list_maps(v1::ListMapsRequest::default()).await.unwrap_err();
        let page = Page::of(&server.running).await;
        assert_eq!(page.get("covis_panics_total{where=\"rpc\"}"), 1.0);
        let internal = "covis_rpcs_total{rpc=\"covis.v1.MapService/ListMaps\",code=\"INTERNAL\"}";
        assert_eq!(page.get(internal), 1.0);
    });
}

#[test]
fn there_is_one_page_to_read_and_nothing_to_write() {
    run(async {
        let server = start(|_| {}).await;
        let address = server.running.metrics_addr().unwrap();
        let check = async |request: &str, status: &str| {
            let answer = http(address, request).await;
            assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{request}: {answer}");
        };
        check("GET /metrics HTTP/1.1\r\nhost: a\r\n\r\n", "200").await;
        check("GET / HTTP/1.1\r\nhost: a\r\n\r\n", "404").await;
        check("GET /metrics/../x HTTP/1.1\r\nhost: a\r\n\r\n", "404").await;
        check("POST /metrics HTTP/1.1\r\nhost: a\r\ncontent-length: 0\r\n\r\n", "405").await;
        check("nonsense\r\n\r\n", "400").await;
        // A page of another site, by a request of its own or by a name that leads here.
        let foreign = "host: a\r\norigin: http://evil.example\r\n\r\n";
        check(&format!("GET /metrics HTTP/1.1\r\n{foreign}"), "403").await;
        let fetched = "host: a\r\nsec-fetch-site: cross-site\r\nsec-fetch-mode: no-cors\r\n\r\n";
        check(&format!("GET /metrics HTTP/1.1\r\n{fetched}"), "403").await;
        check("GET /metrics HTTP/1.1\r\nhost: evil.example:80\r\n\r\n", "421").await;
        server.running.shutdown().await;
        TcpStream::connect(address).await.unwrap_err();
    });
}

#[test]
fn metrics_leave_the_machine_only_where_plain_text_is_allowed() {
    run(async {
        let start = async |address: &str, insecure_plain_text| {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let metrics_listen = Some(address.to_owned());
            let config = ServerConfig {
                threads: 1,
                metrics_listen,
                insecure_plain_text,
                ..ServerConfig::default()
            };
            Server::start(listener, config).await
        };
        let refused = start("0.0.0.0:0", false).await.unwrap_err();
        assert!(matches!(refused, ServerError::PlainMetrics { .. }), "{refused:?}");
        let open = start("0.0.0.0:0", true).await.unwrap();
        let taken = open.metrics_addr().unwrap().to_string();
        let refused = start(&taken, true).await.unwrap_err();
        assert!(matches!(refused, ServerError::Metrics { .. }), "{refused:?}");
    });
}

#[test]
fn until_the_maps_are_open_health_says_so_and_calls_are_told_to_come_back() {
    const SERVICES: [&str; 5] = [
        "",
        "covis.v1.IngestService",
        "covis.v1.MapService",
        "covis.v1.OptimizationService",
        "covis.v1.ServerService",
    ];
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let config = || ServerConfig {
            threads: 1,
            data_dir: Some(folder.path().to_owned()),
            metrics_listen: Some("127.0.0.1:0".to_owned()),
            ..ServerConfig::default()
        };
        let before = TestServer::with(|c| *c = config()).await;
        before.create_map("house").await;
        before.build_map("house", 3).await;
        before.running.shutdown().await;

        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let starting = Server::listen(listener, config()).await.unwrap();
        let channel = tonic::transport::Endpoint::from_shared(url).unwrap().connect_lazy();
        let mut health = HealthClient::new(channel.clone());
        let mut check = async |expected| {
            for service in SERVICES {
                let request = HealthCheckRequest { service: service.to_owned() };
                let answer = health.check(request).await.unwrap().into_inner();
                assert_eq!(answer.status(), expected, "{service}");
            }
        };
        check(ServingStatus::NotServing).await;
        let mut maps = v1::map_service_client::MapServiceClient::new(channel.clone());
        let list = v1::ListMapsRequest::default;
        let status = maps.list_maps(list()).await.unwrap_err();
        check_status(&status, Code::Unavailable, "STARTING");
        let mut ingest = v1::ingest_service_client::IngestServiceClient::new(channel);
        let open = crate::common::open_item("house", "robot", 0);
        let open = v1::IngestRequest { sequence: 0, item: Some(open) };
        let mut answers = ingest.ingest(tokio_stream::iter([open])).await.unwrap().into_inner();
        let status = answers.message().await.unwrap_err();
        check_status(&status, Code::Unavailable, "STARTING");

        let running = starting.open().await.unwrap();
        check(ServingStatus::Serving).await;
        assert_eq!(maps.list_maps(list()).await.unwrap().into_inner().maps.len(), 1);
        assert_eq!(Page::of(&running).await.get("covis_serving"), 1.0);
        running.shutdown().await;
    });
}

#[test]
fn maps_are_counted_by_what_makes_them_read_only() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        let server = start(|config| config.data_dir = Some(path.clone())).await;
        let counts = async |server: &TestServer| {
            let page = Page::of(&server.running).await;
            let state = |state| page.get(&format!("covis_maps{{state=\"{state}\"}}"));
            ["open", "frozen", "poisoned", "damaged"].map(state)
        };
        server.create_map("house").await;
        server.build_map("house", 2).await;
        assert_eq!(counts(&server).await, [1.0, 0.0, 0.0, 0.0]);
        let freeze = v1::UpdateMapRequest {
            map_id: "house".to_owned(),
            state: v1::MapState::Frozen.into(),
            update_mask: Some(prost_types::FieldMask { paths: vec!["state".to_owned()] }),
            ..Default::default()
        };
        server.maps().update_map(freeze).await.unwrap();
        assert_eq!(counts(&server).await, [0.0, 1.0, 0.0, 0.0]);
        server.running.shutdown().await;
        let server = start(|config| config.data_dir = Some(path.clone())).await;
        assert_eq!(counts(&server).await, [0.0, 1.0, 0.0, 0.0]);
        server.running.shutdown().await;

        // What was acknowledged as durable is lost.
        let map = fs_err::read_dir(path.join("maps")).unwrap().next().unwrap().unwrap().path();
        let log = map.join("00000000000000000001.log");
        let bytes = fs_err::read(&log).unwrap();
        fs_err::write(&log, &bytes[..bytes.len() / 2]).unwrap();
        let server = start(|config| config.data_dir = Some(path.clone())).await;
        assert_eq!(counts(&server).await, [0.0, 0.0, 0.0, 1.0]);
    });
}

/// Names of metrics in a text.
fn names(text: &str) -> BTreeSet<String> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let words = text.split(|c: char| !is_name(c));
    words.filter(|word| word.starts_with("covis_")).map(str::to_owned).collect()
}

/// Every expression of a dashboard, wherever it stands.
fn expressions(value: &serde_json::Value, out: &mut Vec<String>) {
    out.extend(value.get("expr").and_then(|text| text.as_str()).map(str::to_owned));
    let fields = value.as_object().into_iter().flat_map(|fields| fields.values());
    let items = value.as_array().into_iter().flatten();
    fields.chain(items).for_each(|value| expressions(value, out));
}

#[test]
fn dashboard_and_alerts_ask_for_metrics_that_a_server_has() {
    run(async {
        let server = start(|_| {}).await;
        let page = Page::of(&server.running).await;
        let read = |file: &str| {
            let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy");
            fs_err::read_to_string(root.join(file)).unwrap()
        };
        let dashboard: serde_json::Value =
            serde_json::from_str(&read("grafana/covis.json")).unwrap();
        let panels = dashboard["panels"].as_array().unwrap();
        let mut ids = BTreeSet::new();
        for panel in panels {
            assert!(ids.insert(panel["id"].as_i64().unwrap()), "{panel}");
            assert!(!panel["title"].as_str().unwrap().is_empty(), "{panel}");
            let is_row = panel["type"] == "row";
            let targets = panel["targets"].as_array().map_or(0, Vec::len);
            assert_eq!(is_row, targets == 0, "{panel}");
            let grid = &panel["gridPos"];
            let end = grid["x"].as_i64().unwrap() + grid["w"].as_i64().unwrap();
            assert!(end <= 24, "{panel}");
        }
        let mut asked = Vec::new();
        expressions(&dashboard, &mut asked);
        let mut shown = BTreeSet::new();
        for text in asked.iter().map(String::as_str).chain([&*read("prometheus/alerts.yaml")]) {
            for open in [('(', ')'), ('{', '}'), ('[', ']')] {
                let count = |c: char| text.matches(c).count();
                assert_eq!(count(open.0), count(open.1), "{text}");
            }
            for name in names(text) {
                let part = ["_bucket", "_sum", "_count"];
                let whole = part.iter().find_map(|end| name.strip_suffix(end));
                let family = whole.unwrap_or(&name).to_owned();
                assert!(page.families.contains(&family), "no metric {name}: {text}");
                shown.insert(family);
            }
        }
        // Nothing that is counted stays unseen.
        let unseen: Vec<&String> = page.families.difference(&shown).collect();
        assert!(unseen.is_empty(), "not in the dashboard: {unseen:?}");
    });
}
