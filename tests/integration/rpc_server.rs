//! Server info, health, reflection, limits, what is not served yet, and shutting down.

use covis::service::ServerConfig;
use covis::wire::v1;
use tonic::{Code, Request};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;
use tonic_reflection::pb::{v1 as reflection, v1alpha as reflection_alpha};
use v1::ingest_request::Item;
use v1::server_service_client::ServerServiceClient;

use crate::common::{
    Stream, TestServer, camera, check_retry, check_status, keyframe, landmark, run,
};

const SERVICES: [&str; 5] = [
    "covis.v1.IngestService",
    "covis.v1.JobService",
    "covis.v1.MapService",
    "covis.v1.OptimizationService",
    "covis.v1.ServerService",
];

#[test]
fn how_many_maps_there_may_be_follows_their_memory() {
    let most = |bytes| {
        let mut config = ServerConfig::default();
        config.server_limits.held.bytes = bytes;
        config.most_maps()
    };
    assert_eq!(ServerConfig::default().most_maps(), 10_922);
    assert_eq!(most(Some(1 << 30)), 2730);
    assert_eq!(most(None), 10_922);
    assert_eq!(ServerConfig { max_maps: Some(3), ..ServerConfig::default() }.most_maps(), 3);
}

#[test]
fn server_info_tells_version_limits_and_features() {
    run(async {
        let server = TestServer::with(|config| config.max_maps = Some(7)).await;
        let mut client = ServerServiceClient::new(server.channel.clone());
        let info = client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap().into_inner();
        assert_eq!(info.version, env!("CARGO_PKG_VERSION"));
        assert_eq!(info.wire_packages, ["covis.v1"]);
        assert_eq!(info.instance_id.len(), 16);
        assert_eq!(info.durability(), v1::Durability::InMemory);
        assert_eq!(info.solver_thread_count, 1);
        let limits = info.limits.unwrap();
        assert_eq!(limits.max_receive_message_bytes, 4_194_304);
        assert_eq!(limits.max_map_count, 7);
        assert!(limits.map_limits.unwrap().max_keyframe_count.is_some());
        // What the caller's tenant holds, and the lower limit of tenant and server.
        server.create_map("room").await;
        let info = client.get_server_info(v1::GetServerInfoRequest {}).await.unwrap().into_inner();
        let row = |name| info.resources.iter().find(|row| row.resource == name).unwrap();
        assert_eq!((row("maps").held, row("maps").limit), (1, Some(7)));
        assert_eq!((row("streams").held, row("keyframes").limit), (0, None));
        assert_eq!(row("map_bytes").limit, Some(4 << 30));
        assert!(info.features.is_sorted());
        // The list of docs/wire.md, which sets each name in backquotes after this sentence.
        let text = include_str!("../../docs/wire.md");
        let list = text.split("so that a client need not try:").nth(1).unwrap();
        let list = list.split("\n\n").next().unwrap();
        let documented: Vec<&str> =
            list.split('`').filter(|part| part.contains('.') && part.len() > 2).collect();
        assert_eq!(info.features, documented);
    });
}

#[test]
fn health_tells_each_service_and_turns_when_the_server_drains() {
    run(async {
        let server = TestServer::start().await;
        let mut health = HealthClient::new(server.channel.clone());
        for service in SERVICES.into_iter().chain([""]) {
            let request = HealthCheckRequest { service: service.to_owned() };
            let answer = health.check(request).await.unwrap().into_inner();
            assert_eq!(answer.status(), ServingStatus::Serving, "{service}");
        }
        let request = HealthCheckRequest { service: "covis.v1.Nothing".to_owned() };
        assert_eq!(health.check(request).await.unwrap_err().code(), Code::NotFound);
        let watched = HealthCheckRequest { service: SERVICES[0].to_owned() };
        let mut watch = health.watch(watched).await.unwrap().into_inner();
        assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::Serving);
        let shutdown = tokio::spawn(server.running.shutdown());
        assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::NotServing);
        drop(watch);
        shutdown.await.unwrap();
    });
}

#[test]
fn reflection_lists_the_services_in_both_versions() {
    run(async {
        let server = TestServer::start().await;
        let expected: Vec<&str> = SERVICES.into_iter().chain(["grpc.health.v1.Health"]).collect();

        use reflection::server_reflection_request::MessageRequest;
        use reflection::server_reflection_response::MessageResponse;
        let mut client = reflection::server_reflection_client::ServerReflectionClient::new(
            server.channel.clone(),
        );
        let ask = |message_request| reflection::ServerReflectionRequest {
            host: String::new(),
            message_request: Some(message_request),
        };
        let symbol = MessageRequest::FileContainingSymbol("covis.v1.IngestService".to_owned());
        let requests = vec![ask(MessageRequest::ListServices(String::new())), ask(symbol)];
        let requests = tokio_stream::iter(requests);
        let mut answers = client.server_reflection_info(requests).await.unwrap().into_inner();
        let answer = answers.message().await.unwrap().unwrap().message_response.unwrap();
        let MessageResponse::ListServicesResponse(list) = answer else { panic!("{answer:?}") };
        let names: Vec<String> = list.service.into_iter().map(|s| s.name).collect();
        for name in &expected {
            assert!(names.iter().any(|n| n == name), "{name} is not in {names:?}");
        }
        let answer = answers.message().await.unwrap().unwrap().message_response.unwrap();
        let MessageResponse::FileDescriptorResponse(files) = answer else { panic!("{answer:?}") };
        assert!(!files.file_descriptor_proto.is_empty());

        use reflection_alpha::server_reflection_request::MessageRequest as AlphaRequest;
        use reflection_alpha::server_reflection_response::MessageResponse as AlphaResponse;
        let mut client = reflection_alpha::server_reflection_client::ServerReflectionClient::new(
            server.channel.clone(),
        );
        let request = reflection_alpha::ServerReflectionRequest {
            host: String::new(),
            message_request: Some(AlphaRequest::ListServices(String::new())),
        };
        let requests = tokio_stream::iter(vec![request]);
        let mut answers = client.server_reflection_info(requests).await.unwrap().into_inner();
        let answer = answers.message().await.unwrap().unwrap().message_response.unwrap();
        let AlphaResponse::ListServicesResponse(list) = answer else { panic!("{answer:?}") };
        let names: Vec<String> = list.service.into_iter().map(|s| s.name).collect();
        for name in &expected {
            assert!(names.iter().any(|n| n == name), "{name} is not in {names:?}");
        }
    });
}

#[test]
fn a_message_past_the_limit_is_out_of_range() {
    run(async {
        let server = TestServer::with(|config| config.max_message_bytes = 4096).await;
        let map_id = "x".repeat(5000);
        let status = server
            .maps()
            .get_map(v1::GetMapRequest { map_id, ..Default::default() })
            .await
            .unwrap_err();
        assert_eq!(status.code(), Code::OutOfRange, "{status:?}");

        // On a stream: what came before is answered, and the map goes on living.
        server.create_map("room").await;
        let (mut stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!(opened.max_message_bytes, 4096);
        stream.put(1, Item::Camera(camera(0))).await;
        let landmarks = (0..1000).map(landmark).collect();
        stream.send(2, Item::Landmarks(v1::LandmarkBatch { landmarks })).await;
        assert_eq!(stream.end().await.code(), Code::OutOfRange);
        let (_, opened) = Stream::open(&server, "room", "robot", 0).await;
        assert_eq!(opened.next_sequence, 2);
    });
}

#[test]
fn shutting_down_ends_streams_with_unavailable_after_their_acks() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let watch = v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let mut watch = server.maps().watch_map(watch).await.unwrap().into_inner();
        assert!(watch.message().await.unwrap().unwrap().delta.unwrap().reset);
        stream.send(1, Item::Camera(camera(0))).await;
        stream.send(2, Item::Keyframe(keyframe(0))).await;
        stream.answer(1).await;
        stream.answer(2).await;
        let shutdown = tokio::spawn(server.running.shutdown());
        let status = stream.end().await;
        check_status(&status, Code::Unavailable, "DRAINING");
        check_retry(&status);
        let status = loop {
            match watch.message().await {
                Ok(Some(_)) => {}
                Ok(None) => panic!("the watch ended well"),
                Err(status) => break status,
            }
        };
        check_status(&status, Code::Unavailable, "DRAINING");
        check_retry(&status);
        shutdown.await.unwrap();
    });
}

#[test]
fn a_bug_in_any_handler_is_internal_and_names_an_entry_of_the_log() {
    run(async {
        let server = TestServer::with_fault("rpc:*").await;
        let mut info = ServerServiceClient::new(server.channel.clone());
        let mut maps = server.maps();
        let mut optimization = server.optimization();
        macro_rules! end {
            ($call:expr) => {
                $call.await.unwrap().into_inner().message().await.unwrap_err()
            };
        }
        let statuses = [
            info.get_server_info(v1::GetServerInfoRequest {}).await.unwrap_err(),
            maps.create_map(v1::CreateMapRequest::default()).await.unwrap_err(),
            maps.get_map(v1::GetMapRequest::default()).await.unwrap_err(),
            maps.list_maps(v1::ListMapsRequest::default()).await.unwrap_err(),
            maps.delete_map(v1::DeleteMapRequest::default()).await.unwrap_err(),
            end!(maps.export_map(v1::ExportMapRequest::default())),
            end!(maps.get_trajectory(v1::GetTrajectoryRequest::default())),
            end!(maps.list_landmarks(v1::ListLandmarksRequest::default())),
            end!(maps.list_keyframes(v1::ListKeyframesRequest::default())),
            end!(maps.list_constraints(v1::ListConstraintsRequest::default())),
            maps.update_map(v1::UpdateMapRequest::default()).await.unwrap_err(),
            maps.import_map(tokio_stream::iter(Vec::new())).await.unwrap_err(),
            end!(maps.watch_map(v1::WatchMapRequest::default())),
            optimization.refine_pose(v1::RefinePoseRequest::default()).await.unwrap_err(),
            end!(optimization.optimize_map(v1::OptimizeMapRequest::default())),
            optimization.solve_bundle(v1::SolveBundleRequest::default()).await.unwrap_err(),
            optimization.solve_pose_graph(v1::SolvePoseGraphRequest::default()).await.unwrap_err(),
            Stream::connect(&server).await.end().await,
        ];
        for status in statuses {
            check_status(&status, Code::Internal, "BUG");
            let details = tonic_types::StatusExt::get_details_error_info(&status).unwrap();
            assert!(status.message().contains(&details.metadata["id"]), "{status:?}");
        }
    });
}

#[test]
fn a_call_without_time_is_deadline_exceeded() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let mut request =
            Request::new(v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() });
        request.metadata_mut().insert("grpc-timeout", "20m".parse().unwrap());
        let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
        let status = loop {
            match watch.message().await {
                Ok(Some(_)) => {}
                Ok(None) => panic!("the watch ended well"),
                Err(status) => break status,
            }
        };
        assert_eq!(status.code(), Code::DeadlineExceeded, "{status:?}");
    });
}
