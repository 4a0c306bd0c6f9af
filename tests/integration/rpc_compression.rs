//! Messages that travel compressed: taken, answered so where asked, and limited by what they decompress to.

use covis::client::{Client, Credentials, LinkOptions, SessionOptions};
use covis::wire::v1;
use tonic::Code;
use tonic::codec::CompressionEncoding::Gzip;

use crate::common::{TestServer, camera, keyframe, run};

#[test]
fn a_compressed_session_makes_the_same_map() {
    run(async {
        let server = TestServer::start().await;
        let url = format!("http://{}", server.running.local_addr());
        let mut trajectories = Vec::new();
        for (map, compress) in [("plain", false), ("compressed", true)] {
            let link = LinkOptions { compress, ..LinkOptions::default() };
            let client = Client::connect_over(&url, &Credentials::default(), link).await.unwrap();
            client.create_map(map, None).await.unwrap();
            let options = SessionOptions { lock_step: true, ..SessionOptions::default() };
            let mut session = client.ingest(map, "robot", options).await.unwrap();
            session.send(camera(0)).await.unwrap();
            for id in 0..4 {
                session.send(keyframe(id)).await.unwrap();
            }
            assert_eq!(session.finish().await.unwrap().acknowledged, 5);
            trajectories.push(client.trajectory(map, None).await.unwrap().poses);
        }
        assert_eq!(trajectories[0].len(), 4);
        assert_eq!(trajectories[0], trajectories[1]);
        server.running.shutdown().await;
    });
}

#[test]
fn answers_are_compressed_for_those_who_accept_it() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("house").await;
        let get = || v1::GetMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let encoding = |answer: &tonic::Response<v1::GetMapResponse>| {
            answer.metadata().get("grpc-encoding").map(|value| value.to_str().unwrap().to_owned())
        };
        let plain = server.maps().get_map(get()).await.unwrap();
        assert_eq!(encoding(&plain), None);
        let compressed = server.maps().accept_compressed(Gzip).get_map(get()).await.unwrap();
        assert_eq!(encoding(&compressed).as_deref(), Some("gzip"));
        assert_eq!(plain.into_inner(), compressed.into_inner());
        server.running.shutdown().await;
    });
}

#[test]
fn a_small_message_that_decompresses_to_a_large_one_is_refused() {
    run(async {
        let server = TestServer::start().await;
        let request = |bytes: usize| v1::CreateMapRequest {
            map_id: "house".to_owned(),
            display_name: "a".repeat(bytes),
            policy: None,
        };
        // 64 MiB of one letter are 64 kB on the wire; the limit is 4 MiB.
        let mut maps = server.maps().send_compressed(Gzip);
        let status = maps.create_map(request(64 << 20)).await.unwrap_err();
        assert_eq!(status.code(), Code::ResourceExhausted, "{status:?}");
        // Just below the limit the message itself is read, and its field refused.
        let status = maps.create_map(request((4 << 20) - 64)).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument, "{status:?}");
        maps.create_map(request(10)).await.unwrap();
        server.running.shutdown().await;
    });
}
