//! Who may call what: every RPC of the descriptors without a token, with a token of too low a role,
//! and with one of another tenant.

use std::fmt::Write;

use covis::wire::v1;
use prost::Message;
use prost_types::FileDescriptorSet;
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::{Code, Request, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;
use v1::ingest_service_client::IngestServiceClient;

use crate::common::{TestServer, bearing, check_status, open_item, run};

/// RPCs that touch no map of their own, or (`Ingest`) are called in a way of their own. The
/// others are called for a map of another tenant.
const WITHOUT_MAP: [&str; 17] = [
    "CancelJob",
    "CopyMap",
    "CreateJob",
    "DeleteJob",
    "DownloadJobFiles",
    "GetJob",
    "GetServerInfo",
    "ImportMap",
    "Ingest",
    "ListJobs",
    "ListMaps",
    "MergeMaps",
    "RefinePose",
    "SolveBundle",
    "SolvePoseGraph",
    "UploadJobFiles",
    "WatchJob",
];

/// A file of tokens: `secret-of-NAME` for each (name, tenant, role).
pub(crate) fn tokens_toml(tokens: &[(&str, &str, &str)]) -> String {
    let mut text = String::new();
    for (name, tenant, role) in tokens {
        let digest = Sha256::digest(format!("secret-of-{name}"));
        let sha256: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        writeln!(text, "[[token]]\nname = '{name}'\nsha256 = '{sha256}'").unwrap();
        writeln!(text, "tenant = '{tenant}'\nrole = '{role}'").unwrap();
    }
    text
}

fn tokens() -> NamedTempFile {
    let file = NamedTempFile::new().unwrap();
    let text = tokens_toml(&[
        ("reader", "acme", "read"),
        ("writer", "acme", "write"),
        ("admin", "acme", "admin"),
        ("rival", "rival", "admin"),
        ("default", "", "admin"),
    ]);
    fs_err::write(file.path(), text).unwrap();
    file
}

async fn guarded(file: &NamedTempFile) -> TestServer {
    let path = file.path().to_owned();
    TestServer::with(|config| config.tokens = Some(path)).await
}

/// A request that names a map, as all that do.
#[derive(Clone, PartialEq, Message)]
struct OnlyMap {
    #[prost(string, tag = "1")]
    map_id: String,
}

/// `request` with the token of `who`.
pub(crate) fn by<T>(who: &str, message: T) -> Request<T> {
    let token = if who.is_empty() { String::new() } else { format!("secret-of-{who}") };
    bearing(&token, message)
}

/// Calls any RPC; a stream is read to its end.
async fn call(server: &TestServer, path: &str, who: &str, map_id: &str) -> Result<(), Status> {
    let mut grpc = tonic::client::Grpc::new(server.channel.clone());
    grpc.ready().await.unwrap();
    let request = by(who, OnlyMap { map_id: map_id.to_owned() });
    let path = PathAndQuery::try_from(path).unwrap();
    let codec = tonic_prost::ProstCodec::<OnlyMap, ()>::default();
    grpc.unary(request, path, codec).await.map(drop)
}

/// Path, name and, where the request has one, the number of `map_id` of every RPC.
pub(crate) fn rpcs() -> Vec<(String, String, Option<i32>)> {
    let set = FileDescriptorSet::decode(v1::FILE_DESCRIPTOR_SET).unwrap();
    let messages: Vec<_> = set.file.iter().flat_map(|file| &file.message_type).collect();
    let mut rpcs = Vec::new();
    for file in &set.file {
        for service in &file.service {
            for method in &service.method {
                let path = format!("/{}.{}/{}", file.package(), service.name(), method.name());
                let input = method.input_type().rsplit('.').next().unwrap();
                let input = messages.iter().find(|message| message.name() == input).unwrap();
                let map_id = input.field.iter().find(|field| field.name() == "map_id");
                rpcs.push((path, method.name().to_owned(), map_id.map(|field| field.number())));
            }
        }
    }
    rpcs
}

#[test]
fn no_rpc_serves_strangers() {
    run(async {
        let file = tokens();
        let server = guarded(&file).await;
        let rpcs = rpcs();
        assert!(rpcs.len() >= 24, "{rpcs:?}");
        for (path, ..) in &rpcs {
            for who in ["", "nobody"] {
                let status = call(&server, path, who, "house").await.unwrap_err();
                assert_eq!(status.code(), Code::Unauthenticated, "{path} by {who:?}: {status}");
                assert!(!status.message().contains("secret"), "{status}");
            }
        }
        let reflection = "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo";
        let status = call(&server, reflection, "", "").await.unwrap_err();
        assert_eq!(status.code(), Code::Unauthenticated);
        // Whoever watches over the server needs no token.
        let mut health = HealthClient::new(server.channel.clone());
        health.check(HealthCheckRequest::default()).await.unwrap();
    });
}

#[test]
fn a_role_covers_its_own_calls_and_those_below() {
    run(async {
        let file = tokens();
        let server = guarded(&file).await;
        let check = async |who: &str, rpc: &str, covered: bool| {
            let status = call(&server, rpc, who, "nowhere").await;
            let code = status.as_ref().err().map(Status::code);
            assert_eq!(code != Some(Code::PermissionDenied), covered, "{rpc} by {who}: {status:?}");
        };
        for (rpc, reader, writer) in [
            ("/covis.v1.MapService/GetMap", true, true),
            ("/covis.v1.MapService/WatchMap", true, true),
            ("/covis.v1.MapService/ExportMap", true, true),
            ("/covis.v1.IngestService/Ingest", false, true),
            ("/covis.v1.OptimizationService/OptimizeMap", false, true),
            ("/covis.v1.OptimizationService/SolveBundle", false, true),
            ("/covis.v1.MapService/CreateMap", false, true),
            ("/covis.v1.MapService/CopyMap", false, true),
            ("/covis.v1.MapService/DeleteMap", false, false),
            ("/covis.v1.MapService/NotYetThought", false, false),
        ] {
            check("reader", rpc, reader).await;
            check("writer", rpc, writer).await;
            check("admin", rpc, true).await;
        }
        let delete = v1::DeleteMapRequest { map_id: "nowhere".to_owned() };
        let status = server.maps().delete_map(by("writer", delete)).await.unwrap_err();
        check_status(&status, Code::PermissionDenied, "ROLE_TOO_LOW");
    });
}

#[test]
fn the_map_of_another_tenant_is_not_there_for_any_rpc() {
    run(async {
        let file = tokens();
        let server = guarded(&file).await;
        let create = |map_id: &str| v1::CreateMapRequest {
            map_id: map_id.to_owned(),
            ..v1::CreateMapRequest::default()
        };
        let made = server.maps().create_map(by("writer", create("house"))).await.unwrap();
        let made = made.into_inner().map.unwrap();
        assert_eq!(made.map_id, "house", "the tenant is not shown");
        for (path, name, map_id) in rpcs() {
            match map_id {
                _ if name == "CreateMap" => {}
                Some(1) => {
                    for who in ["rival", "default"] {
                        let status = call(&server, &path, who, "house").await.unwrap_err();
                        let code = status.code();
                        let hidden = matches!(code, Code::NotFound | Code::Unimplemented);
                        assert!(hidden, "{path} by {who}: {status}");
                        assert!(!status.message().contains("acme"), "{status}");
                    }
                }
                _ => assert!(WITHOUT_MAP.contains(&&*name), "{path}: whose map does it touch?"),
            }
        }
        server.maps().create_map(by("rival", create("shed"))).await.unwrap();
        for (target, source) in [("shed", "house"), ("house", "shed")] {
            let (target_map_id, source_map_id) = (target.to_owned(), source.to_owned());
            let merge = v1::MergeMapsRequest { target_map_id, source_map_id, ..Default::default() };
            let status = server.maps().merge_maps(by("rival", merge)).await.unwrap_err();
            check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        }
        let copy = v1::CopyMapRequest {
            source_map_id: "house".to_owned(),
            new_map_id: "copy".to_owned(),
            ..Default::default()
        };
        let status = server.maps().copy_map(by("rival", copy)).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        let shed = v1::DeleteMapRequest { map_id: "shed".to_owned() };
        server.maps().delete_map(by("rival", shed)).await.unwrap();
        let open = open_item("house", "robot", 0);
        let open = v1::IngestRequest { sequence: 0, item: Some(open) };
        let mut ingest = IngestServiceClient::new(server.channel.clone());
        let request = by("rival", tokio_stream::iter([open]));
        let mut answers = ingest.ingest(request).await.unwrap().into_inner();
        check_status(&answers.message().await.unwrap_err(), Code::NotFound, "MAP_NOT_FOUND");

        // The name is free for others; each sees and deletes its own.
        let taken = server.maps().create_map(by("admin", create("house"))).await.unwrap_err();
        check_status(&taken, Code::AlreadyExists, "MAP_EXISTS");
        assert!(!taken.message().contains("acme"), "{taken}");
        for who in ["rival", "default"] {
            server.maps().create_map(by(who, create("house"))).await.unwrap();
        }
        let delete = v1::DeleteMapRequest { map_id: "house".to_owned() };
        server.maps().delete_map(by("rival", delete)).await.unwrap();
        let mut seen = Vec::new();
        for who in ["reader", "rival", "default"] {
            let list = server.maps().list_maps(by(who, v1::ListMapsRequest::default())).await;
            let maps = list.unwrap().into_inner().maps;
            seen.push(maps.iter().map(|map| (map.map_id.clone(), map.uid.clone())).collect());
        }
        let [acme, rival, default]: [Vec<(String, String)>; 3] = seen.try_into().unwrap();
        assert_eq!(acme, [("house".to_owned(), made.uid.clone())]);
        assert_eq!(rival, []);
        assert_eq!(default.len(), 1);
        assert_ne!(default[0].1, made.uid);
    });
}

#[test]
fn tokens_are_read_again_while_the_server_runs() {
    run(async {
        let file = tokens();
        let server = guarded(&file).await;
        let list = async |who: &str| {
            let answer = server.maps().list_maps(by(who, v1::ListMapsRequest::default())).await;
            answer.map(drop).map_err(|status| status.code())
        };
        assert_eq!(list("reader").await, Ok(()));
        fs_err::write(file.path(), "[[token]]\nname = 'x'\n").unwrap();
        server.running.reload().unwrap_err();
        assert_eq!(list("reader").await, Ok(()), "a bad file changes nothing");
        fs_err::write(file.path(), tokens_toml(&[("late", "acme", "read")])).unwrap();
        server.running.reload().unwrap();
        assert_eq!(list("reader").await, Err(Code::Unauthenticated));
        assert_eq!(list("late").await, Ok(()));
    });
}
